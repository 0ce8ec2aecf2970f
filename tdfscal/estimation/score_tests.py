"""Does the rig file keep something from us? Score tests for what was not declared.

χ² over all residuals dilutes a fault that speaks through a few of them. Each suspect is therefore
asked for by itself: if it were a free parameter, how far would the residuals go to meet it, and by
how much would the angles move? Nothing is fitted anew; the columns are those of the measurement
model (for what is declared as exact), a shift of the prior's value (for what is declared with an
uncertainty), or a zero that drifts over the campaign.

One fault makes many suspects. Those that a test has spoken for are held against each other by how
far −2 ln L falls less q ln N for q unknowns and N residuals (Schwarz, Ann. Stat. 6, 1978); the
likeliest is named, and those that are about as likely.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.estimation.suspicion import Suspicion, suspicion, worst_zero
from tdfscal.estimation.uncertainty import Estimate, F, Quality
from tdfscal.model.parameters import layout, rpy_prior_std
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.significance import UNDECLARED_ERROR, UNDECLARED_GRAVITY_SHARE

#: Share of the columns' size below which what stands out of the fit's is rounding, and of a
#: component below which no direction that stands out has it.
_NOISE_ONLY, _BLIND = 1e-9, 1e-6
#: Groups whose columns are made of the noisy readings themselves, beside the turns.
MADE_OF_READINGS = ("sensitivity", "gain", "compliance")
#: Group, support, whitened columns (rows, g), and what they are per unit of the rig file.
Suspect = tuple[str, int, FloatArray, float | FloatArray]
#: The test of columns (m, g), the score (g,) that noise makes of them and what was asked, as a
#: noise that is itself estimated widens it.
Widened = Callable[[FloatArray, FloatArray, "Asked"], "Asked"]


def speaking(
    of: Estimate[F],
    suspects: Sequence[Suspect],
    noise_scores: Callable[[], FloatArray],
    *,
    other: float = 0.0,
    always: bool = False,
    widened: Widened = lambda columns, lean, asked: asked,
) -> list[Suspicion]:
    """Ask for every suspect, and return those for whom a test speaks.

    noise_scores : expected scores (P,) of all parameters by the noise of the readings alone; asked
    for where a suspect made of readings speaks; always where noise may be what silences it.
    other : share of the level that other tests spend.
    """
    fit, parts, residual = of.fit, of.parts, of.fit.white
    others = (1 - UNDECLARED_GRAVITY_SHARE - other) / max(1, len(suspects) - 1)
    p, found, bias = int(fit.active.sum()), list[Suspicion](), None
    for group, index, columns, unit in suspects:
        level = UNDECLARED_ERROR * (UNDECLARED_GRAVITY_SHARE if group == "tilt" else others)
        known = parts.left.T @ columns
        apart, lean = columns - parts.left @ known, np.zeros(columns.shape[1])
        made = group in MADE_OF_READINGS
        asked = ask(apart, columns, residual)
        if not (made and always) and asked.p_value(of.quality) > level:
            continue
        if made:
            bias = noise_scores() if bias is None else bias
            lean = lean_of(bias, fit.active, fit.rig.n, group, index)
            asked = ask(apart, columns, residual, lean)
        if asked.p_value(of.quality) > level:
            continue
        asked = widened(columns, lean, asked)
        p_value = asked.p_value(of.quality)
        if p_value > level:
            continue
        # The other parameters, angles among them, give way to the suspect's amount.
        move = -parts.root[:p] @ (known @ asked.amount)
        size, weight = float(np.abs(asked.amount * unit).max()), asked.weight(fit.rows)
        doubt = suspicion(fit.rig, of.uncertainty, group, index, size, move, p_value, weight)
        zero_shift, zero = worst_zero(fit.rig, of.uncertainty, fit.active, move)
        found.append(replace(doubt, zero_shift=zero_shift, zero=zero, move=move))
    return found


@dataclass(frozen=True, slots=True)
class Asked:
    """How far the residuals go to meet a suspect: fall of χ², unknowns seen, their amount.

    std : (g,), of the amount; ∞ where it is not seen.
    """

    statistic: float
    unknowns: int
    amount: FloatArray
    std: FloatArray

    def p_value(self, stats: Quality) -> float:
        """Held against the scatter that remains without the suspect, or it would excuse itself."""
        if not self.unknowns:
            return 1.0
        rest = (stats.chi2 - self.statistic) / max(stats.dof - self.unknowns, 1)
        return float(chi2_sf(self.statistic / max(1.0, rest), self.unknowns))

    def weight(self, rows: int) -> float:
        """Fall of −2 ln L less what the unknowns are worth among so many residuals."""
        return self.statistic - self.unknowns * float(np.log(max(rows, 2)))


def ask(
    apart: FloatArray,
    columns: FloatArray,
    residual: FloatArray,
    lean: FloatArray | float = 0.0,
    seen_from: float = _NOISE_ONLY,
) -> Asked:
    """Score of columns, `apart` of them beyond the fit's; lean : the score that noise makes.

    seen_from : share of the columns' size that has to stand out of the fit's.
    """
    score, information = apart.T @ residual - lean, apart.T @ apart
    values, vectors = np.linalg.eigh(information)
    seen = values > seen_from * max(float(np.sum(columns**2)), np.finfo(float).tiny)
    half = vectors[:, seen] / np.sqrt(values[seen])
    blind = np.abs(vectors[:, ~seen]).max(axis=1, initial=0.0) > _BLIND
    return Asked(
        statistic=float(np.sum((half.T @ score) ** 2)),
        unknowns=int(seen.sum()),
        amount=-half @ (half.T @ score),
        std=np.where(blind, np.inf, np.linalg.norm(half, axis=1)),
    )


def lean_of(bias: FloatArray, active: BoolArray, n: int, group: str, index: int) -> FloatArray:
    """Score that noise alone makes of a suspect's columns; none where it has a prior."""
    place = layout(n)
    part = place["compliance"]
    if group != "compliance":
        start = place["sensitivity"].start + 6 * index
        part = slice(start, start + 6)
    own = np.where(active[part], 0.0, bias[part])
    return np.asarray(own[:3].sum(keepdims=True) if group == "gain" else own)


def moving_zeros(group: str, columns: FloatArray, unit: float) -> Iterator[Suspect]:
    """Zeros of one sensor after the other, and all of them, that move; columns (rows, n, 3)."""
    for i in range(columns.shape[1]):
        yield group, i, columns[:, i], unit
    yield f"all {group}", 0, columns.reshape(len(columns), -1), unit


def stated_suspects(
    rig: Rig, columns: FloatArray, std: FloatArray, motions: int, priors: int
) -> Iterator[Suspect]:
    """What a rig file states, group by group: exact values as columns, others as a shifted prior.

    columns : (rows, P), whitened, of all parameters; 0 in the last `priors` rows, which are those
    of the parameters' own priors first. std : (P,), of these priors.
    """
    place, held = layout(rig.n, motions), np.isfinite(std) & (std > 0)
    columns = np.where(std == 0, columns, 0.0)
    shifted = np.flatnonzero(held)  # by one standard deviation
    columns[len(columns) - priors + np.arange(len(shifted)), shifted] = 1.0
    for group, where in place.items():
        if group in ("rotation", "drift"):
            continue
        width = {"zero": 3, "sensitivity": 6, "hinge": 3, "datum": 3}.get(
            group, where.stop - where.start
        )
        for index, start in enumerate(range(where.start, where.stop, width)):
            part = slice(start, start + width)
            if np.isfinite(std[part]).any():
                unit = np.where(held[part], std[part], 1.0)
                yield group, index, columns[:, part], unit
                if group == "sensitivity":
                    alike = columns[:, start : start + 3].sum(axis=1, keepdims=True)
                    yield "gain", index, alike, unit[:1]


def misstated_mountings(rig: Rig, rows: int, after: int = 0) -> Iterator[Suspect]:
    """Nominal mountings that are not as stated.

    rows : of the columns, whose last ones, but for so many after them, are the angles' priors.
    """
    if rig.earlier is not None:
        return
    angled = np.flatnonzero(np.isfinite(rpy_prior_std(rig)))
    first = rows - after - len(angled)
    for i in range(rig.n):
        own = np.flatnonzero((angled // 3 == i) & np.isfinite(rig.rpy_std).ravel()[angled])
        if len(own):
            shifted = np.zeros((rows, len(own)))
            shifted[first + own, np.arange(len(own))] = 1.0
            yield "mounting", i, shifted, rig.rpy_std.ravel()[angled[own]]
