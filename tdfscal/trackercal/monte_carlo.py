"""Propagation of distributions through the tracker's estimator (JCGM 101), in batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.numerics import so3
from tdfscal.numerics.alignment import align
from tdfscal.numerics.distributions import coverage_factor
from tdfscal.records import FloatArray, Instrument
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.trackercal.instrument import observe
from tdfscal.trackercal.judged_registration import INSTRUMENT, SurveyFit

_BATCH = 500


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Distribution of roll, pitch, yaw (n, 3), rad, with all inputs perturbed about the estimate.

    low, high : probabilistically symmetric interval of `coverage`. tolerance : (n, 3), numerical
    tolerance δ of JCGM 101, 7.9.2, for one significant digit of the standard uncertainty.
    sample : (trials, n, 3), deviations from the estimate.
    validated : whether both ends of the linear interval are within δ (clause 8).
    """

    trials: int
    coverage: float
    mean: FloatArray
    std: FloatArray
    low: FloatArray
    high: FloatArray
    tolerance: FloatArray
    sample: FloatArray
    validated: bool


def simulate_inputs(
    moves: SurveyFit,
    targets: Sequence[SurveyFit],
    instrument: Instrument,
    misalignment: float,
    gains: tuple[FloatArray, Sequence[FloatArray]],
    rpy_std: FloatArray,
    *,
    trials: int,
    rng: np.random.Generator,
) -> MonteCarlo:
    """Draw all inputs about the estimate, register again, and compare with the linear interval.

    gains : (3, N, 3) of the moves' residuals and per support of the targets', rotation in the
    measured frame. rpy_std : (n, 3), rad, linear standard uncertainty.
    """
    estimate = np.stack([moves.fit.rotation.T @ t.fit.rotation for t in targets])
    reference = so3.to_rpy(estimate)
    to_rpy = so3.rpy_jacobian(estimate) @ moves.fit.rotation.T
    angles, linear = [], []
    for first in range(0, trials, _BATCH):
        count = min(_BATCH, trials - first)
        R_b, b = _draw(moves, instrument, gains[0], rng, count)
        draws = [
            _draw(t, instrument, g, rng, count) for t, g in zip(targets, gains[1], strict=True)
        ]
        R_s = np.stack([R for R, _ in draws], axis=1)
        tilt = misalignment * rng.standard_normal((count, len(targets), 3))
        X = so3.exp(tilt) @ np.swapaxes(R_b, -1, -2)[:, None] @ R_s
        angles.append(so3.deviations(X, estimate))
        d = np.stack([s for _, s in draws], axis=1) - b[:, None] + tilt @ moves.fit.rotation.T
        linear.append(np.einsum("nij,tnj->tni", to_rpy, d))
    drawn, same_draws = np.concatenate(angles), np.concatenate(linear)
    tails = [(1 - INTERVAL_COVERAGE) / 2, (1 + INTERVAL_COVERAGE) / 2]
    low, high = np.quantile(drawn, tails, axis=0)
    # The linear estimate of the same draws serves as control variate: its ends are known exactly,
    # and the scatter of finitely many trials drops out of the difference.
    shift = np.array([low, high]) - np.quantile(same_draws, tails, axis=0)
    tolerance = 0.5 * 10.0 ** np.floor(np.log10(rpy_std))
    scatter = np.abs(same_draws.std(axis=0) / rpy_std - 1)
    consistent = bool(np.all(scatter < 5 / np.sqrt(2 * trials)))
    return MonteCarlo(
        trials=trials,
        coverage=INTERVAL_COVERAGE,
        mean=reference + drawn.mean(axis=0),
        std=drawn.std(axis=0, ddof=1),
        low=reference + low,
        high=reference + high,
        tolerance=tolerance,
        sample=drawn,
        validated=consistent and bool(np.all(np.abs(shift) <= tolerance)),
    )


def linear_interval(rpy: FloatArray, rpy_std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Interval rpy ± k rpy_std of `INTERVAL_COVERAGE`, (n, 3) each, rad."""
    k = float(coverage_factor(INTERVAL_COVERAGE))
    return rpy - k * rpy_std, rpy + k * rpy_std


def _draw(
    survey: SurveyFit,
    instrument: Instrument,
    gain: FloatArray,
    rng: np.random.Generator,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Rotations (count, 3, 3) of perturbed points, and their linear perturbations (count, 3)."""
    fit, noise = survey.fit, survey.noise
    x = fit.adjusted
    y = x @ fit.rotation.T + fit.translation[survey.group]
    shape = (count, len(x), 3)
    none = np.zeros((len(x), 3, 3))
    by_instrument = sum((noise.measured.get(source, none) for source in INSTRUMENT), none)
    others = sum((cov for s, cov in noise.measured.items() if s not in INSTRUMENT), none)
    sighted = np.any(by_instrument, axis=(1, 2))[:, None]
    seen = np.where(sighted, observe(y, instrument, rng, count), y)
    seen = seen + rng.standard_normal(shape) * np.sqrt(np.diagonal(others, axis1=1, axis2=2))
    C, D = noise.totals(len(x))
    known = x + rng.standard_normal(shape) * np.sqrt(np.diagonal(D, axis1=1, axis2=2))
    start = np.broadcast_to(fit.rotation, (count, 3, 3))
    rotation = align(seen, known, C, D, survey.group, start=start).rotation
    error = seen - y - (known - x) @ fit.rotation.T
    return rotation, np.einsum("pnj,tnj->tp", gain, error)
