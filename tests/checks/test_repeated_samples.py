"""Samples that are there twice are found by their noise; sound logs of all kinds hold none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from tdfscal.checks.repeated_samples import RepeatedSamples, counted_once
from tdfscal.dwells import find_dwells
from tdfscal.records import FloatArray, Log, Series
from tdfscal.simulation import make_rig
from tests.dwells.rig_log import Recipe, record
from tests.words import in_words

RIG = make_rig()
SHIFT = 0.37  # s, of a copy's clock beyond the end of the first


def joined(*logs: Log) -> Iterator[Log]:
    """Logs one after the other, each by a clock that goes on."""
    begin = 0.0
    for log in logs:
        yield replace(
            log,
            position=tuple(Series(s.time + begin, s.value) for s in log.position),
            force=tuple(Series(s.time + begin, s.value) for s in log.force),
        )
        begin += float(log.force[0].time[-1]) + SHIFT


def changed(log: Log, change: Callable[[FloatArray], FloatArray]) -> Log:
    return replace(log, force=tuple(Series(s.time, change(s.value)) for s in log.force))


def begins(*logs: Log) -> list[list[float]]:
    """Per sensor the begin of each stretch that is there twice, s."""
    looking = RepeatedSamples(RIG)
    for log in logs:
        looking.add(log)
    found = looking.found()
    return [[r.begin for r in found if r.sensor == i] for i in range(RIG.n)]


def held(value: FloatArray) -> FloatArray:
    """Readings of a slow sensor, held by a fast recorder."""
    return np.asarray(np.repeat(value[::5], 5, axis=0)[: len(value)])


def hum(value: FloatArray) -> FloatArray:
    """An interference that the samples are exactly in step with, and no noise that they resolve."""
    wave = np.tile([0.0, 3.0, 5.0, 3.0, 0.0, -3.0, -5.0, -3.0], 1 + len(value) // 8)[: len(value)]
    return np.asarray(wave[:, None] + np.array([100.0, 200.0, 300.0]))


@pytest.mark.parametrize(("copies", "rate"), [(5, 20.0), (1, 200.0)])
def test_copies_in_one_log_leave_the_dwells_of_the_first(copies: int, rate: float) -> None:
    once = record(Recipe(rate=rate, seed=3)).log
    looking = RepeatedSamples(RIG)
    pieces = list(joined(*[once] * (copies + 1)))
    for piece in pieces:
        looking.add(piece)
    dwells = counted_once(find_dwells(pieces), looking.found())
    assert len(dwells) == len(find_dwells(once)) == 8
    assert dwells.end[-1] <= once.force[0].time[-1]
    assert len(in_words(dwells.findings)) == 1
    assert len(dwells.left_out) >= 8 * copies


@pytest.mark.parametrize(
    ("change", "coarse"),
    [
        (lambda value: np.round(value, 2), False),
        (lambda value: value.astype(np.float32).astype(np.float64), False),
        (held, True),
        (lambda value: np.round(value), True),
        (lambda value: np.round(value / 2) * 2, True),
    ],
    ids=["two digits", "single precision", "held", "a digit of the noise", "twice the noise"],
)
def test_a_copy_is_found_in_other_digits(
    change: Callable[[FloatArray], FloatArray], coarse: bool
) -> None:
    """coarse : the first has no finer digits either."""
    once = record(Recipe(stops=(10.0,) * 8, seed=4)).log
    second = changed(once, change)
    assert all(map(bool, begins(*joined(second if coarse else once, second))))


def test_a_stale_sensor_alone_is_named() -> None:
    log = record(Recipe(seed=5)).log
    value = log.force[1].value.copy()
    rows = int(6.0 * 200)  # of a stop and a move
    value[2 * rows : 4 * rows] = np.tile(value[rows : 2 * rows], (2, 1))
    stale = replace(log, force=(log.force[0], Series(log.force[1].time, value), log.force[2]))
    assert [len(of) > 0 for of in begins(stale)] == [False, True, False]
    looking = RepeatedSamples(RIG)
    looking.add(stale)
    dwells = counted_once(find_dwells(stale), looking.found())
    lost = [piece for piece in dwells.left_out if log.supports[1] in piece.reason.subject]
    assert len(lost) == 2


@pytest.mark.parametrize(
    ("change", "force_tau"),
    [
        (lambda value: value, 0.05),
        (lambda value: np.round(value), 0.05),
        (lambda value: np.round(value / 5) * 5, 0.0),
        (lambda value: np.round(value / 50) * 50, 0.0),
        (lambda value: 0.0 * value, 0.0),
        (held, 0.05),
        (hum, 0.0),
    ],
    ids=["full", "noise", "five times the noise", "fifty times", "dead", "held", "hum"],
)
def test_a_sound_log_repeats_nothing(
    change: Callable[[FloatArray], FloatArray], force_tau: float
) -> None:
    """Also with loads that come back: eight stops, four times over, with new noise."""
    first = record(Recipe(seed=6, force_tau=force_tau, force_noise=0.0)).log
    rng = np.random.default_rng(7)
    logs = []
    for _ in range(4):
        noisy = changed(first, lambda value: value + rng.normal(size=value.shape))
        logs.append(changed(noisy, change))
    assert begins(*joined(*logs)) == [[], [], []]


def test_what_is_kept_of_a_long_log_is_bounded_and_still_tells() -> None:
    rng = np.random.default_rng(8)
    time, value = np.arange(60_000) * 1e-3, rng.normal(500.0, 1.0, (60_000, 3))
    looking = RepeatedSamples(RIG)
    for k in range(5):
        new: FloatArray = value if k in (1, 4) else rng.normal(500.0, 1.0, value.shape)
        series = Series(np.asarray(time + 60.0 * k, dtype=np.float64), new)
        for piece in range(0, len(time), 8192):
            rows = slice(piece, piece + 8192)
            part = Series(series.time[rows], np.asarray(series.value[rows], dtype=np.float64))
            looking.add(Log(RIG.supports, (), (part,) * 3))
    found = looking.found()
    assert len(found) == 3
    for repeat in found:
        assert repeat.begin == pytest.approx(240, abs=1.0)
        assert repeat.end == pytest.approx(300, abs=1.0)
        assert repeat.begin - repeat.original == pytest.approx(180)


def test_what_another_log_holds_too_is_found_and_nothing_else() -> None:
    once, other = record(Recipe(seed=3)).log, record(Recipe(seed=4)).log
    late = replace(once, force=tuple(Series(s.time + 1e4, s.value) for s in once.force))
    looking = []
    for log in (once, other, late):
        looking.append(RepeatedSamples(RIG))
        looking[-1].add(log)
        looking[-1].found()
    first, second, third = looking
    assert not first.shared(second)
    assert {repeat.sensor for repeat in first.shared(third)} == {0, 1, 2}
    for repeat in first.shared(third):
        assert repeat.begin - repeat.original == pytest.approx(1e4)
