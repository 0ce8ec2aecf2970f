"""Does the rig file keep something from us? Score tests for what was not declared.

χ² over all residuals dilutes a fault that speaks through a few of them. Each suspect is therefore
asked for by itself: if it were a free parameter, how far would the residuals go to meet it, and by
how much would the angles move? Nothing is fitted anew; the columns are those of the measurement
model (for what is declared as exact), a shift of the prior's value (for what is declared with an
uncertainty), or a zero that drifts over the campaign. Friction of the hinges is no shift but a
scatter, of the moments alone; it is asked for by the variance of the residuals along them.

One fault makes many suspects. Those that a test has spoken for are held against each other, against
all kinds of noise (`scatter`) and zeros that wander (`wandering`), by how far −2 ln L falls less
q ln N for q unknowns and N residuals (Schwarz, Ann. Stat. 6, 1978); the likeliest is named, and
those that are about as likely.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tdfscal.model.parameters import State, layout, prior_std
from tdfscal.model.statics import features_jacobian
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import ANGLES, BoolArray, FloatArray, Rig
from tdfscal.selfcal.covariance import Quality, Uncertainty
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.noise_bias import noise_scores
from tdfscal.selfcal.scatter import Scatter, scatters
from tdfscal.selfcal.suspicion import OF_THE_RIG, WORDS, Suspicion
from tdfscal.selfcal.wandering import wanderings
from tdfscal.significance import (
    CAUSES_APART,
    MISFIT,
    UNDECLARED_ERROR,
    UNDECLARED_FRICTION_SHARE,
    UNDECLARED_GRAVITY_SHARE,
)

_NOISE_ONLY = 1e-9
#: Groups whose columns are made of the noisy readings themselves, beside the turns.
MADE_OF_READINGS = ("sensitivity", "gain", "compliance")
_HOUR = 3600.0


def suspicions(
    fit: Fit,
    parts: Spectrum,
    uncertainty: Uncertainty,
    time: FloatArray,
    stats: Quality,
    temperature: FloatArray | None = None,
) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely.

    time : (K,), s, when each posture was held. temperature : (K, n), °C, where it is known.
    """
    root = np.sqrt(fit.weight)[:, None, None] * fit.whitener  # rows of postures left out are 0
    residual = np.concatenate([(root @ fit.residual[..., None]).ravel(), fit.prior_residual])
    suspects = list(_suspects(fit, root, time, temperature))
    others = (1 - UNDECLARED_GRAVITY_SHARE - UNDECLARED_FRICTION_SHARE) / max(1, len(suspects) - 1)
    angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * fit.rig.n)
    std = np.sqrt(np.diagonal(uncertainty.covariance))
    found, worth = list[Suspicion](), float(np.log(max(fit.rows, 2)))
    bias: FloatArray | None = None
    for group, index, columns, unit in suspects:
        known = parts.left.T @ columns
        apart = columns - parts.left @ known
        share = UNDECLARED_GRAVITY_SHARE if group == "tilt" else others
        asked = ask(apart, columns, residual, np.zeros(columns.shape[1]))
        if asked is None or asked.p_value(stats) > UNDECLARED_ERROR * share:
            continue
        if group in MADE_OF_READINGS:
            bias = noise_scores(fit, root) if bias is None else bias
            lean = lean_of(bias, fit.active, fit.state, group, index)
            asked = ask(apart, columns, residual, lean)
            if asked is None or asked.p_value(stats) > UNDECLARED_ERROR * share:
                continue
        amount, p_value = asked.amount, asked.p_value(stats)
        # The other parameters, angles among them, give way to the suspect's amount.
        move = -parts.root @ (known @ amount)
        size = rounded_up(float(np.abs(amount * unit).max()))
        what, advice = (words.format(fit.rig.supports[index], size) for words in WORDS[group])
        doubt = suspicion(fit, what, advice, p_value, move[angles] / std)
        support = None if group in OF_THE_RIG else index
        zero_shift, zero = worst_zero(fit, move, uncertainty)
        doubt = replace(doubt, zero_shift=zero_shift, zero=zero)
        weight = asked.statistic - asked.unknowns * worth
        found.append(replace(doubt, kind=group, support=support, weight=weight))
    p_value = _friction(parts, root, residual)
    if p_value <= UNDECLARED_ERROR * UNDECLARED_FRICTION_SHARE or stats.p_value < MISFIT:
        noises = scatters(fit, parts, root, residual)
        found += [_scattered(fit, uncertainty, scatter) for scatter in noises]
    if found:
        found += wandering(fit, parts, uncertainty, time)
    return likeliest(found)


def wandering(
    fit: Fit, parts: Spectrum, uncertainty: Uncertainty, time: FloatArray
) -> tuple[Suspicion, ...]:
    """Return the zeros that seem to wander, where something has spoken that a walk may be behind.

    time : (K,), s, when each posture was held.
    """
    root = np.sqrt(fit.weight)[:, None, None] * fit.whitener
    residual = np.concatenate([(root @ fit.residual[..., None]).ravel(), fit.prior_residual])
    walks = wanderings(fit, parts, root, residual, time)
    return tuple(
        _scattered(fit, uncertainty, walk, float(np.sqrt(_HOUR))) for walk in walks if walk.gain > 0
    )


def _scattered(
    fit: Fit, uncertainty: Uncertainty, scatter: Scatter, unit: float = 1.0
) -> Suspicion:
    """Put a variance that the residuals ask for into words; unit : of the rig file, in SI."""
    angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * fit.rig.n)
    std = np.sqrt(np.diagonal(uncertainty.covariance))
    name, size = fit.rig.supports[scatter.support or 0], rounded_up(unit * scatter.size)
    what, advice = (words.format(name, size) for words in WORDS[scatter.kind])
    p_value = float(chi2_sf(scatter.gain, 1)) / 2  # without it θ stands at its bound
    doubt = suspicion(fit, what, advice, p_value, scatter.effect[angles] / std)
    weight = scatter.gain - float(np.log(max(fit.rows, 2)))
    return replace(doubt, kind=scatter.kind, support=scatter.support, weight=weight)


class Asking(Protocol):
    """What a score test needs of a fit: its rig, and which parameters were free (P,)."""

    @property
    def rig(self) -> Rig:
        """The rig."""

    @property
    def active(self) -> BoolArray:
        """Which parameters were free."""


@dataclass(frozen=True, slots=True)
class Asked:
    """How far the residuals go to meet a suspect: fall of χ², unknowns seen, their amount."""

    statistic: float
    unknowns: int
    amount: FloatArray

    def p_value(self, stats: Quality) -> float:
        """Held against the scatter that remains without the suspect, or it would excuse itself."""
        rest = (stats.chi2 - self.statistic) / max(stats.dof - self.unknowns, 1)
        return float(chi2_sf(self.statistic / max(1.0, rest), self.unknowns))


def ask(
    apart: FloatArray, columns: FloatArray, residual: FloatArray, lean: FloatArray
) -> Asked | None:
    """Score of columns, `apart` of them beyond the fit's; lean : the score that noise makes."""
    score, information = apart.T @ residual - lean, apart.T @ apart
    values, vectors = np.linalg.eigh(information)
    seen = values > _NOISE_ONLY * max(float(np.sum(columns**2)), np.finfo(float).tiny)
    if not seen.any():
        return None
    along = vectors[:, seen].T @ score
    amount = -vectors[:, seen] @ (along / values[seen])
    return Asked(float(np.sum(along**2 / values[seen])), int(seen.sum()), amount)


def lean_of(
    bias: FloatArray, active: BoolArray, state: State, group: str, index: int
) -> FloatArray:
    """Score that noise alone makes of a suspect's columns; none where it has a prior."""
    place = layout(state.n, state.motions)
    if group == "compliance":
        part = place["compliance"]
    else:
        start = place["sensitivity"].start + 6 * index
        part = slice(start, start + 6)
    own = np.where(active[part], 0.0, bias[part])
    return np.asarray(own[:3].sum(keepdims=True) if group == "gain" else own)


def likeliest(found: list[Suspicion]) -> tuple[Suspicion, ...]:
    """The likeliest suspicion, and those that are about as likely."""
    ranked = sorted(found, key=lambda doubt: -doubt.weight)
    near = [doubt for doubt in ranked if ranked[0].weight - doubt.weight < CAUSES_APART]
    return tuple(replace(doubt, tied=k > 0) for k, doubt in enumerate(near))


def rounded_up(size: float) -> str:
    """One significant digit, upwards."""
    step = 10.0 ** np.floor(np.log10(max(size, np.finfo(float).tiny)))
    return f"{float(f'{np.ceil(size / step) * step:.1g}'):g}"


def suspicion(fit: Asking, what: str, advice: str, p_value: float, shift: FloatArray) -> Suspicion:
    """Name the angle that moves most; shift (3n,), in its standard uncertainties."""
    worst = int(np.argmax(np.abs(shift)))
    angle = f"{ANGLES[worst % 3]} of {fit.rig.supports[worst // 3]}"
    return Suspicion(what, advice, p_value, float(np.abs(shift[worst])), angle)


def worst_zero(fit: Asking, move: FloatArray, uncertainty: Uncertainty) -> tuple[float, str]:
    """Largest move of a zero in its standard uncertainties, by free parameters; and which one."""
    place, full = layout(fit.rig.n)["zero"], np.zeros(len(fit.active))
    full[fit.active] = move
    std = uncertainty.parameter_std[place]
    known = np.isfinite(std) & (std > 0)
    size = np.where(known, np.abs(full[place]) / np.where(known, std, 1.0), 0.0)
    worst = int(np.argmax(size))
    return float(size[worst]), f"{'xyz'[worst % 3]} of {fit.rig.supports[worst // 3]}"


def largest_move(
    fit: Fit,
    parts: Spectrum,
    uncertainty: Uncertainty,
    wrench: FloatArray,
    *,
    what: str,
    advice: str,
    p_value: float,
) -> Suspicion:
    """Suspicion of what adds a wrench (K, 6) to the balance; the angles give way to it."""
    root = np.sqrt(fit.weight)[:, None, None] * fit.whitener
    white = (root @ wrench[..., None]).ravel()
    move = parts.root @ (parts.left[: len(white)].T @ white)
    angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * fit.rig.n)
    std = np.sqrt(np.diagonal(uncertainty.covariance))
    return suspicion(fit, what, advice, p_value, move[angles] / std)


def _friction(parts: Spectrum, root: FloatArray, residual: FloatArray) -> float:
    """Probability that noise as stated makes the moments scatter as they do.

    The score r' H H' r of a variance component, whitened columns H, is a sum of χ²; it is held
    against the gamma distribution of its mean and variance (Satterthwaite, Biometrics 2, 1946).
    """
    half = root[:, :, 3:]  # H's blocks, one per posture
    rows = 6 * len(root)
    seen = np.einsum("kap,kab->pkb", parts.left[:rows].reshape(*root.shape[:2], -1), half)
    own = np.swapaxes(half, 1, 2) @ half
    known = np.einsum("pkb,qkb->pq", seen, seen)
    # M = H'H − (U'H)'(U'H): its trace, and that of its square.
    mean = float(np.sum(half**2) - np.trace(known))
    overlap = np.einsum("kab,kab->", own, np.einsum("pka,pkb->kab", seen, seen))
    square = float(np.sum(own**2) - 2 * overlap + np.sum(known**2))
    if square <= _NOISE_ONLY * np.sum(own**2):
        return 1.0
    score = float(np.sum(np.einsum("kab,ka->kb", half, residual[:rows].reshape(-1, 6)) ** 2))
    return float(chi2_sf(score * mean / square, mean**2 / square))


def _suspects(
    fit: Fit, root: FloatArray, time: FloatArray, temperature: FloatArray | None
) -> Iterator[tuple[str, int, FloatArray, float | FloatArray]]:
    """Group, support, whitened columns (rows, g) of each suspect, and what they are per unit."""
    rig, n = fit.rig, fit.rig.n
    motion = fit.postures.motion
    std, place = prior_std(rig, motion), layout(n, fit.state.motions)
    J = root @ (fit.at.design @ features_jacobian(fit.state, fit.at, rig.gravity))
    data, exact, held = J.reshape(-1, J.shape[-1]), std == 0, np.isfinite(std) & (std > 0)
    below = np.zeros((len(fit.prior_residual), data.shape[1]))
    for row, parameter in enumerate(np.flatnonzero(held)):  # a value moved by one standard dev.
        below[row, parameter] = 1.0
    columns = np.concatenate([np.where(exact, data, 0.0), np.where(exact, 0.0, below)])
    yield from stated_suspects(rig, columns, std, fit.state.motions)
    for group, shape in _shapes(fit, time, temperature):
        moved = J[:, :, place["zero"]].reshape(len(J), 6, n, 3) * shape[:, None, :, None]
        size = 1.0 if group != "parabola" else float(np.sqrt(_HOUR / np.ptp(time)))
        for i in range(n):
            yield group, i, _padded(moved[:, :, i], below), size
        yield f"all {group}", 0, _padded(moved, below), size


def stated_suspects(
    rig: Rig, columns: FloatArray, std: FloatArray, motions: int
) -> Iterator[tuple[str, int, FloatArray, float | FloatArray]]:
    """What a rig file states, group by group: columns (rows, P), prior's std (P,)."""
    place, held = layout(rig.n, motions), np.isfinite(std) & (std > 0)
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


def _padded(columns: FloatArray, below: FloatArray) -> FloatArray:
    """Columns (K, 6, ...) as (rows, g), with zeros in the prior's rows."""
    flat = columns.reshape(columns.shape[0] * 6, -1)
    return np.concatenate([flat, np.zeros((len(below), flat.shape[1]))])


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
