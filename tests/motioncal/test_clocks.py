"""Forces and positions by clocks that run apart: the rate is found and costs nothing."""

from dataclasses import replace

from tdfscal.model.dynamics import CLOCK_RATE, RATE
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Series
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, distance, played

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
