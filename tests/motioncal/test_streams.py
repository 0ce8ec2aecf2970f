"""Decimation while reading, and the weak form, against closed forms."""

from itertools import pairwise

import numpy as np
import pytest

from tdfscal.motioncal.blocks import blocks
from tdfscal.motioncal.streams import Slow, slow_streams
from tdfscal.records import Log, Series
from tests.words import refusal

NAMES = ("a", "b", "c")
OPEN = np.full((3, 3), np.inf)


def log(time: np.ndarray, value: np.ndarray, force_time: np.ndarray | None = None) -> Log:
    """A log whose streams all show one signal (N,)."""
    shown = np.repeat(value[:, None], 3, axis=1)
    other = time if force_time is None else force_time
    force = np.repeat(np.interp(other, time, value)[:, None], 3, axis=1)
    return Log(NAMES, (Series(time, shown),) * 3, (Series(other, force),) * 3)


def cut(whole: Log, parts: int) -> list[Log]:
    edges = np.linspace(0, len(whole.position[0].time), parts + 1).astype(int)

    def piece(s: Series, a: int, b: int) -> Series:
        return Series(s.time[a:b], s.value[a:b])

    return [
        Log(
            NAMES,
            tuple(piece(s, a, b) for s in whole.position),
            tuple(piece(s, a, b) for s in whole.force),
        )
        for a, b in pairwise(edges)
    ]


def test_lines_and_slow_waves_pass_and_fast_ones_do_not() -> None:
    rng = np.random.default_rng(0)
    time = np.sort(np.arange(0, 30, 0.004) + rng.uniform(-1e-3, 1e-3, 7500))
    slow = slow_streams([log(time, 3.0 + 0.2 * time)], OPEN)
    assert slow.force[:, 1, 2] == pytest.approx(3.0 + 0.2 * slow.time, abs=1e-9)
    wave = slow_streams([log(time, np.sin(2 * np.pi * 0.3 * time))], OPEN)
    inner = slice(10, -10)
    assert wave.force[inner, 0, 0] == pytest.approx(
        np.sin(2 * np.pi * 0.3 * wave.time[inner]), abs=2e-3
    )
    time = np.arange(0, 30, 0.004)
    fast = slow_streams([log(time, np.sin(2 * np.pi * 50.0 * time))], OPEN)
    assert np.abs(fast.force[inner]).max() < 0.02


@pytest.mark.parametrize("parts", [2, 13])
def test_pieces_make_no_difference(parts: int) -> None:
    time = np.arange(0, 20, 0.01)
    whole = log(time, np.cos(time))
    one, many = slow_streams([whole], OPEN), slow_streams(cut(whole, parts), OPEN)
    assert np.array_equal(one.time, many.time)
    assert many.force == pytest.approx(one.force, abs=1e-12)


def test_nothing_bridges_a_hole_or_a_reading_that_is_no_number() -> None:
    time = np.arange(0, 40, 0.01)
    kept = (time < 15) | (time > 17)
    value = np.ones(time.size)
    value[3000] = np.nan
    slow = slow_streams([log(time[kept], value[kept])], OPEN)
    assert not np.any((slow.time > 15) & (slow.time < 17))
    assert not np.any(np.abs(slow.time - 30.0) < 0.05)
    assert [round(b.begin) for b in blocks(slow, np.ones(len(slow.time), dtype=np.bool_))] == [
        0, 17, 30,
    ]  # fmt: skip


def test_weak_derivatives_are_those_of_the_signal() -> None:
    step = 0.05
    time = np.asarray(step * np.arange(1200.0))
    slow = Slow(NAMES, time, np.zeros((1200, 3, 3)), np.zeros((1200, 3, 3)), step, 20.0, time < 0)
    (block,) = blocks(slow, time >= 0)
    w, phase = 2 * np.pi * 0.31, 0.4
    first = block.transform(w * np.cos(w * time + phase))
    second = block.transform(-(w**2) * np.sin(w * time + phase))
    signal = np.sin(w * time + phase)
    size = np.abs(second).max()
    assert np.abs(block.transform(signal, derivative=1) - first).max() < 1e-5 * size
    assert np.abs(block.transform(signal, derivative=2) - second).max() < 1e-5 * size


@pytest.mark.parametrize("length", [2e-6, 3e-5])
def test_a_log_of_microseconds_is_refused(length: float) -> None:
    """As of a clock in seconds that was declared in microseconds."""
    time = np.linspace(0.0, length, 4000)
    found = refusal(slow_streams, [log(time, np.sin(1e6 * time))], OPEN)
    assert found.code == "streams-short"
