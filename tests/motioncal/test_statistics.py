"""What is stated covers: angles, spectrum, clocks that run apart, zeros that drift."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tdfscal.commands.calibrate import calibrate_samples
from tdfscal.commands.campaign import resolve
from tdfscal.commands.log_pass import LogPass, Settings
from tdfscal.estimation.uncertainty import estimate
from tdfscal.files.writers.campaign import write_run
from tdfscal.model.dynamics import CLOCK_RATE, PARAMETERS, RATE
from tdfscal.model.parameters import layout
from tdfscal.motioncal.estimator import fit_moving
from tdfscal.motioncal.fit import MovingFit, MovingPriors
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Drift, Series
from tdfscal.simulation import MOVING, reference_rig, run
from tdfscal.simulation.faults import Drift as Creep
from tdfscal.simulation.faults import Faults, Warming
from tdfscal.simulation.moving_campaign import MovingCampaign
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, distance, played, true_state


def fitted(options: MovingOptions, seed: int) -> tuple[MovingCampaign, MovingFit]:
    campaign, slow, cut = played(options, seed)
    return campaign, fit_moving(MovingPriors(campaign.rig, slow, DELAY), cut, true_state(campaign))


@pytest.fixture(scope="module")
def minute() -> tuple[MovingCampaign, MovingFit]:
    return fitted(MovingOptions(), 3)


def test_a_minute_of_motion_says_how_well(minute: tuple[MovingCampaign, MovingFit]) -> None:
    campaign, fit = minute
    assert fit.converged
    found = estimate(fit)
    known = found.uncertainty
    moving_std = known.parameter_std[-PARAMETERS:]
    away = distance(campaign, fit.state.still.rotation, known.covariance)
    assert chi2_quantile(1e-3, 9) < away < chi2_quantile(1 - 1e-3, 9)
    std = np.sqrt(np.diag(known.covariance))
    assert 0.07e-3 < std.mean() < 0.13e-3
    truth = true_state(campaign).moving.vector
    assert np.all(np.abs(fit.state.moving.vector - truth) < 4 * moving_std)
    assert moving_std[7] < 1e-3 < abs(fit.state.moving.delay)  # 5 ms were seen


def test_the_spectrum_is_that_of_the_noise(minute: tuple[MovingCampaign, MovingFit]) -> None:
    _, fit = minute
    density, _ = fit.noise.density(np.array([0.7, 1.5, 2.5]))
    assert density == pytest.approx(1.75**2 / 250, rel=0.25)


FOUR_MINUTES = MovingOptions(duration=240.0, rate=40.0, noise=0.7)


def calibrated(rate: float) -> tuple[MotionCalibration, float]:
    """Result of a log whose force clock runs fast by `rate`, and d² of its nine turns."""
    campaign, _, _ = played(FOUR_MINUTES, 5)
    late = tuple(Series(s.time * (1 + rate), s.value) for s in campaign.log.force)
    slow = slow_streams([replace(campaign.log, force=late)], campaign.rig.capacity)
    result = calibrate_moving(campaign.rig, slow, DELAY)
    rotation = result.fit.state.still.rotation
    return result, distance(campaign, rotation, result.uncertainty.covariance)


def test_clocks_that_run_apart_are_followed() -> None:
    """60 ppm over four minutes are 14 ms, of which the halves' delays tell 7."""
    rate = 6e-5
    result, away = calibrated(rate)
    moving, std = result.fit.state.moving, result.moving_std
    assert result.rate_told
    assert std[RATE] < 0.3 * CLOCK_RATE
    assert abs(moving.rate - rate) < 4 * std[RATE]
    assert abs(moving.delay - (0.005 + 120.0 * rate)) < 4 * std[RATE - 1]
    assert away < chi2_quantile(1 - 1e-3, 9)


SLOPES = ((0.15, -0.1, 0.2), (0.0, 0.2, -0.15), (-0.1, 0.1, 0.1))


def test_zeros_follow_the_hall_and_the_hour(tmp_path: Path) -> None:
    """10 K and 3 N of creep in a minute; both are declared, and found within their uncertainty."""
    rig = replace(reference_rig(), drift=Drift(temperature=1.0, time=0.1))
    faults = Faults(warming=Warming(10.0, SLOPES), drifts=(Creep(2, (3.0, -2.0, 3.0)),))
    options = replace(MOVING["motion"], rate=100.0, faults=faults)
    played = run(rig, "motion", options, np.random.default_rng(5))
    write_run(played, tmp_path / "warm", format="mcap")
    log = LogPass(resolve(tmp_path / "warm"), Settings(trials=0))
    motion = calibrate_samples(log, None, "ml", np.random.default_rng(0))
    assert isinstance(motion, MotionCalibration)
    assert (motion.reasons, motion.suspicions) == ((), ())
    std = motion.uncertainty.parameter_std[layout(3, 2)["drift"]].reshape(2, 3, 3)
    found = motion.fit.state.still.drift
    true = np.zeros((2, 3, 3))
    true[0, 2] = np.array([3.0, -2.0, 3.0]) / options.duration
    true[1] = SLOPES
    assert np.all(std[1] < 0.5)
    assert np.all(np.abs(found - true) < 4 * std)
    assert played.moving is not None
    rotation, covariance = motion.fit.state.still.rotation, motion.uncertainty.covariance
    assert distance(played.moving, rotation, covariance) < chi2_quantile(1 - 1e-3, 9)
