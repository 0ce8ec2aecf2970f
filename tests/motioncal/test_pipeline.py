"""From slow streams to a judged result: contacts, refusals, and what is stated of it."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tdfscal.catalogue import cure
from tdfscal.errors import DataError, NotIdentifiableError
from tdfscal.findings import Finding
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import BoolArray, FloatArray, Log, Series, UncertainValue
from tdfscal.simulation.moving_campaign import MovingCampaign
from tdfscal.simulation.options import MovingOptions, Touch
from tests.motioncal.campaigns import DELAY, distance, played
from tests.words import in_words

#: A rig file that states no delay, and no inertia.
NOTHING = UncertainValue(np.array(0.0), np.array(np.inf))
MINUTE = MovingOptions(rate=100.0, noise=1.1)


@cache
def calibrated(options: MovingOptions, seed: int = 5) -> tuple[MovingCampaign, MotionCalibration]:
    campaign, slow, _ = played(options, seed)
    return campaign, calibrate_moving(campaign.rig, slow, NOTHING)


def within(campaign: MovingCampaign, result: MotionCalibration) -> bool:
    rotation, covariance = result.fit.state.still.rotation, result.uncertainty.covariance
    return bool(distance(campaign, rotation, covariance) < chi2_quantile(1 - 1e-3, 9))


def test_a_static_rig_file_calibrates_in_motion_and_a_contact_costs_little() -> None:
    campaign, clean = calibrated(MINUTE)
    assert within(campaign, clean)
    assert clean.reasons == ()
    assert clean.rejected == ()
    touch = Touch(30.0, 33.0, (9.0, -6.0, 10.0))
    campaign, touched = calibrated(replace(MINUTE, touches=(touch,)))
    (left_out,) = touched.rejected
    assert left_out.begin == pytest.approx(30.0, abs=1.5)
    assert left_out.end == pytest.approx(33.0, abs=1.5)
    assert within(campaign, touched)
    rms = [np.sqrt(np.mean(r.uncertainty.rpy_std**2)) for r in (clean, touched)]
    assert rms[1] < 1.3 * rms[0]
    shares = sum(clean.uncertainty.contributions.values())
    variance = np.diagonal(clean.uncertainty.rpy_covariance, axis1=1, axis2=2)
    assert shares == pytest.approx(variance, rel=1e-6)


def test_a_clock_that_jumps_ahead_is_told_from_a_pause() -> None:
    campaign, _, _ = played(MINUTE, 5)
    log = campaign.log

    def seen(keep: Callable[[FloatArray], BoolArray], late: float) -> MotionCalibration:
        def cut(series: Series) -> Series:
            kept = keep(series.time)
            time = series.time[kept]
            return Series(time + late * (time >= 30.0), series.value[kept])

        parts = Log(log.supports, tuple(map(cut, log.position)), force=tuple(map(cut, log.force)))
        return calibrate_moving(campaign.rig, slow_streams([parts], campaign.rig.capacity), NOTHING)

    jumped = seen(lambda time: time >= 0.0, 5.0)
    paused = seen(lambda time: (time < 30.0) | (time >= 35.0), 0.0)
    for result, word in ((jumped, "clock of all streams jumped"), (paused, "recording paused")):
        assert within(campaign, result)
        (named,) = [text for text in in_words(result.findings) if "no stream has a sample" in text]
        assert word in named
        assert "from 29.9" in named or "from 30.0" in named
    assert not any("no stream" in text for text in in_words(calibrated(MINUTE)[1].findings))


@pytest.mark.parametrize(
    ("options", "error", "word"),
    [
        (replace(MINUTE, quantum=1e-4), DataError, "steps of 100 µm"),
        (
            replace(MINUTE, duration=30.0, travel=0.0, tilt=0.0, squeeze=0.0),
            NotIdentifiableError,
            "yaw",
        ),
        (replace(MINUTE, duration=3.0), DataError, "no stretch"),
        (replace(MINUTE, rate=1.0, frequency=0.4), DataError, "faster"),
    ],
    ids=["rounded positions", "stands still", "too short", "recorded too slowly"],
)
def test_unusable_logs_say_why(options: MovingOptions, error: type[Exception], word: str) -> None:
    with pytest.raises(error, match=word):
        calibrated(options)


def test_positions_that_fall_behind_from_the_middle_on_are_refused() -> None:
    campaign, slow, _ = played(MINUTE, 5)
    half, lag = len(slow.time) // 2, 2  # 0.1 s
    position = slow.position.copy()
    position[half + lag :] = slow.position[half:-lag]
    with pytest.raises(DataError, match="delay"):
        calibrate_moving(campaign.rig, replace(slow, position=position), NOTHING)


def test_a_dead_axis_and_a_frozen_position_are_named() -> None:
    campaign, slow, _ = played(MINUTE, 5)
    force = slow.force.copy()
    force[:, 1, 2] = force[0, 1, 2] * (1 + 3e-16 * (np.arange(len(force)) % 2))
    with pytest.raises(DataError, match=r"z axis of the sensor of ncp2 .* dead"):
        calibrate_moving(campaign.rig, replace(slow, force=force), NOTHING)
    for stuck in ([1], [0, 1, 2]):
        position = slow.position.copy()
        position[600:700, stuck] = position[600, stuck]
        result = calibrate_moving(campaign.rig, replace(slow, position=position), NOTHING)
        assert [s.reason.subject for s in result.rejected] == [(f"ncp{i + 1}",) for i in stuck]
        assert "position of ncp2 is frozen" in " ".join(in_words(s.reason for s in result.rejected))
        for s in result.rejected:
            assert (s.begin, s.end) == pytest.approx((slow.time[594], slow.time[705]), abs=0.01)
        assert within(campaign, result)


@pytest.mark.parametrize(
    ("support", "axis", "reading", "begin", "end", "seed"),
    [
        (0, 2, 0.0, 30.0, 31.0, 0),
        (1, 0, 1e9, 10.0, 15.0, 5),
        (2, 1, -9e3, 20.0, 20.6, 5),
        (1, 2, 0.0, 1.0, 2.0, 0),
    ],
)
def test_a_channel_that_drops_out_is_named_as_that_alone(
    support: int, axis: int, reading: float, begin: float, end: float, seed: int
) -> None:
    """No contact beside it, nor elsewhere; a brief offset is one contact, where it is."""
    campaign, _, _ = played(MINUTE, seed)
    for dropped in (True, False)[: 2 if end - begin <= 1.0 else 1]:
        force = [Series(s.time, s.value.copy()) for s in campaign.log.force]
        own = (force[support].time >= begin) & (force[support].time < end)
        value = force[support].value[own, axis]
        force[support].value[own, axis] = reading if dropped else value + 500.0
        log = replace(campaign.log, force=tuple(force))
        slow = slow_streams([log], campaign.rig.capacity)
        result = calibrate_moving(campaign.rig, slow, NOTHING)
        (left_out,) = result.rejected
        assert left_out.reason.code == ("stretch-frozen" if dropped else "stretch-touched")
        assert left_out.reason.values.get("axis", ["xyz"[axis]]) == ["xyz"[axis]]
        ends = pytest.approx((begin, end), abs=0.2 if dropped else 1.0)
        assert (left_out.begin, left_out.end) == ends
        assert within(campaign, result)


def test_moments_of_no_noise_are_told_from_positions_that_scatter() -> None:
    campaign, slow, _ = played(MINUTE, 5)
    assert calibrated(MINUTE)[1].reasons == ()
    # An inertial force that acts 0.3 m above the barycentre, shared out among the sensors.
    place = slow.position.mean(axis=1)
    pushed = 500.0 * np.gradient(np.gradient(place, slow.step, axis=0), slow.step, axis=0)
    moment = np.cross([0.0, 0.0, 0.3], pushed)
    arm = slow.position.mean(axis=0) - place.mean(axis=0)
    levers = np.concatenate(
        [[*np.eye(3)[:, a], *np.cross(r, np.eye(3)[a])] for r in arm for a in range(3)]
    )
    share = np.linalg.pinv(levers.reshape(-1, 6).T)[:, 3:]
    force = slow.force + (moment @ share.T).reshape(slow.force.shape)
    found = calibrate_moving(campaign.rig, replace(slow, force=force), NOTHING)
    (reason,) = [finding for finding in found.reasons if finding.code == "moments-unlike-noise"]
    assert reason.size is not None
    assert reason.size > 10 * campaign.rig.declared.positioner


def _times(finding: Finding) -> tuple[float, float]:
    between = finding.values["between"]
    assert isinstance(between, list)
    return float(between[0]), float(between[1])


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("size", [2e-3, 10e-3])
def test_a_sensor_that_turned_on_the_way_is_told_with_its_time(share: float, size: float) -> None:
    campaign, slow, _ = played(MINUTE, 5)
    first = int(share * len(slow.time))
    turned = slow.force.copy()
    turned[first:, 1] = turned[first:, 1] @ so3.exp(np.array([size, 0.0, 0.0])).T
    found = calibrate_moving(campaign.rig, replace(slow, force=turned), NOTHING)
    reason, *alike = found.reasons
    assert (reason.code, reason.subject) == ("sensor-slipped", ("ncp2",))
    assert {cause.code for cause in alike} <= {"zero-jumped"}
    begin, end = _times(reason)
    assert begin - 0.05 <= slow.time[first] <= end + 0.05
    assert end - begin < 0.5
    change = campaign.truth.rotation[1] @ [-size, 0.0, 0.0]
    found_change, half = (np.array(reason.values[name]) for name in ("change", "change_95"))
    assert np.all(np.abs(found_change - change) < 2.0 * half)


def test_a_small_turn_is_named_before_the_drift_that_it_resembles() -> None:
    """Among all instants chance finds as much once in 3,000 logs; beside a drift it is likelier."""
    campaign, slow, _ = played(MovingOptions(rate=100.0), 114)
    force, later = slow.force.copy(), slow.time > 39.6
    force[later, 2] = force[later, 2] @ so3.exp(np.array([-5.1e-4, 5.1e-4, 6.9e-4])).T
    found = calibrate_moving(campaign.rig, replace(slow, force=force), DELAY)
    cause = found.suspicions[0].causes[0]
    assert (cause.code, cause.subject) == ("sensor-slipped", ("ncp3",))


def test_the_rest_may_be_what_was_touched() -> None:
    touch = Touch(5.0, 55.0, (9.0, -6.0, 10.0))
    _, found = calibrated(MovingOptions(rate=100.0, touches=(touch,)))
    assert {reason.code for reason in found.reasons} >= {"rest-touched", "motion-left-out"}


@pytest.mark.parametrize("true", ["sensor-slipped", "zero-jumped"])
def test_where_a_turn_and_a_jump_fit_alike_both_are_named(true: str) -> None:
    """Under a load that hardly turns in the sensor they are one."""
    campaign, slow, _ = played(MovingOptions.approach(), 14)
    later, force = slow.time > 9.9, slow.force.copy()
    if true == "sensor-slipped":
        force[later, 1] = force[later, 1] @ so3.exp(np.array([3e-3, 0.0, 0.0])).T
    else:
        force[later, 1, 1] -= 5.0
    found = calibrate_moving(campaign.rig, replace(slow, force=force), NOTHING)
    named = found.reasons
    assert {cause.code for cause in named} == {"sensor-slipped", "zero-jumped"}
    assert (true, ("ncp2",)) in [(cause.code, cause.subject) for cause in named]
    assert all(begin <= 9.95 <= end + 0.05 for begin, end in map(_times, named))


def test_a_zero_that_jumped_is_told_from_one_that_drifts() -> None:
    campaign, slow, _ = played(MINUTE, 6)
    jumped, drifting = slow.force.copy(), slow.force.copy()
    jumped[slow.time > 40.0, 2, 0] += 1.5
    drifting[:, 1, 1] += 10.0 * (slow.time - slow.time[0]) / np.ptp(slow.time)
    found = calibrate_moving(campaign.rig, replace(slow, force=jumped), NOTHING)
    cause = found.suspicions[0].causes[0]
    assert (cause.code, cause.subject) == ("zero-jumped", ("ncp3",))
    begin, end = _times(cause)
    assert begin <= 40.1 <= end + 0.1
    until, since = (float(re.findall(rf"--{end} (\S+)", cure(cause))[0]) for end in ("to", "from"))
    assert until <= begin < end <= since  # neither part holds any of the jump
    found = calibrate_moving(campaign.rig, replace(slow, force=drifting), NOTHING)
    cause = found.reasons[0]
    assert cause.code == "zero-drift"
    assert cause.size == pytest.approx(10.0, rel=0.05)
