"""Noise as the calibration found it, when a later log is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.files.calibration.document import dump_calibration, parse_calibration
from tdfscal.files.calibration.from_results import from_self
from tdfscal.records import Dwells, FloatArray, Rig
from tdfscal.selfcal.estimator import joint_posterior
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.simulation import Faults, Options, Recorder, simulate_dwells
from tdfscal.validation.residual_wrench import Validation, validate
from tdfscal.validation.residuals import AS_STATED, KnownNoise
from tests.reporting.samples import provenance, rig_of

from .held_out import part

STD, USED, HELD, RUNS = 0.3, 24, 5, 8
LOADED = rig_of(3, "Noisy rig")
RIG: Rig = replace(LOADED.rig, declared=replace(LOADED.rig.declared, force_noise=0.0))


def campaigns(noise: FloatArray, faults: Faults | None = None) -> list[Dwells]:
    """Dwells whose means have this noise (RUNS, K, 3, 3), stated with STD."""
    options = Options(
        squeeze=200.0,
        postures=USED + HELD,
        recorder=Recorder(mean_sd=1e-6),
        faults=faults or Faults(),
    )
    batch = simulate_dwells(RIG, options, np.random.default_rng(3), RUNS)
    found = []
    for run in range(RUNS):
        dwells = batch.dwells(run)
        stated = np.broadcast_to(STD**2 * np.eye(3), dwells.force_cov.shape).copy()
        found.append(replace(dwells, force=dwells.force + noise[run], force_cov=stated))
    return found


def unequal() -> FloatArray:
    noise = STD * np.random.default_rng(4).standard_normal((RUNS, USED + HELD, 3, 3))
    noise[:, :, 0] *= 6.0
    return noise


def calibrated(dwells: Dwells) -> SelfCalibration:
    used = part(dwells, np.arange(USED))
    return self_calibrate(RIG, used, rng=np.random.default_rng(0), max_trials=0)


def judged(result: SelfCalibration, dwells: Dwells, known: KnownNoise) -> Validation:
    given = joint_posterior(result.fit, result.uncertainty.covariance)
    return validate(given, part(dwells, np.arange(USED, USED + HELD)), known=known)


@pytest.mark.slow
def test_a_noisy_sensor_that_the_calibration_knows_is_no_change() -> None:
    whole = campaigns(unequal())
    results = [calibrated(dwells) for dwells in whole]
    files = [from_self(result, provenance(LOADED)) for result in results]
    read = [parse_calibration(dump_calibration(f, "json").encode(), "c.json") for f in files]
    holding = without = 0
    for result, dwells, file in zip(results, whole, read, strict=True):
        assert file.fit is not None
        assert file.fit.channel_noise is not None
        factor = np.array(file.fit.channel_noise)
        # Variances from 24 postures, shrunk; along one axis sensors are hard to tell apart.
        assert 3.0 < factor[0].mean() < 9.0
        assert factor[1:].mean() < 2.0
        known = KnownNoise(factor, file.fit.postures)
        holding += judged(result, dwells, known).holds
        without += judged(result, dwells, AS_STATED).holds
    # One false call in 200 is the level.
    assert holding >= RUNS - 1
    assert without <= 1


def test_a_level_from_residuals_widens_the_tail_as_few_of_them_do() -> None:
    rng, dof, freedom = np.random.default_rng(1), 30, 12
    ratio = rng.chisquare(freedom, 200_000) / (rng.chisquare(dof, 200_000) / dof)
    known = KnownNoise(None, 6, 1.5, dof)
    for edge in (20.0, 30.0):
        assert known.chi2_sf(edge, freedom) == pytest.approx(np.mean(ratio > edge), rel=0.1)
        assert AS_STATED.chi2_sf(edge, freedom) < known.chi2_sf(edge, freedom)
