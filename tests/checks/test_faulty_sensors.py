"""One fault of one axis of one sensor at a time: that one is named, and no other dwell is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.checks.faulty_sensors import check_unmeasured, screen
from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.records import BoolArray, Dwells, FloatArray, LeftOut, Rig
from tests.words import in_words

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


def test_sound_sensors_lose_nothing() -> None:
    found = screen(RIG, sound())
    assert found.keep.all()
    assert found.reasons == {}


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("where", ["force_min", "force_max"])
def test_a_dwell_that_reaches_the_capacity_is_left_out(sign: int, where: str) -> None:
    dwells = sound()
    peak = getattr(dwells, where).copy()
    peak[4, 1, 2] = sign * 5e3
    found = screen(RIG, replace(dwells, **{where: peak}))
    assert np.flatnonzero(~found.keep).tolist() == [4]
    assert "z axis" in in_words([found.reasons[4]])[0]
    assert RIG.supports[1] in in_words([found.reasons[4]])[0]
    # Just below it, and where no capacity is stated, it stays.
    peak[4, 1, 2] = sign * 4999.9
    assert screen(RIG, replace(dwells, **{where: peak})).keep.all()
    peak[4, 1, 2] = sign * 5e3
    unlimited = replace(RIG, capacity=np.full((3, 3), np.inf))
    assert screen(unlimited, replace(dwells, **{where: peak})).keep.all()


def test_an_axis_that_is_not_measured_may_read_what_it_likes() -> None:
    axes = np.ones((3, 3), dtype=np.bool_)
    axes[1, 2] = False
    rig = replace(RIG, axes=axes)
    for value in (0.0, 6e3):
        assert screen(rig, standing(sound(), value, 1, 2, slice(None))).keep.all()
    quiet = standing(sound(), 7.0, 1, 2, slice(5, None))
    quiet.force[:5, 1, 2] = 8.0
    assert screen(rig, quiet).keep.all()


@pytest.mark.parametrize("value", [0.0, 431.0])
def test_a_dead_axis_is_refused_by_its_name(value: float) -> None:
    with pytest.raises(DataError) as refused:
        screen(RIG, standing(sound(), value, 2, 0, slice(None)))
    assert f"the x axis of the sensor of {RIG.supports[2]}" in refused.value.what
    assert "dead" in refused.value.what
    assert refused.value.exit_status == 3
    assert "`axes: [y, z]`" in str(refused.value.hint)


def test_means_without_samples_are_no_dead_axis() -> None:
    """Averaged postures: extremes are the means, and nothing is known of the scatter."""
    dwells = sound()
    means = replace(
        standing(dwells, 7.0, 2, 0, slice(None)), count=np.zeros((K, 3), dtype=np.int64)
    )
    assert screen(RIG, means).keep.all()


@pytest.mark.parametrize(
    ("value", "low", "high", "word"),
    [
        (5e3, None, None, "saturated"),  # the stated capacity
        (-5e3, None, None, "saturated"),
        (800.0, -200.0, 800.0, "saturated"),  # the end of what the whole log reads
        (-800.0, -800.0, 100.0, "saturated"),
        (300.0, -200.0, 800.0, "frozen"),
        (0.0, 0.0, 800.0, "frozen"),  # not connected in every dwell: the end, but at zero
        (300.0, 300.0, 300.0, "dead"),
    ],
)
def test_one_reading_in_every_posture_is_saturated_frozen_or_dead(
    value: float, low: float | None, high: float | None, word: str
) -> None:
    dwells = standing(sound(), value, 0, 1, slice(None))
    if low is not None and high is not None:
        reach = np.tile(np.array([low, high])[:, None, None], (1, 3, 3))
        dwells = replace(dwells, force_range=reach)
    with pytest.raises(DataError) as refused:
        screen(RIG, dwells)
    assert word in refused.value.what
    assert f"the y axis of the sensor of {RIG.supports[0]}" in refused.value.what
    assert "10 postures" in refused.value.what or word == "dead"
    some = replace(dwells, left_out=(LeftOut(20.0, 21.0, Finding("stop-too-short")),) * 3)
    with pytest.raises(DataError) as refused:
        screen(RIG, some)
    assert "3 more" in refused.value.what or word == "dead"


def test_an_axis_that_freezes_is_left_out_from_there_on() -> None:
    assert kept(RIG, standing(sound(), 300.0, 1, 1, slice(7, None))) == list(range(7))
    assert kept(RIG, standing(sound(), 300.0, 1, 1, slice(2, None))) == [0, 1]


def test_single_dwells_without_scatter_are_frozen_where_the_others_have_some() -> None:
    assert kept(RIG, standing(sound(), 300.0, 1, 1, slice(4, 5))) == [0, 1, 2, 3, 5, 6, 7, 8, 9]


def test_a_coarse_resolution_is_no_frozen_axis() -> None:
    """Six dwells of ten show one number, each its own: the noise hides below a digit."""
    dwells = sound()
    for k in (0, 2, 3, 5, 6, 8):
        dwells = standing(dwells, 100.0 * k, 1, 1, slice(k, k + 1))
    assert screen(RIG, dwells).keep.all()
    # And with too few samples to tell, no dwell is called frozen.
    few = replace(standing(sound(), 300.0, 1, 1, slice(4, 5)), count=np.full((K, 3), 7))
    assert screen(RIG, few).keep.all()
    enough = replace(few, count=np.full((K, 3), 8))
    assert kept(RIG, enough) == [0, 1, 2, 3, 5, 6, 7, 8, 9]


def lacking() -> BoolArray:
    axes = np.ones((3, 3), dtype=np.bool_)
    axes[0, 2] = False
    return axes


@pytest.mark.parametrize(
    ("reading", "noise", "follows"),
    [
        (5.0, 1.0, False),
        (9.9, 0.1, False),
        (10.2, 0.1, True),
        (50.0, 5.1, False),
        (50.0, 4.9, True),
    ],
)
def test_an_axis_called_unmeasured_that_follows_the_load(
    reading: float, noise: float, follows: bool
) -> None:
    """A tenth of what the others vary by, 100 N here, and ten times its own noise."""
    scatter = np.full((3, 3), 100.0)
    scatter[1] = [20.0, 100.0, 300.0]
    scatter[0, 2] = reading
    level = np.full((3, 3), noise)
    if follows:
        with pytest.raises(DataError) as refused:
            check_unmeasured(RIG.supports, lacking(), scatter=scatter, noise=level)
        assert f"the z axis of the sensor of {RIG.supports[0]}" in refused.value.what
    else:
        check_unmeasured(RIG.supports, lacking(), scatter=scatter, noise=level)


def test_a_log_whose_unmeasured_axis_follows_is_refused() -> None:
    with pytest.raises(DataError, match="declared as not measured"):
        screen(replace(RIG, axes=lacking()), sound())
