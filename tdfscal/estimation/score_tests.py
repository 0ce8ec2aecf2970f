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

from collections.abc import Iterator, Sequence

import numpy as np

from tdfscal.estimation.fit import Fitted
from tdfscal.estimation.uncertainty import Estimate, F, Uncertainty
from tdfscal.findings import Finding, Value
from tdfscal.frozen import field, record, replace
from tdfscal.model.parameters import layout
from tdfscal.numerics.least_squares import ask_beside
from tdfscal.records import ANGLES, Drift, FloatArray, Rig
from tdfscal.significance import (
    CAUSES_APART,
    CERTAIN_SHIFT,
    CERTAINLY_UNDECLARED,
    HARMFUL_SHIFT,
    UNDECLARED_ERROR,
    UNDECLARED_GRAVITY_SHARE,
)

#: Code of a finding by the group that the residuals ask for, the unit of its size, and whether it
#: is of one support.
CODES = {
    "zero": ("zero-suspected", "N", True),
    "x zero": ("zero-suspected", "N", True),
    "y zero": ("zero-suspected", "N", True),
    "z zero": ("zero-suspected", "N", True),
    "all zero": ("zero-suspected", "N", False),
    "sensitivity": ("sensitivity-suspected", "", True),
    "gain": ("gain-suspected", "", True),
    "mounting": ("mounting-suspected", "rad", True),
    "mass": ("mass-suspected", "kg", False),
    "barycentre": ("barycentre-suspected", "m", False),
    "hinge": ("hinge-suspected", "m", True),
    "datum": ("datum-suspected", "m", True),
    "vertical scale": ("axis-scale-suspected", "", True),
    "tilt": ("tilt-suspected", "rad", False),
    "compliance": ("compliance-suspected", "m/N", False),
    "push": ("terminal-pushed", "N", False),
    "friction": ("hysteresis-suspected", "N·m", False),
    "hinge friction": ("hinge-friction-suspected", "N·m", False),
    "force noise": ("force-noise-suspected", "N", False),
    "sensor noise": ("sensor-noise-suspected", "N", True),
    "position noise": ("positioner-noise-suspected", "m", False),
    "drift": ("zero-drift", "N", True),
    "all drift": ("zero-drift", "N", False),
    "temperature": ("zero-temperature", "N", True),
    "all temperature": ("zero-temperature", "N", False),
    "parabola": ("zero-parabola", "N/√h", True),
    "all parabola": ("zero-parabola", "N/√h", False),
    "walk": ("zero-walk", "N/√h", True),
    "all walk": ("zero-walk", "N/√h", False),
}
#: The zero of one axis, by whose letter it begins.
_ZEROS = ("x zero", "y zero", "z zero")
#: Zeros that drift other than along a line, of one sensor or of all.
PARABOLAS = ("parabola", "all parabola")


@record
class Suspicion:
    """Something that the residuals, or the distances between hinges, ask for.

    causes : what it may be, the likeliest first, each with its size. p_value : that chance alone
    asks as much, for this suspect alone. shift : largest move of an angle in units of its standard
    uncertainty, harm : the same in rad; angle : which one. kind, support : what it is, and of which
    support. weight : twice the logarithm of its likelihood, less what its unknowns are worth.
    tied : another one is likelier, but not by much. zero_shift, zero : largest move of a zero,
    likewise, and which one. move : (p,), of the free parameters, whose covariance may have to hold
    it.
    """

    causes: tuple[Finding, ...]
    p_value: float
    shift: float
    harm: float
    angle: str
    kind: str = ""
    support: int | None = None
    weight: float = 0.0
    tied: bool = False
    zero_shift: float = 0.0
    zero: str = ""
    move: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def certain(self) -> bool:
        """Chance alone does not ask as much."""
        return self.p_value < CERTAINLY_UNDECLARED

    @property
    def harmful(self) -> bool:
        """It would move an angle by more than its uncertainty bears; less, where it is certain.

        Then zeros count too, since a controller loads them. Before, chance alone moves them as far:
        mass, barycentre and zeros are nearly exchangeable. A mounting that is not as stated may be
        read with a wrong sign, however little the statement weighs.
        """
        if self.kind == "mounting" and not self.tied:
            return True
        if self.certain:
            return max(self.shift, self.zero_shift) > CERTAIN_SHIFT
        return self.shift > HARMFUL_SHIFT

    def spoils(self, moving: bool) -> bool:
        """Harmful; to samples in motion only what is certain is, but for a slip.

        A path driven twice repeats the positioners' errors, as no noise does: what is left of them
        looks like a gain or an offset, and stands in the uncertainty. It turns no sensor on the
        way.
        """
        return self.harmful and (not moving or self.certain or self.kind == "slip")

    def findings(self, *, rejects: bool, **values: Value) -> tuple[Finding, ...]:
        """Each cause as a finding, the likeliest first."""
        facts: dict[str, Value] = {"angle": self.angle, "shift": self.shift, **values}
        if self.zero_shift > CERTAIN_SHIFT:
            facts |= {"zero": self.zero, "zero_shift": self.zero_shift}
        return tuple(
            replace(
                cause,
                p_value=self.p_value,
                harm=self.harm,
                values={**cause.values, **facts, "tied": self.tied or k > 0},
                rejects=rejects,
            )
            for k, cause in enumerate(self.causes)
        )


def suspicion(
    rig: Rig,
    known: Uncertainty,
    kind: str,
    index: int,
    size: float,
    move: FloatArray,
    p_value: float,
    weight: float,
) -> Suspicion:
    """Weigh a suspect.

    kind, index : key of `CODES`, and the support where it is of one. size : that the residuals ask
    for, in the rig file's unit. move : (p,), of the free parameters with it, rotations first.
    """
    code, unit, of_one = CODES[kind]
    axis: dict[str, Value] = {"axis": kind[0]} if kind in _ZEROS else {}
    cause = Finding(code, (rig.supports[index],) if of_one else (), size, unit, values=axis)
    support = index if of_one else None
    worst = worst_angle(rig, known, move)
    return Suspicion((cause,), p_value, *worst, kind=kind, support=support, weight=weight)


def worst_angle(rig: Rig, known: Uncertainty, move: FloatArray) -> tuple[float, float, str]:
    """Largest move of an angle in its standard uncertainties, in rad, and which.

    move : as in `suspicion`.
    """
    std = np.sqrt(np.diagonal(known.covariance))
    shift = np.abs(move[: len(std)]) / std
    worst = int(np.argmax(shift))
    angle = f"{ANGLES[worst % 3]} of {rig.supports[worst // 3]}"
    return float(shift[worst]), float(abs(move[worst])), angle


def likeliest(found: list[Suspicion]) -> tuple[Suspicion, ...]:
    """The likeliest suspicion, and those that are about as likely."""
    # What one axis explains about as well as all three is of that axis.
    found = sorted(found, key=lambda doubt: doubt.weight + CAUSES_APART * (doubt.kind in _ZEROS))
    best = {(doubt.causes[0].code, doubt.support): doubt for doubt in found}
    ranked = sorted(best.values(), key=lambda doubt: doubt.weight, reverse=True)
    near = [doubt for doubt in ranked if ranked[0].weight - doubt.weight < CAUSES_APART]
    return tuple(replace(doubt, tied=doubt.tied or k > 0) for k, doubt in enumerate(near))


#: Group (a key of `CODES`; of each and a support the likeliest stays), support, whitened columns
#: (rows, g), what they are per unit of the rig file, and the score (g,) that noise makes by
#: standing in them: 0 where they hold no readings, or their noise cancels over the postures.
Suspect = tuple[str, int, FloatArray, float | FloatArray, FloatArray | float]


def speaking(
    of: Estimate[F], suspects: Sequence[Suspect], *, other: float = 0.0
) -> list[Suspicion]:
    """Ask for every suspect, and return those for whom a test speaks.

    other : share of the level that other tests spend.
    """
    fit, parts, residual = of.fit, of.parts, of.fit.white
    chi2, dof = of.quality.chi2, of.quality.dof
    others = (1 - UNDECLARED_GRAVITY_SHARE - other) / max(1, len(suspects) - 1)
    p, found = int(fit.active.sum()), list[Suspicion]()
    share = dof / max(fit.rows, 1)  # of the noise, that the fit leaves in the residual
    zeros = layout(fit.rig.n)["zero"]
    std = of.uncertainty.parameter_std[zeros]
    std = np.where(np.isfinite(std) & (std > 0), std, np.inf)
    pulled = parts.left.T @ residual - share * parts.root[:p].T @ fit.noise_pull[fit.active]
    for group, index, columns, unit, own in suspects:
        level = UNDECLARED_ERROR * (UNDECLARED_GRAVITY_SHARE if group == "tilt" else others)
        known = parts.left.T @ columns
        score = columns.T @ residual - share * own - known.T @ pulled
        asked = ask_beside(columns.T @ columns, score, known.T)
        p_value = asked.p_value(chi2, dof)
        if p_value > level:
            continue
        # The other parameters, angles among them, give way to what removes the residual.
        move = parts.root[:p] @ (known @ asked.amount)
        size, weight = float(np.abs(asked.amount * unit).max()), asked.weight(fit.rows)
        doubt = suspicion(fit.rig, of.uncertainty, group, index, size, move, p_value, weight)
        moved = np.zeros(len(fit.active))
        moved[fit.active] = move
        shift = np.abs(moved[zeros]) / std
        k = int(np.argmax(shift))
        name = f"{'xyz'[k % 3]} of {fit.rig.supports[k // 3]}"
        found.append(replace(doubt, zero_shift=float(shift[k]), zero=name, move=move))
    return found


def moving_zeros(group: str, columns: FloatArray, unit: float) -> Iterator[Suspect]:
    """Zeros of one sensor after the other, and all of them, that move; columns (rows, n, 3)."""
    for i in range(columns.shape[1]):
        yield group, i, columns[:, i], unit, 0.0
    yield f"all {group}", 0, columns.reshape(len(columns), -1), unit, 0.0


_HOUR = 3600.0


def undeclared_zeros(
    drift: Drift, time: FloatArray, temperature: FloatArray | None
) -> Iterator[tuple[str, FloatArray, float]]:
    """How zeros may move that nobody declared: by what, shape (K, n or 1) of at most 1, unit.

    time : (K,), s. temperature : (K, n), °C, where it is known.
    """
    if drift.walk > 0:
        return
    line = time[:, None]
    if not drift.time > 0:
        yield "drift", _away_from(line[0], line), 1.0
    elif not drift.parabola > 0:
        centred = _away_from(line.mean(axis=0), line) ** 2
        unit = float(np.sqrt(_HOUR / np.ptp(time)))
        yield "parabola", _away_from(centred.mean(axis=0), centred), unit
    if temperature is not None and not drift.temperature > 0:
        warm = _away_from(temperature[0], temperature)
        if np.any(warm):
            yield "temperature", warm, 1.0


def _away_from(start: FloatArray, values: FloatArray) -> FloatArray:
    """Values (K, n) from a start (n,), the largest of a column at 1.

    A zero is stated where it was tared, so that it moves from the first posture on.
    """
    away = values - start
    return np.asarray(away / np.maximum(np.abs(away).max(axis=0), np.finfo(float).tiny))


def stated_suspects(of: Fitted) -> Iterator[Suspect]:
    """What a rig file states, group by group: exact values as columns, others as a shifted prior.

    Nominal mountings that are not as stated, last.
    """
    rig, std, priors = of.rig, of.stated.full_std, len(of.prior_residual)
    place, held = layout(rig.n, of.still.motions), np.isfinite(std) & (std > 0)
    columns = np.pad(of.all_slopes()[:, : len(std)], ((0, priors), (0, 0)))
    columns = np.where(std == 0, columns, 0.0)
    pull = np.where(std == 0, of.noise_pull[: len(std)], 0.0)
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
            dumb = group in ("zero", "sensitivity") and not rig.axes[index].any()
            if np.isfinite(std[part]).any() and not dumb:
                unit = np.where(held[part], std[part], 1.0)
                yield group, index, columns[:, part], unit, pull[part]
                if group == "zero":
                    for j in np.flatnonzero(np.isfinite(std[part]) & rig.axes[index]):
                        own = pull[[start + j]]
                        yield _ZEROS[j], index, columns[:, [start + j]], unit[[j]], own
                if group == "sensitivity":
                    alike = columns[:, start : start + 3].sum(axis=1, keepdims=True)
                    own = pull[start : start + 3].sum(keepdims=True)
                    yield "gain", index, alike, unit[:1], own
        if group == "zero" and held[where].all():  # a tare is made of all at once
            yield "all zero", 0, columns[:, where], std[where], pull[where]
    first = len(columns) - priors + len(of.stated.held)
    for i in range(rig.n):
        own = np.flatnonzero(
            (of.stated.angled // 3 == i) & np.isfinite(rig.rpy_std).ravel()[of.stated.angled]
        )
        if len(own):
            mounted = np.zeros((len(columns), len(own)))
            mounted[first + own, np.arange(len(own))] = 1.0
            yield "mounting", i, mounted, rig.rpy_std.ravel()[of.stated.angled[own]], 0.0
