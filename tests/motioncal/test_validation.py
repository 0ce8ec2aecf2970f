"""Does a calibration still hold, asked of a terminal that never stops."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tdfscal.errors import DataError
from tdfscal.motioncal.pipeline import MotionCalibration, calibrate_moving
from tdfscal.motioncal.streams import Slow, slow_streams
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.reporting.changes import changes
from tdfscal.simulation import reference_rig
from tdfscal.simulation.moving_campaign import MovingCampaign, simulate_moving
from tdfscal.simulation.options import MovingOptions, Touch
from tdfscal.simulation.truth import Truth
from tdfscal.validation.in_motion import MovingValidation, validate_moving
from tests.motioncal.campaigns import DELAY, played
from tests.words import in_words, refusal

MINUTE = MovingOptions(rate=100.0, noise=1.1, slow_noise=0.3)


@cache
def before() -> tuple[MovingCampaign, MotionCalibration]:
    campaign, slow, _ = played(MINUTE, 11)
    return campaign, calibrate_moving(campaign.rig, slow, DELAY)


def recorded_later(duration: float = 30.0, seed: int = 13) -> Slow:
    """A later motion of the machine as it was."""
    campaign, _ = before()
    options = replace(MINUTE, duration=duration, inertia=campaign.inertia)
    later = simulate_moving(campaign.rig, options, np.random.default_rng(seed), campaign.truth)
    return slow_streams([later.log], campaign.rig.capacity)


def validated(
    change: Callable[[Truth], Truth] = lambda truth: truth,
    options: MovingOptions = MINUTE,
    seed: int = 12,
) -> MovingValidation:
    """A later motion of the same machine, with one change of it."""
    campaign, result = before()
    rig = reference_rig()
    later = simulate_moving(
        rig,
        replace(options, inertia=campaign.inertia),
        np.random.default_rng(seed),
        change(campaign.truth),
    )
    return validate_moving(result.calibrated, slow_streams([later.log], rig.capacity), DELAY)


def test_an_unchanged_rig_is_still_valid() -> None:
    v = validated()
    assert v.holds
    assert v.suspected == ()
    assert v.rejected == ()
    assert v.seconds == pytest.approx(60.0, abs=0.5)
    assert np.all(v.residual.after[:, 0] < 0.1 * v.residual.before[:, 0].max())


@pytest.mark.parametrize(
    ("matrix", "exchange"),
    [
        (np.diag([-1.0, 1.0, 1.0]), "the opposite sign of Fx of ncp2"),
        (np.diag([-1.0, -1.0, 1.0]), "the opposite sign of Fx and Fy of ncp2"),
        (np.eye(3)[[1, 0, 2]], "Fx and Fy of ncp2 exchanged"),
    ],
)
def test_readings_of_another_name_or_sign_are_no_noise(matrix: FloatArray, exchange: str) -> None:
    slow = recorded_later()
    force = slow.force.copy()
    force[:, 1] = force[:, 1] @ matrix.T
    given = before()[1].calibrated
    found = refusal(validate_moving, given, replace(slow, force=force), DELAY)
    assert found.values["exchange"] == exchange


def test_whole_supports_exchanged_are_named_at_once_in_motion() -> None:
    (campaign, result), slow = before(), recorded_later()
    order = [1, 0, 2]
    slow = replace(slow, force=slow.force[:, order], position=slow.position[:, order])
    for judge in (
        lambda: validate_moving(result.calibrated, slow, DELAY),
        lambda: calibrate_moving(campaign.rig, slow, DELAY),
    ):
        with pytest.raises(DataError, match="ncp1 taken from ncp2") as caught:
            judge()
        assert caught.value.finding.values["whole"]


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_a_sensor_that_turns_on_the_way_is_told_with_its_time_and_turn(share: float) -> None:
    """Of the whole log it would be a part of the turn, or no change at all."""
    (campaign, result), slow = before(), recorded_later(MINUTE.duration, 12)
    turn, first = np.array([3e-3, 0.0, 0.0]), int(share * len(slow.time))
    force = slow.force.copy()
    force[first:, 1] = force[first:, 1] @ so3.exp(turn).T
    v = validate_moving(result.calibrated, replace(slow, force=force), DELAY)
    assert not v.holds
    cause, *others = v.suspected
    assert others == []
    assert (cause.kind, cause.support) == ("sensor slipped", 1)
    assert cause.between is not None
    assert cause.between[0] - 0.05 <= slow.time[first] <= cause.between[1] + 0.05
    assert np.all(np.abs(cause.value + campaign.truth.rotation[1] @ turn) < 4 * cause.std)
    assert "ncp2 turned by" in in_words(changes(v))[0]


@pytest.mark.parametrize(("begin", "end"), [(20.0, 40.0), (0.0, 25.0), (10.0, 48.0)])
def test_a_contact_that_lasts_is_left_out_and_blames_no_sensor(begin: float, end: float) -> None:
    touch = Touch(begin, end, (30.0, -20.0, 50.0), (8.0, -5.0, 4.0))
    later = replace(MINUTE, touches=(touch,))
    v = validated(options=later)
    assert v.holds
    result = calibrate_moving(reference_rig(), played(later, 12)[1], DELAY)
    for found in (v, result):
        (left_out,) = found.rejected
        assert (left_out.begin, left_out.end) == pytest.approx((begin, end), abs=1.0)
        assert left_out.reason.size == pytest.approx(np.linalg.norm(touch.force), rel=0.05)
    assert [finding.code for finding in result.reasons] == ["motion-left-out"]


def turned(truth: Truth) -> Truth:
    rotation = truth.rotation.copy()
    rotation[1] = so3.exp(np.array([1.5e-3, -1.2e-3, 0.6e-3])) @ rotation[1]
    return replace(truth, rotation=rotation)


def jumped(truth: Truth) -> Truth:
    zero = truth.zero.copy()
    zero[2, 0] += 3.0
    return replace(truth, zero=zero)


def loaded(truth: Truth) -> Truth:
    shift = np.array([1e-3, 0.0, 0.0])
    return replace(truth, mass=truth.mass + 1.0, barycentre=truth.barycentre + shift)


def test_a_zero_that_jumped_is_told_as_zeros_that_moved() -> None:
    """Angles, load and gain hold; the zero that jumped is the one that moved most."""
    v = validated(jumped)
    assert v.holds
    assert v.zeros.moved
    assert np.argmax(np.abs(v.zeros.change) / v.zeros.change_std) == 3 * 2 + 0
    assert abs(v.zeros.change[2, 0] - 3.0) < 4 * v.zeros.change_std[2, 0]


@pytest.mark.parametrize(
    ("change", "kind", "support", "amount"),
    [
        (turned, "sensor turned", 1, [1.5e-3, -1.2e-3, 0.6e-3]),
        (loaded, "load changed", None, [1.0, 1e-3, 0.0, 0.0]),
    ],
    ids=["turned", "load"],
)
def test_one_change_is_found_and_named_with_its_size(
    change: Callable[[Truth], Truth], kind: str, support: int | None, amount: list[float]
) -> None:
    v = validated(change)
    assert not v.holds
    (cause,) = v.suspected
    assert (cause.kind, cause.support) == (kind, support)
    assert np.all(np.abs(cause.value - amount) < 4 * cause.std)
