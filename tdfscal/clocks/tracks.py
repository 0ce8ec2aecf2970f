"""The streams of one recorder as means over short bins of its own clock, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.errors import DataError
from tdfscal.records import BoolArray, FloatArray, RecorderClock, Series

_WIDTH = 0.02  # s; well below any move's length
_MOST = 1 << 18  # bins of a stream; from there on their width doubles
_HOLE = 5.0  # median intervals, and s at least, over which nothing is interpolated
_HOLE_TIME = 0.25


@dataclass(frozen=True, slots=True)
class Track:
    """One stream: mean stamps (B,), s, and mean values (B, 3) of its bins.

    hole : s, longest interval over which values are interpolated.
    """

    time: FloatArray
    value: FloatArray
    hole: float

    @classmethod
    def of(cls, time: FloatArray, value: FloatArray) -> Track:
        """The stream with these bins."""
        usual = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        return cls(time, value, max(_HOLE * usual, _HOLE_TIME))

    def at(self, time: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Values (N, 3) at times (N,), and where no hole of the stream is bridged (N,)."""
        after = np.clip(np.searchsorted(self.time, time), 1, max(len(self.time) - 1, 1))
        before, width = self.time[after - 1], self.time[after] - self.time[after - 1]
        share = np.clip((time - before) / np.maximum(width, 1e-12), 0.0, 1.0)[:, None]
        value = (1.0 - share) * self.value[after - 1] + share * self.value[after]
        known = (width <= self.hole) & (time >= self.time[0]) & (time <= self.time[-1])
        return np.asarray(value), np.asarray(known)


@dataclass(frozen=True, slots=True)
class Tracks:
    """What one recorder holds: streams by number, 2i the position of support i, 2i + 1 its force.

    begin, end : s, of its clock. The times of the streams count from `begin`.
    period : s, median interval of its slowest stream.
    """

    begin: float
    end: float
    period: float
    streams: Mapping[int, Track]

    @property
    def positions(self) -> list[Track]:
        """Of the supports whose position it holds."""
        return [track for number, track in self.streams.items() if number % 2 == 0]

    @property
    def forces(self) -> list[Track]:
        """Of the supports whose force it holds."""
        return [track for number, track in self.streams.items() if number % 2 == 1]

    def joined(self, others: Iterable[tuple[Tracks, RecorderClock]]) -> Tracks:
        """The same with the streams of other recorders, whose clocks are known."""
        streams, period = dict(self.streams), self.period
        for other, clock in others:
            period = max(period, other.period)
            for number, track in other.streams.items():
                time = clock.to_first(other.begin + track.time) - self.begin
                streams.setdefault(number, Track.of(time, track.value))
        return replace(self, period=period, streams=dict(sorted(streams.items())))

    def backwards(self) -> Tracks:
        """The same with all values in the reverse order."""
        span = self.end - self.begin
        turned = {k: Track.of(span - t.time[::-1], t.value[::-1]) for k, t in self.streams.items()}
        return replace(self, streams=turned)


class Reduction:
    """Reduces the streams of one recorder while they pass."""

    def __init__(self) -> None:
        self._width = _WIDTH
        self._begin, self._end = np.inf, -np.inf
        self._sums: dict[int, list[FloatArray]] = {}
        self._periods: dict[int, float] = {}

    def add(self, streams: Sequence[Series]) -> None:
        """Take in what follows of each stream; those without a sample are not this recorder's."""
        for number, series in enumerate(streams):
            if not series.time.size:
                continue
            if self._begin == np.inf:
                self._begin = float(min(s.time[0] for s in streams if s.time.size))
            self._end = max(self._end, float(series.time[-1]))
            if number not in self._periods and series.time.size > 1:
                self._periods[number] = float(np.median(np.diff(series.time)))
            time = series.time - self._begin
            rows = np.column_stack([np.floor(time / self._width), np.ones(len(time)), time,
                                    series.value])  # fmt: skip
            held = self._sums.setdefault(number, [])
            held.append(_joined(rows))
            if sum(map(len, held)) > _MOST:
                self._coarsen()

    def finish(self) -> Tracks:
        """All streams."""
        found: dict[int, Track] = {}
        for number, held in sorted(self._sums.items()):
            sums = _joined(np.concatenate(held))
            if len(sums) < 2:
                raise DataError("the log holds fewer than two samples", hint="record again")
            means = sums[:, 2:] / sums[:, 1:2]
            found[number] = Track.of(means[:, 0].copy(), means[:, 1:].copy())
        period = max(self._periods.values(), default=self._width)
        return Tracks(self._begin, self._end, max(period, self._width), found)

    def _coarsen(self) -> None:
        longest = max(len(_joined(np.concatenate(held))) for held in self._sums.values())
        if longest > _MOST // 2:
            self._width *= 2
        for number, held in self._sums.items():
            rows = np.concatenate(held)
            rows[:, 0] = np.floor(rows[:, 2] / rows[:, 1] / self._width)
            self._sums[number] = [_joined(rows)]


def _joined(rows: FloatArray) -> FloatArray:
    """Sums of the rows (N, 6) that are of one bin, whose number is their first column."""
    first = np.flatnonzero(np.diff(rows[:, 0], prepend=-np.inf))
    out = np.add.reduceat(rows, first, axis=0)
    out[:, 0] = rows[first, 0]
    return np.asarray(out)
