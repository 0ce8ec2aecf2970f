"""Propagation of distributions through the tracker's estimator (JCGM 101), in batches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdfscal.numerics import so3
from tdfscal.numerics.alignment import align
from tdfscal.numerics.distributions import INTERVAL_FACTOR, MonteCarlo, propagate
from tdfscal.records import FloatArray, Instrument
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.trackercal.instrument import observe
from tdfscal.trackercal.judged_registration import INSTRUMENT, SurveyFit

_BATCH = 500


def simulate_inputs(
    moves: SurveyFit,
    targets: Sequence[SurveyFit],
    instrument: Instrument,
    misalignment: float,
    rpy_std: FloatArray,
    *,
    trials: int,
    rng: np.random.Generator,
) -> MonteCarlo:
    """Draw all inputs about the estimate, register again, and compare with the linear interval.

    rpy_std : (n, 3), rad, linear standard uncertainty. trials : at most.
    """
    estimate = np.stack([moves.fit.rotation.T @ t.fit.rotation for t in targets])
    to_rpy = so3.rpy_jacobian(estimate) @ moves.fit.rotation.T
    linear = []

    def batch(size: int) -> FloatArray:
        R_b, b = _draw(moves, instrument, rng, size)
        draws = [_draw(t, instrument, rng, size) for t in targets]
        R_s, s = (np.stack(drawn, axis=1) for drawn in zip(*draws, strict=True))
        tilt = misalignment * rng.standard_normal((size, len(targets), 3))
        d = s - b[:, None] + tilt @ moves.fit.rotation.T
        linear.append(np.einsum("nij,tnj->tni", to_rpy, d))
        X = so3.exp(tilt) @ np.swapaxes(R_b, -1, -2)[:, None] @ R_s
        return so3.deviations(X, estimate)

    def draw(size: int) -> FloatArray:
        return np.concatenate([batch(min(_BATCH, size - k)) for k in range(0, size, _BATCH)])

    found = propagate(draw, rpy_std, INTERVAL_COVERAGE, trials)
    half = INTERVAL_FACTOR * rpy_std
    # The linear estimate of the same draws serves as control variate: its ends are known exactly,
    # and the scatter of finitely many trials drops out of the difference.
    same_draws = np.concatenate(linear)
    tails = [(1 - INTERVAL_COVERAGE) / 2, (1 + INTERVAL_COVERAGE) / 2]
    low, high = np.quantile(same_draws, tails, axis=0)
    scatter = np.abs(same_draws.std(axis=0) / rpy_std - 1)
    consistent = bool(np.all(scatter < 5 / np.sqrt(2 * found.trials)))
    return replace(
        found.about(so3.to_rpy(estimate), half),
        validated=consistent and found.validates(low, high),
    )


def _draw(
    survey: SurveyFit, instrument: Instrument, rng: np.random.Generator, count: int
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
    return rotation, np.einsum("pnj,tnj->tp", fit.gain[:3], error)
