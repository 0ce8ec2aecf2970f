"""One time base for streams of different rates: everything at the instants of the first force."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import BoolArray, FloatArray, Log, Series

#: Nothing is interpolated over a gap longer than this many sampling intervals, and than this time.
_GAP = 20.0
_GAP_TIME = 0.1


@record
class Samples:
    """A stretch of a log on one time base.

    time : (N,), s, ascending. position : (N, n, 3), m, BCS. force : (N, n, 3), N, readings.
    """

    time: FloatArray
    position: FloatArray
    force: FloatArray

    def rows(self, which: slice | BoolArray) -> Samples:
        """Some of the samples."""
        return Samples(self.time[which], self.position[which], self.force[which])

    def stretches(self, longest: float) -> list[Samples]:
        """Parts without a step of time above `longest`, s."""
        cuts = np.flatnonzero(np.diff(self.time) > longest) + 1
        return [self.rows(slice(a, b)) for a, b in pairwise([0, *cuts.tolist(), len(self.time)])]

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Samples:
        """Parts that follow each other."""
        return cls(
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.position for part in parts]),
            np.concatenate([part.force for part in parts]),
        )


@dataclass(slots=True)
class Tally:
    """Samples of the time base that could not be used, and those that could.

    uncovered : another stream has a gap there, or has not begun, or has ended.
    unreadable : a reading is not a number.
    """

    used: int = 0
    uncovered: int = 0
    unreadable: int = 0


def together(streams: Sequence[Series]) -> bool:
    """Whether all streams have the same stamps."""
    stamps = streams[0].time
    return all(s.time is stamps or np.array_equal(s.time, stamps) for s in streams)


def aligned(pieces: Iterable[Log], tally: Tally) -> Iterator[Samples]:
    """Bring the pieces of a log to one time base, in bounded memory.

    The base is the first support's force; the other streams are interpolated linearly between
    their samples, across the borders of pieces. tally : counts on.
    """
    held: list[Series] = []
    for piece in pieces:
        streams = [*piece.position, *piece.force]
        held = [joined(a, b) for a, b in zip(held, streams, strict=True)] if held else streams
        base = len(piece.position)
        if together(held):
            yield from _sound(held[base].time, [s.value for s in held], tally)
            held = [Series(s.time[:0], s.value[:0]) for s in held]
        elif min(s.time.size for s in held):
            yield from _common(held, base, tally)
            reach = min(float(s.time[-1]) for s in held)
            held = [_rest(s, reach, whole=i != base) for i, s in enumerate(held)]
    if held:
        tally.uncovered += held[len(held) // 2].time.size


def joined(a: Series, b: Series) -> Series:
    """One stream from two pieces of it."""
    if not a.time.size or not b.time.size:
        return b if b.time.size else a
    return Series(np.concatenate([a.time, b.time]), np.concatenate([a.value, b.value]))


def _rest(stream: Series, reach: float, *, whole: bool) -> Series:
    """What is still needed after `reach`; with whole, from the sample at or before it."""
    first = int(np.searchsorted(stream.time, reach, side="right")) - whole
    return Series(stream.time[max(first, 0) :], stream.value[max(first, 0) :])


def _common(held: list[Series], base: int, tally: Tally) -> Iterator[Samples]:
    """Samples at the base's instants that all streams reach."""
    reach = min(float(s.time[-1]) for s in held)
    time = held[base].time
    time = time[: int(np.searchsorted(time, reach, side="right"))]
    if not time.size:
        return
    covered = np.ones(time.size, dtype=np.bool_)
    values = []
    for stream in held:
        covered &= _covers(stream.time, time)
        values.append(
            np.stack([np.interp(time, stream.time, stream.value[:, c]) for c in range(3)], axis=1)
        )
    tally.uncovered += int(np.sum(~covered))
    yield from _sound(time[covered], [v[covered] for v in values], tally)


def _covers(node: FloatArray, time: FloatArray) -> BoolArray:
    """Whether each time, none after the last node, lies on one or between two close ones."""
    after = np.searchsorted(node, time)
    here = node[after] == time
    if node.size < 2:
        return np.asarray(here)
    step = np.diff(node)
    close = step <= max(_GAP * float(np.median(step)), _GAP_TIME)
    return np.asarray(here | ((after > 0) & close[np.maximum(after - 1, 0)]))


def _sound(time: FloatArray, values: list[FloatArray], tally: Tally) -> Iterator[Samples]:
    """Leave out samples that are not numbers."""
    n = len(values) // 2
    found = Samples(time, np.stack(values[:n], axis=1), np.stack(values[n:], axis=1))
    good = np.isfinite(found.position.sum(axis=(1, 2)) + found.force.sum(axis=(1, 2)))
    if not good.all():
        tally.unreadable += int(np.sum(~good))
        found = found.rows(good)
    tally.used += found.time.size
    if found.time.size:
        yield found
