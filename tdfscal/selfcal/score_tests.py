"""Does the rig file keep something from us? Score tests for what was not declared.

χ² over all residuals dilutes a fault that speaks through a few of them. Each suspect is therefore
asked for by itself: if it were a free parameter, how far would the residuals go to meet it, and by
how much would the angles move? Nothing is fitted anew; the columns are those of the measurement
model (for what is declared as exact), a shift of the prior's value (for what is declared with an
uncertainty), or a zero that drifts over the campaign. Friction of the hinges is no shift but a
scatter, of the moments alone; it is asked for by the variance of the residuals along them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.parameters import layout, prior_std
from tdfscal.model.statics import features_jacobian
from tdfscal.numerics.distributions import chi2_sf, p_text
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import ANGLES, FloatArray
from tdfscal.selfcal.covariance import Quality, Uncertainty
from tdfscal.selfcal.estimator import Fit
from tdfscal.significance import (
    HARMFUL_SHIFT,
    UNDECLARED_ERROR,
    UNDECLARED_FRICTION_SHARE,
    UNDECLARED_GRAVITY_SHARE,
)

_NOISE_ONLY = 1e-9

#: What is wrong with {0}, and its cure; {1} is the size that the residuals ask for.
_WORDS = {
    "zero": (
        "the zero of {0} is not what is stated",
        "tare again, or write `zero.std: {1}` for {0} in rig.yaml",
    ),
    "sensitivity": (
        "gain or crosstalk of {0} is not what is stated",
        "have the sensor of {0} checked, or write `uncertainty.force_sensitivity: {1}` in rig.yaml",
    ),
    "mass": (
        "the mass is not what is stated",
        "weigh again, or write `terminal.mass.std: {1}` in rig.yaml",
    ),
    "barycentre": (
        "the barycentre is not where it is stated",
        "correct it, or write `terminal.barycenter.std: {1}` in rig.yaml",
    ),
    "hinge": (
        "the hinge of {0} is not where it is stated",
        "measure the hinges again, or write `uncertainty.hinge: {1}` in rig.yaml",
    ),
    "datum": (
        "the servo coordinates of {0} are offset",
        "measure the servo datums, or write `uncertainty.datum: {1}` in rig.yaml",
    ),
    "tilt": (
        "gravity is not along -Z of the BCS",
        "level the BCS, or write `gravity.tilt_std: {1}` in rig.yaml",
    ),
    "compliance": (
        "the NCPs give between encoder and hinge",
        "see what is loose, or write `uncertainty.compliance: {{lateral: {1}, vertical: {1}}}` in "
        "rig.yaml",
    ),
    "friction": (
        "the hinges hold back against the turn by which a posture is reached",
        "see whether the hinges move freely, or write `uncertainty.hinge_moment: {1}` in rig.yaml",
    ),
    "scatter": (
        "the moments scatter as friction of {1} N·m in the hinges would make them",
        "see whether the hinges move freely and the NCPs repeat as stated, or write "
        "`uncertainty.hinge_moment: {1}` in rig.yaml",
    ),
    "drift": (
        "the zero of {0} drifts over the campaign",
        "warm up and tare again, or write `drift.time: .inf` in rig.yaml",
    ),
    "temperature": (
        "the zero of {0} follows the temperature",
        "write `drift.temperature: .inf` in rig.yaml",
    ),
    "parabola": (
        "the zero of {0} drifts other than along a line",
        "record faster, or write `drift.walk: {1}` in rig.yaml",
    ),
}
_HOUR = 3600.0
#: Of the misfit, which a cause that is more than scatter explains.
_LARGE_PART = 0.25


@dataclass(frozen=True, slots=True)
class Suspicion:
    """Something that the residuals ask for.

    what, advice : what is wrong, and its cure. p_value : that chance alone asks as much, for this
    suspect alone. shift : largest move of an angle in units of its standard uncertainty.
    angle : which one. gain : fall of χ², where it was asked.
    """

    what: str
    advice: str
    p_value: float
    shift: float
    angle: str
    gain: float = 0.0

    @property
    def harmful(self) -> bool:
        """It would move an angle by more than twice its standard uncertainty."""
        return self.shift > HARMFUL_SHIFT

    @property
    def finding(self) -> str:
        """What is wrong, how surely, and what it does."""
        return (
            f"the residuals say that {self.what} ({p_text(self.p_value)}), which would move "
            f"{self.angle} by {self.shift:.1f} of its standard uncertainties"
        )

    @property
    def text(self) -> str:
        """The finding with its cure."""
        return f"{self.finding}: {self.advice}"


def suspicions(
    fit: Fit,
    parts: Spectrum,
    uncertainty: Uncertainty,
    time: FloatArray,
    stats: Quality,
    temperature: FloatArray | None = None,
) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return them with the surest first, scatter after a cause.

    time : (K,), s, when each posture was held. temperature : (K, n), °C, where it is known.
    """
    root = np.sqrt(fit.weight)[:, None, None] * fit.whitener  # rows of postures left out are 0
    residual = np.concatenate([(root @ fit.residual[..., None]).ravel(), fit.prior_residual])
    suspects = list(_suspects(fit, root, time, temperature))
    others = (1 - UNDECLARED_GRAVITY_SHARE - UNDECLARED_FRICTION_SHARE) / max(1, len(suspects) - 1)
    angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * fit.rig.n)
    std = np.sqrt(np.diagonal(uncertainty.covariance))
    found = []
    for group, index, columns, unit in suspects:
        known = parts.left.T @ columns
        apart = columns - parts.left @ known
        score, information = apart.T @ residual, apart.T @ apart
        values, vectors = np.linalg.eigh(information)
        seen = values > _NOISE_ONLY * max(float(np.sum(columns**2)), np.finfo(float).tiny)
        if not seen.any():
            continue
        along = vectors[:, seen].T @ score
        statistic, size = float(np.sum(along**2 / values[seen])), int(seen.sum())
        # Held against the scatter that remains without the suspect, or it would excuse itself.
        rest = (stats.chi2 - statistic) / max(stats.dof - size, 1)
        p_value = float(chi2_sf(statistic / max(1.0, rest), size))
        share = UNDECLARED_GRAVITY_SHARE if group == "tilt" else others
        if p_value > UNDECLARED_ERROR * share:
            continue
        amount = -vectors[:, seen] @ (along / values[seen])
        # The other parameters, angles among them, give way to the suspect's amount.
        move = -parts.root @ (known @ amount)
        asked = _rounded_up(float(np.abs(amount * unit).max()))
        what, advice = (words.format(fit.rig.supports[index], asked) for words in _WORDS[group])
        doubt = _suspicion(fit, what, advice, p_value, move[angles] / std)
        found.append(replace(doubt, gain=statistic))
    found.sort(key=lambda doubt: (doubt.p_value, -doubt.gain))
    friction, p_value, effect = _friction(fit, parts, root, residual)
    if p_value <= UNDECLARED_ERROR * UNDECLARED_FRICTION_SHARE:
        what, advice = (words.format("", _rounded_up(friction)) for words in _WORDS["scatter"])
        scatter = _suspicion(fit, what, advice, p_value, effect[angles] / std)
        # Whatever is wrong scatters the moments: a cause of a large part of the misfit goes first.
        first = max((doubt.gain for doubt in found), default=0.0)
        found.insert(len(found) if first > _LARGE_PART * (stats.chi2 - stats.dof) else 0, scatter)
    return tuple(found)


def _rounded_up(size: float) -> str:
    """One significant digit, upwards."""
    step = 10.0 ** np.floor(np.log10(max(size, np.finfo(float).tiny)))
    return f"{float(f'{np.ceil(size / step) * step:.1g}'):g}"


def _suspicion(fit: Fit, what: str, advice: str, p_value: float, shift: FloatArray) -> Suspicion:
    """Name the angle that moves most; shift (3n,), in its standard uncertainties."""
    worst = int(np.argmax(np.abs(shift)))
    angle = f"{ANGLES[worst % 3]} of {fit.rig.supports[worst // 3]}"
    return Suspicion(what, advice, p_value, float(np.abs(shift[worst])), angle)


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
    return _suspicion(fit, what, advice, p_value, move[angles] / std)


def _friction(
    fit: Fit, parts: Spectrum, root: FloatArray, residual: FloatArray
) -> tuple[float, float, FloatArray]:
    """Moment per axis and posture (N·m) by the residuals' variance, its p, and what it does (p,).

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
        return 0.0, 1.0, np.zeros(len(parts.root))
    score = float(np.sum(np.einsum("kab,ka->kb", half, residual[:rows].reshape(-1, 6)) ** 2))
    p_value = float(chi2_sf(score * mean / square, mean**2 / square))
    friction = float(np.sqrt(max(score - mean, 0.0) / square))
    # Standard deviation that independent moments of this size give to each parameter.
    moved = parts.root @ seen.reshape(len(seen), -1)
    return friction, p_value, friction * np.linalg.norm(moved, axis=1)


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
    for group, where in place.items():
        if group in ("rotation", "drift"):
            continue
        size = {"zero": 3, "sensitivity": 6, "hinge": 3, "datum": 3}.get(
            group, where.stop - where.start
        )
        for index, start in enumerate(range(where.start, where.stop, size)):
            part = slice(start, start + size)
            if np.isfinite(std[part]).any():
                yield group, index, columns[:, part], np.where(held[part], std[part], 1.0)
    for group, shape in _shapes(fit, time, temperature):
        for i in range(n):
            start = place["zero"].start + 3 * i
            moving = (J[:, :, start : start + 3] * shape[:, i, None, None]).reshape(-1, 3)
            unit = 1.0 if group != "parabola" else np.sqrt(_HOUR / float(np.ptp(time)))
            yield group, i, np.concatenate([moving, np.zeros((len(below), 3))]), unit


def _shapes(
    fit: Fit, time: FloatArray, temperature: FloatArray | None
) -> Iterator[tuple[str, FloatArray]]:
    """How zeros may move that nobody declared, (K, n) at most 1: by what moves them."""
    declared = () if fit.postures.motion is None else fit.postures.motion.kind
    if "walk" in declared:
        return
    n = fit.rig.n
    line = _centred(np.repeat(time[:, None], n, axis=1))
    if "time" not in declared:
        yield "drift", line
    else:
        yield "parabola", _centred(line**2)
    if temperature is not None and "temperature" not in declared:
        warm = _centred(temperature)
        if np.any(warm):
            yield "temperature", warm


def _centred(values: FloatArray) -> FloatArray:
    """Values (K, n) about their mean, the largest of a column at 1."""
    away = values - values.mean(axis=0)
    return np.asarray(away / np.maximum(np.abs(away).max(axis=0), np.finfo(float).tiny))
