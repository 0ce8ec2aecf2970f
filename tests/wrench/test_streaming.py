"""Logs in pieces, of different rates, with gaps: the same wrench as in one piece."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tdfscal.model.samples_in_motion import Samples, Tally, aligned
from tdfscal.records import FloatArray, Log, Series, UncertainValue
from tdfscal.wrench.contact_wrench import Wrenches, at_rest, in_motion

from .held_out import RIG, world

GIVEN = world(1).given[0]
NAMES = RIG.supports


def line(time: FloatArray, support: int, kind: int) -> Series:
    """A straight line in time: linear interpolation meets it exactly."""
    base = RIG.hinge[support] if kind == 0 else np.array([10.0, -20.0, 1600.0 + support])
    slope = (1e-3 if kind == 0 else 5.0 * (support + 1)) * np.array([1.0, -2.0, 0.5])
    return Series(time, base + time[:, None] * slope)


def log(position_rate: float, force_rate: float, start: float, end: float) -> Log:
    p = np.arange(np.ceil(start * position_rate), end * position_rate) / position_rate
    f = np.arange(np.ceil(start * force_rate), end * force_rate) / force_rate
    return Log(
        NAMES, tuple(line(p, i, 0) for i in range(3)), tuple(line(f, i, 1) for i in range(3))
    )


def pieces(position_rate: float, force_rate: float, cuts: list[float]) -> Iterator[Log]:
    for a, b in pairwise(cuts):
        yield log(position_rate, force_rate, a, b)


def joined(parts: Iterator[Samples]) -> Samples:
    found = list(parts)
    return Samples(
        *(np.concatenate([getattr(s, n) for s in found]) for n in Samples.__match_args__)
    )


def values(parts: Iterator[Wrenches]) -> tuple[FloatArray, FloatArray]:
    found = list(parts)
    time = np.concatenate([p.time for p in found])
    return time, np.concatenate([p.value for p in found])


def test_positions_are_interpolated_across_the_borders_of_pieces() -> None:
    tally = Tally()
    found = joined(aligned(pieces(50.0, 333.0, [0.0, 0.31, 0.32, 0.9, 2.0]), tally))
    assert np.all(np.diff(found.time) > 0)
    # Every force sample up to the last position is there, once.
    expected = np.arange(np.floor(1.98 * 333.0) + 1) / 333.0
    assert np.array_equal(found.time, expected)
    for i in range(3):
        assert np.abs(found.position[:, i] - line(found.time, i, 0).value).max() < 1e-12
        assert np.abs(found.force[:, i] - line(found.time, i, 1).value).max() < 1e-9
    assert tally.used == len(expected)
    assert tally.used + tally.uncovered == int(np.ceil(2.0 * 333.0))


def test_pieces_give_what_the_whole_gives() -> None:
    def moving(position: FloatArray, time: FloatArray) -> FloatArray:
        swing = np.sin(3 * time)[:, None] * np.array([0.02, 0.01, -0.006])
        return np.asarray(position + swing)

    def shaken(parts: Iterator[Log]) -> Iterator[Log]:
        for part in parts:
            series = tuple(Series(s.time, moving(s.value, s.time)) for s in part.position)
            yield replace(part, position=series)

    rig = replace(GIVEN.rig, inertia=UncertainValue.exact(np.diag([60.0, 70.0, 90.0])))
    given = replace(GIVEN, rig=rig)
    whole, cut = [0.0, 4.0], [0.0, 0.05, 0.9, 1.0, 1.01, 2.2, 4.0]
    for stage in (at_rest, in_motion):
        t1, v1 = values(stage(given, aligned(shaken(pieces(200.0, 200.0, whole)), Tally())))
        t2, v2 = values(stage(given, aligned(shaken(pieces(200.0, 200.0, cut)), Tally())))
        assert np.array_equal(t1, t2)
        assert len(t1) == 800
        # Poses are good to 1e-10 rad; their second derivative by 5 ms steps to some 1e-7 rad/s².
        assert np.abs(v1 - v2).max() < 1e-4
    at_rest_v = values(at_rest(given, aligned(shaken(pieces(200.0, 200.0, whole)), Tally())))[1]
    assert np.abs(v1 - at_rest_v).max() > 50.0
