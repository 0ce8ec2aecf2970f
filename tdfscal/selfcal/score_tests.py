"""Does the rig file keep something from us? Score tests for what was not declared.

χ² over all residuals dilutes a fault that speaks through a few of them. Each suspect is therefore
asked for by itself: if it were a free parameter, how far would the residuals go to meet it, and by
how much would the angles move? Nothing is fitted anew; the columns are those of the measurement
model (for what is declared as exact), a shift of the prior's value (for what is declared with an
uncertainty), or a zero that drifts over the campaign. Friction of the hinges is no shift but a
scatter, of the moments alone; it is asked for by the variance of the residuals along them.

One fault makes many suspects. Those that a test has spoken for are held against each other, against
all kinds of noise and zeros that wander (`scatter`), by how far −2 ln L falls less q ln N for q
unknowns and N residuals (Schwarz, Ann. Stat. 6, 1978); the likeliest is named, and
those that are about as likely.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.parameters import State, layout, prior_std, rpy_prior_std
from tdfscal.model.statics import balance, features_jacobian
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.selfcal.covariance import Estimate, Quality
from tdfscal.selfcal.estimator import ROWS, Fit
from tdfscal.selfcal.scatter import chance, scatters, wandering
from tdfscal.selfcal.suspicion import Suspicion, likeliest, suspicion, worst_zero
from tdfscal.significance import (
    MISFIT,
    UNDECLARED_ERROR,
    UNDECLARED_FRICTION_SHARE,
    UNDECLARED_GRAVITY_SHARE,
)

#: Share of the columns' size below which what stands out of the fit's is rounding, and of a
#: component below which no direction that stands out has it.
_NOISE_ONLY, _BLIND = 1e-9, 1e-6
#: Groups whose columns are made of the noisy readings themselves, beside the turns.
MADE_OF_READINGS = ("sensitivity", "gain", "compliance")
_HOUR = 3600.0
#: Group, support, whitened columns (rows, g), and what they are per unit of the rig file.
Suspect = tuple[str, int, FloatArray, float | FloatArray]


def suspicions(
    of: Estimate, time: FloatArray, temperature: FloatArray | None = None
) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely.

    time : (K,), s, when each posture was held. temperature : (K, n), °C, where it is known.
    """
    fit, parts, residual = of.fit, of.parts, of.fit.white
    suspects = list(_suspects(fit, time, temperature))
    others = (1 - UNDECLARED_GRAVITY_SHARE - UNDECLARED_FRICTION_SHARE) / max(1, len(suspects) - 1)
    found, bias = list[Suspicion](), None
    for group, index, columns, unit in suspects:
        level = UNDECLARED_ERROR * (UNDECLARED_GRAVITY_SHARE if group == "tilt" else others)
        known = parts.left.T @ columns
        apart = columns - parts.left @ known
        asked = ask(apart, columns, residual)
        if group in MADE_OF_READINGS and asked.p_value(of.quality) <= level:
            bias = noise_scores(fit) if bias is None else bias
            lean = lean_of(bias, fit.active, fit.state, group, index)
            asked = ask(apart, columns, residual, lean)
        p_value = asked.p_value(of.quality)
        if p_value > level:
            continue
        # The other parameters, angles among them, give way to the suspect's amount.
        move = -parts.root @ (known @ asked.amount)
        size, weight = float(np.abs(asked.amount * unit).max()), asked.weight(fit.rows)
        doubt = suspicion(fit.rig, of.uncertainty, group, index, size, move, p_value, weight)
        zero_shift, zero = worst_zero(fit.rig, of.uncertainty, fit.active, move)
        found.append(replace(doubt, zero_shift=zero_shift, zero=zero))
    if (
        chance(fit.root[:, :, 3:], parts, residual) <= UNDECLARED_ERROR * UNDECLARED_FRICTION_SHARE
        or of.quality.p_value < MISFIT
    ):
        found += scatters(of)
    if found:
        found += wandering(of, time)
    return likeliest(found)


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


def noise_scores(fit: Fit) -> FloatArray:
    """Expected scores (P,) of all parameters by the noise of the readings alone.

    A column c(f) of the model, made of readings f with noise ν, has the expected score
    E[cᵀ W e] = Σ_a σ_a² (∂c/∂f_a)ᵀ W (∂e/∂f_a) although its parameter is 0. The turns of the
    sensors are free of it where the noise is isotropic (theory, section 3); gains and the
    compliance are not, and with many noisy postures it passes for one.
    """
    state, g, root, seen = fit.state, fit.rig.gravity, fit.root, fit.at.seen
    by_state = features_jacobian(state, fit.at, g)
    std = np.sqrt(np.diagonal(seen.force_cov, axis1=2, axis2=3))  # (K, n, 3)
    total = np.zeros(by_state.shape[1])
    for i, a in np.argwhere(seen.measured):
        force = seen.force.copy()
        force[:, i, a] += std[:, i, a]
        moved = balance(replace(seen, force=force), state, fit.at.centre, g)
        change = root @ ((moved.design - fit.at.design) @ by_state)
        shift = root @ (fit.at.noise_force[:, i, :, a] * std[:, i, a, None])[..., None]
        total += np.einsum("kap,ka->p", change, shift[..., 0])
    return np.asarray(total * fit.dof / max(fit.rows, 1))


def lean_of(
    bias: FloatArray, active: BoolArray, state: State, group: str, index: int
) -> FloatArray:
    """Score that noise alone makes of a suspect's columns; none where it has a prior."""
    place = layout(state.n, state.motions)
    part = place["compliance"]
    if group != "compliance":
        start = place["sensitivity"].start + 6 * index
        part = slice(start, start + 6)
    own = np.where(active[part], 0.0, bias[part])
    return np.asarray(own[:3].sum(keepdims=True) if group == "gain" else own)


def _suspects(fit: Fit, time: FloatArray, temperature: FloatArray | None) -> Iterator[Suspect]:
    """What the rig file states, and zeros that move."""
    rig, K, priors = fit.rig, len(fit.weight), len(fit.prior_residual)
    columns = np.pad(fit.slopes.reshape(ROWS * K, -1), ((0, priors), (0, 0)))
    std = prior_std(rig, fit.postures.motion)
    yield from stated_suspects(rig, columns, std, fit.state.motions, priors)
    yield from _mountings(rig, len(columns))
    zeros = columns[:, layout(rig.n)["zero"]].reshape(-1, rig.n, 3)
    for group, shape in _shapes(fit, time, temperature):
        size = 1.0 if group != "parabola" else float(np.sqrt(_HOUR / np.ptp(time)))
        each = np.pad(np.repeat(shape, ROWS, axis=0), ((0, priors), (0, 0)))
        yield from moving_zeros(group, zeros * each[..., None], size)


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


def _mountings(rig: Rig, rows: int) -> Iterator[Suspect]:
    """Nominal mountings that are not as stated; the last of the rows are the angles' priors."""
    if rig.earlier is not None:
        return
    angled = np.flatnonzero(np.isfinite(rpy_prior_std(rig)))
    for i in range(rig.n):
        own = np.flatnonzero((angled // 3 == i) & np.isfinite(rig.rpy_std).ravel()[angled])
        if len(own):
            shifted = np.zeros((rows, len(own)))
            shifted[rows - len(angled) + own, np.arange(len(own))] = 1.0
            yield "mounting", i, shifted, rig.rpy_std.ravel()[angled[own]]


def _shapes(
    fit: Fit, time: FloatArray, temperature: FloatArray | None
) -> Iterator[tuple[str, FloatArray]]:
    """How zeros may move that nobody declared, (K, n) at most 1: by what moves them."""
    declared = () if fit.postures.motion is None else fit.postures.motion.kind
    if "walk" in declared:
        return
    n = fit.rig.n
    line = np.repeat(time[:, None], n, axis=1)
    if "time" not in declared:
        yield "drift", _away_from(line[0], line)
    elif "parabola" not in declared:
        centred = _away_from(line.mean(axis=0), line) ** 2
        yield "parabola", _away_from(centred.mean(axis=0), centred)
    if temperature is not None and "temperature" not in declared:
        warm = _away_from(temperature[0], temperature)
        if np.any(warm):
            yield "temperature", warm


def _away_from(start: FloatArray, values: FloatArray) -> FloatArray:
    """Values (K, n) from a start (n,), the largest of a column at 1.

    A zero is stated where it was tared, so that it moves from the first posture on.
    """
    away = values - start
    return np.asarray(away / np.maximum(np.abs(away).max(axis=0), np.finfo(float).tiny))
