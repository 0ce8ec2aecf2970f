"""One fault of one axis of one sensor at a time: that one is named, and no other dwell is lost."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.checks.faulty_sensors import screen
from tdfscal.findings import Finding
from tdfscal.records import Dwells, FloatArray, LeftOut, Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tests.words import in_words, refusal

K = 10
RIG = replace(simulation.make_rig(), capacity=np.full((3, 3), 5e3))


def sound() -> Dwells:
    """Dwells whose readings scatter by a newton about loads that differ from posture to posture."""
    rng = np.random.default_rng(12)
    force = 500.0 + 300.0 * rng.normal(size=(K, 3, 3))
    return Dwells(
        supports=RIG.supports,
        start=np.arange(float(K)),
        end=np.arange(float(K)) + 0.5,
        position=rng.normal(size=(K, 3, 3)),
        position_cov=np.tile(1e-12 * np.eye(3), (K, 3, 1, 1)),
        force=force,
        force_cov=np.tile(0.01 * np.eye(3), (K, 3, 1, 1)),
        force_min=force - 1.0,
        force_max=force + 1.0,
        count=np.full((K, 3), 100),
        effective=np.full((K, 3), 100.0),
    )


def standing(
    dwells: Dwells, value: float | FloatArray, sensor: int, axis: int, rows: slice
) -> Dwells:
    """The same with an axis that stands at a value in some of the dwells."""
    arrays = {}
    for name in ("force", "force_min", "force_max"):
        arrays[name] = getattr(dwells, name).copy()
        arrays[name][rows, sensor, axis] = value
    return replace(dwells, **arrays)


def kept(rig: Rig, dwells: Dwells) -> list[int]:
    found = screen(rig, dwells)
    assert sorted(found.reasons) == np.flatnonzero(~found.keep).tolist()
    return np.flatnonzero(found.keep).tolist()


@pytest.mark.parametrize(("where", "sign"), [("force_min", -1), ("force_max", 1)])
def test_a_dwell_that_reaches_the_capacity_is_left_out(where: str, sign: int) -> None:
    """Just below it, and where no capacity is stated, it stays."""
    unlimited = replace(RIG, capacity=np.full((3, 3), np.inf))
    for rig, reading, lost in ((RIG, 5e3, [4]), (RIG, 4999.9, []), (unlimited, 5e3, [])):
        peak = getattr(sound(), where).copy()
        peak[4, 1, 2] = sign * reading
        found = screen(rig, replace(sound(), **{where: peak}))
        assert np.flatnonzero(~found.keep).tolist() == list(found.reasons) == lost
        for reason in found.reasons.values():
            assert (reason.code, reason.subject) == ("posture-over-capacity", RIG.supports[1:2])
            assert reason.values["axis"] == "z"


def test_an_axis_that_is_not_measured_may_read_what_it_likes() -> None:
    axes = np.ones((3, 3), dtype=np.bool_)
    axes[1, 2] = False
    rig = replace(RIG, axes=axes)
    for value in (0.0, 6e3):
        assert screen(rig, standing(sound(), value, 1, 2, slice(None))).keep.all()
    quiet = standing(sound(), 7.0, 1, 2, slice(5, None))
    quiet.force[:5, 1, 2] = 8.0
    assert screen(rig, quiet).keep.all()


def test_means_without_samples_are_no_dead_axis() -> None:
    """Averaged postures: extremes are the means, and nothing is known of the scatter."""
    dwells = sound()
    means = replace(
        standing(dwells, 7.0, 2, 0, slice(None)), count=np.zeros((K, 3), dtype=np.int64)
    )
    assert screen(RIG, means).keep.all()


@pytest.mark.parametrize(
    ("value", "low", "high", "code"),
    [
        (5e3, None, None, "axis-saturated"),  # the stated capacity
        (-5e3, None, None, "axis-saturated"),
        (800.0, -200.0, 800.0, "axis-saturated"),  # the end of what the whole log reads
        (-800.0, -800.0, 100.0, "axis-saturated"),
        (300.0, -200.0, 800.0, "axis-frozen"),
        (0.0, 0.0, 800.0, "axis-frozen"),  # not connected in every dwell: the end, but at zero
        (300.0, 300.0, 300.0, "channel-dead"),
        (0.0, None, None, "channel-dead"),
    ],
)
def test_one_reading_in_every_posture_is_saturated_frozen_or_dead(
    value: float, low: float | None, high: float | None, code: str
) -> None:
    dwells = standing(sound(), value, 0, 1, slice(None))
    if low is not None and high is not None:
        reach = np.tile(np.array([low, high])[:, None, None], (1, 3, 3))
        dwells = replace(dwells, force_range=reach)
    lost = (LeftOut(20.0, 21.0, Finding("stop-too-short")),) * 3
    finding = refusal(screen, RIG, replace(dwells, left_out=lost))
    assert (finding.code, finding.subject) == (code, RIG.supports[:1])
    assert finding.values["axis"] == ["y"]
    assert (finding.values["postures"], finding.values["left_out"]) == (K, 3)
    if code == "channel-dead":
        assert "`axes: [x, z]`" in in_words([finding])[0]


LATE = list(range(7))
ALONE = [0, 1, 2, 3, 5, 6, 7, 8, 9]


@pytest.mark.parametrize(
    ("rows", "count", "left"),
    [
        (slice(7, None), 100, LATE),
        (slice(2, None), 100, [0, 1]),
        (slice(4, 5), 100, ALONE),
        (slice(4, 5), 8, ALONE),
        (slice(4, 5), 7, list(range(K))),  # too few samples to tell
    ],
)
def test_dwells_without_scatter_are_frozen(rows: slice, count: int, left: list[int]) -> None:
    dwells = standing(sound(), 300.0, 1, 1, rows)
    assert kept(RIG, replace(dwells, count=np.full((K, 3), count))) == left


@pytest.mark.parametrize(
    ("value", "code"), [(9999.0, "posture-frozen"), (1500.0, "posture-saturated")]
)
def test_a_code_of_a_lost_reading_is_no_range(value: float, code: str) -> None:
    """Far beyond all other readings; told as it was read, and when."""
    dwells = standing(sound(), value, 1, 1, slice(4, 5))
    reach = np.array([dwells.force_min.min(axis=0), dwells.force_max.max(axis=0)])
    (found,) = screen(
        replace(RIG, capacity=np.full((3, 3), np.inf)), replace(dwells, force_range=reach)
    ).reasons.values()
    assert found.code == code
    assert (found.values["reading"], found.values["time"]) == (value, [4.0, 4.5])
    assert f"{value:g} N, between 4" in in_words([found])[0]


def test_a_coarse_resolution_is_no_frozen_axis() -> None:
    """Six dwells of ten show one number, each its own: the noise hides below a digit."""
    dwells = sound()
    for k in (0, 2, 3, 5, 6, 8):
        dwells = standing(dwells, 100.0 * k, 1, 1, slice(k, k + 1))
    assert screen(RIG, dwells).keep.all()


@pytest.mark.parametrize("squeeze", [300.0, 800.0])
def test_how_much_a_reading_is_cut_off_and_what_squeeze_it_bears(squeeze: float) -> None:
    """By the balance of the others; what was cut off is known from the same campaign without."""

    def played(rig: Rig, size: float, *, saturated: bool) -> Dwells:
        options = simulation.Options(
            postures=24, squeeze=size, faults=simulation.Faults(saturated=saturated)
        )
        return simulation.simulate_dwells(rig, options, np.random.default_rng(4), 1).dwells(0)

    free = played(simulation.make_rig(), squeeze, saturated=False)
    reached = np.maximum(np.abs(free.force_max), np.abs(free.force_min))
    largest = np.sort(reached[:, 1, 1])
    capacity = np.full((3, 3), np.inf)
    capacity[1, 1] = largest[-4]  # three of 24 postures exceed it, and one stands at it
    rig = replace(simulation.make_rig(), capacity=capacity)
    (found,) = range_findings(rig, played(rig, squeeze, saturated=True))
    assert (found.code, found.subject, found.values["axis"]) == ("range-exceeded", ("ncp2",), "y")
    assert found.size == pytest.approx(largest[-1], rel=5e-3)
    share = float(str(found.values["share"]).rstrip("%")) / 100
    less = played(rig, squeeze * share, saturated=True)
    assert np.abs(less.force[:, 1, 1]).max() == pytest.approx(largest[-4], rel=0.05)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.7, 1.0])
def test_a_range_that_nobody_states_shows_where_many_dwells_stand_at_its_end(share: float) -> None:
    options = simulation.Options(postures=24, squeeze=500.0)
    free = simulation.simulate_dwells(RIG, options, np.random.default_rng(4), 1).dwells(0)
    limit = float(np.quantile(np.abs(free.force[:, 1, 1]), 1 - share))
    names = ("force", "force_min", "force_max")
    clipped = {name: getattr(free, name).copy() for name in names}
    for value in clipped.values():
        value[:, 1, 1] = np.clip(value[:, 1, 1], -limit, limit)
        value[3, 1, 1] *= 1 + 1e-11  # as sums round it
    unstated = replace(RIG, capacity=np.full((3, 3), np.inf))
    reached = np.maximum(np.abs(free.force_min), np.abs(free.force_max))[:, 1, 1] >= limit
    found = screen(unstated, replace(free, **clipped))
    assert np.array_equal(~found.keep, reached)
    assert {reason.code for reason in found.reasons.values()} == {"posture-saturated"}
    assert screen(unstated, free).reasons == {}
    # Readings in steps have dwells without scatter too, anywhere.
    coarse = {name: 200.0 * np.round(getattr(free, name) / 200.0) for name in names}
    spoilt = screen(unstated, replace(free, **coarse)).reasons.values()
    assert "posture-saturated" not in {reason.code for reason in spoilt}


def range_findings(rig: Rig, dwells: Dwells) -> list[Finding]:
    found = self_calibrate(rig, dwells, rng=np.random.default_rng(0), max_trials=0)
    return [finding for finding in found.findings if finding.code == "range-exceeded"]
