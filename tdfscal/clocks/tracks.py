"""The streams of one recorder as means over short bins of its own clock, and when they change.

The log of how fast they change is their activity; the cross-correlation of two recorders' has a
peak at every lag that brings their moves together. When forces and positions pass the same levels
on their way from rest to rest tells the lag, and how it changes from move to move its rate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.numerics.streams import Line, line_through, times_of_passing
from tdfscal.records import BoolArray, FloatArray, RecorderClock, Series

_WIDTH = 0.02  # s; well below any move's length
_MOST = 1 << 18  # bins of a stream; from there on their width doubles
_HOLE = 5.0  # median intervals, and s at least, over which nothing is interpolated
_HOLE_TIME = 0.25
_STRIDE = 3  # bins over which a change is taken
_FLOOR = 3.0  # times the noise, below which a change is none
_OF_BENDS = 0.6745 * np.sqrt(6.0)  # median size of second differences of white noise


#: By the number of a stream: which one it is in truth, with what signs of its axes (3,).
Wiring = Mapping[int, tuple[int, FloatArray]]


@record
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

    @property
    def noise(self) -> FloatArray:
        """Standard deviation (3,) of a bin, by second differences."""
        bend = np.abs(np.diff(self.value, n=2, axis=0))
        return np.median(bend, axis=0) / _OF_BENDS if len(bend) else np.zeros(bend.shape[1])

    def at(self, time: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Values (N, 3) at times (N,), and where no hole of the stream is bridged (N,)."""
        after = np.clip(np.searchsorted(self.time, time), 1, max(len(self.time) - 1, 1))
        before, width = self.time[after - 1], self.time[after] - self.time[after - 1]
        share = np.clip((time - before) / np.maximum(width, 1e-12), 0.0, 1.0)[:, None]
        value = (1.0 - share) * self.value[after - 1] + share * self.value[after]
        known = (width <= self.hole) & (time >= self.time[0]) & (time <= self.time[-1])
        return np.asarray(value), np.asarray(known)


@record
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

    def rewired(self, wiring: Wiring) -> Tracks:
        """The same where some streams are others in truth, or have other signs."""
        streams = dict(self.streams)
        for number, (source, sign) in wiring.items():
            if number in streams and source in self.streams:
                other = self.streams[source]
                streams[number] = replace(other, value=other.value * sign)
        return replace(self, streams=streams)


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
                raise DataError(Finding("samples-few"))
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


@record
class Peak:
    """A lag, s, at which two courses are alike; r : their correlation over the overlap, s."""

    lag: float
    r: float
    overlap: float

    @property
    def evidence(self) -> float:
        """Log-likelihood ratio against chance, of as many independent values as seconds."""
        return -self.overlap * float(np.log1p(-(min(self.r, 0.9999) ** 2)))


def activity(tracks: Sequence[Track], width: float, end: float) -> FloatArray:
    """Log-activity (B,) in bins of `width` s from time 0 to `end`; NaN where it is not known."""
    bins = int(end / width) + 1
    middle = width * np.arange(0.5, bins, dtype=np.float64)
    ahead, behind = middle + 0.5 * _STRIDE * width, middle - 0.5 * _STRIDE * width
    total, floor, known = np.zeros(bins), 0.0, np.ones(bins, dtype=np.bool_)
    for track in tracks:
        mean = _averaged(track, width)
        after, there = mean.at(ahead)
        before, here = mean.at(behind)
        known &= there & here
        change = after - before
        scale = np.sqrt(np.mean(change[there & here] ** 2, axis=0)) if known.any() else np.ones(3)
        scale = np.where(scale > 0, scale, np.inf)
        total += np.sum((change / scale) ** 2, axis=1)
        floor += float(np.sum(2.0 * (mean.noise / scale) ** 2))
    channels = 3 * max(len(tracks), 1)
    course = np.log(total / channels + _FLOOR**2 * floor / channels + 1e-4)
    return np.where(known, course, np.nan)


def _averaged(track: Track, width: float) -> Track:
    """Means over bins of `width`; of a track that is sparser, itself."""
    number = np.floor(track.time / width)
    first = np.flatnonzero(np.diff(number, prepend=-np.inf))
    count = np.diff(first, append=len(number))
    time = np.add.reduceat(track.time, first) / count
    return Track.of(time, np.add.reduceat(track.value, first, axis=0) / count[:, None])


def peaks(a: FloatArray, b: FloatArray, width: float, least: float, most: int) -> list[Peak]:
    """Lags at which course b (B′,) follows course a (B,), the likeliest first.

    A lag is positive where b's own clock, from its begin, shows the same move later.
    least : s, shortest overlap. Correlation over the overlap alone, by masks (Padfield 2012).
    """
    lag, r, overlap = _correlation(a, b)
    evidence = -overlap * np.log1p(-(np.clip(r, 0.0, 0.9999) ** 2))
    evidence[overlap * width < least] = 0.0
    crest = np.ones(len(lag), dtype=np.bool_)
    crest[1:] &= evidence[1:] > evidence[:-1]
    crest[:-1] &= evidence[:-1] >= evidence[1:]
    order = np.flatnonzero(crest & (evidence > 0))
    order = order[np.argsort(-evidence[order])]
    found: list[Peak] = []
    for k in order.tolist():
        if len(found) == most:
            break
        if all(abs(lag[k] * width - peak.lag) > 2 * _STRIDE * width for peak in found):
            found.append(Peak(float(lag[k] * width), float(r[k]), float(overlap[k] * width)))
    return found


def _correlation(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lags (L,) in bins, correlation over the overlap, and its bins."""
    known = [np.isfinite(x).astype(float) for x in (a, b)]
    level = [np.where(m > 0, x - np.mean(x[m > 0]) if m.any() else 0.0, 0.0)
             for x, m in zip((a, b), known, strict=True)]  # fmt: skip
    size = 1 << (len(a) + len(b) - 1).bit_length()

    def together(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)

    count = np.rint(together(known[0], known[1]))
    n = np.maximum(count, 1.0)
    sum_a, sum_b = together(level[0], known[1]), together(known[0], level[1])
    square_a = together(level[0] ** 2, known[1]) - sum_a**2 / n
    square_b = together(known[0], level[1] ** 2) - sum_b**2 / n
    least_a, least_b = (1e-3 * np.mean(x**2) for x in level)
    size_of = np.sqrt(np.maximum(square_a, least_a * n) * np.maximum(square_b, least_b * n))
    product = together(level[0], level[1]) - sum_a * sum_b / n
    r = np.divide(product, size_of, out=np.zeros(size), where=(size_of > 0) & (count > 2))
    lag = np.arange(size)
    lag[lag > size // 2] -= size
    order = np.argsort(lag)
    return lag[order].astype(float), np.clip(r[order], -1, 1), count[order]


def correlation_time(tracks: Sequence[Track], span: float) -> float:
    """Time, s, in which some streams tell something new."""
    time = np.linspace(0.0, span, max(int(min(span / 0.1, 1 << 15)), 16))
    values = np.hstack([track.at(time)[0] for track in tracks])
    values = values - values.mean(axis=0)
    size = 1 << (2 * len(time) - 1).bit_length()
    power = np.abs(np.fft.rfft(values, size, axis=0)) ** 2
    course = np.fft.irfft(power.sum(axis=1), size)[: len(time) // 2]
    if course[0] <= 0:
        return span
    alike = (course / course[0]) ** 2
    return float((time[1] - time[0]) * max(2.0 * alike.sum() - 1.0, 1.0))


_LONGEST = 60.0  # s; a longer way from rest to rest is no single move
_REST = 0.6  # s, shortest
_EDGE = 0.2  # s next to a move, in which forces are not yet settled or the lag is not yet known
_FEW_MOVES, _MOST_MOVES = 5, 400  # moves
_SPAN = 0.1  # s, over which a change shows motion
_MOVING, _SHARE = 8.0, 5e-3  # times the noise, and share of the usual speed of the moves
_LEAST_OF_MOVES = 0.1  # of a period, that no number of moves tells better


def moves(positions: Sequence[Track], span: float, period: float) -> list[tuple[float, float]]:
    """Times (end of a rest, start of the next), s, between which the terminal moves."""
    step = max(0.02, period)
    time = np.arange(0.0, span, step)
    place = np.hstack([track.at(time)[0] for track in positions])
    reach = max(round(_SPAN / step), 1)
    change = np.linalg.norm(place[2 * reach :] - place[: -2 * reach], axis=1)
    bend = np.median(np.abs(np.diff(place, n=2, axis=0)), axis=0) / _OF_BENDS
    limit = max(_MOVING * float(np.linalg.norm(bend)), _SHARE * float(np.quantile(change, 0.98)))
    still = np.concatenate([[False], change < limit, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    rests = [(time[a + reach], time[b - 1 + reach]) for a, b in zip(edges[::2], edges[1::2],
             strict=True) if (b - a) * step >= _REST]  # fmt: skip
    return [(float(a[1]), float(b[0])) for a, b in pairwise(rests)]


def lag_by_moves(
    positions: Sequence[tuple[Track, bool]],
    forces: Sequence[tuple[Track, bool]],
    way: Sequence[tuple[float, float]],
    lag: float,
    period: float,
) -> Line | None:
    """Line of the lag, s, through the moves that show it; None where too few do.

    positions, forces : with whether each is on the second clock.
    way : moves, s, of the first clock. lag : to begin with, right to a part of a rest.
    """
    found = []
    single = [(begin, end) for begin, end in way if end - begin <= _LONGEST]
    for begin, end in single[:: max(-(-len(single) // _MOST_MOVES), 1)]:
        time = np.arange(begin - _REST, end + _REST, max(0.005, 0.25 * period))
        passed = []
        for streams in (positions, forces):
            value = [track.at(time + (lag if second else 0.0)) for track, second in streams]
            if not all(known.all() for _, known in value):
                break
            passed.append(_passing(np.hstack([v for v, _ in value]), time, begin, end))
        if len(passed) == 2 and passed[0] is not None and passed[1] is not None:
            found.append((float(np.mean(passed[0])), float(np.mean(passed[1] - passed[0]))))
    if len(found) < _FEW_MOVES:
        return None
    time, late = np.array(found).T
    # Forces on the second clock pass late where it is ahead; positions, early.
    sign = 1.0 if any(second for _, second in forces) else -1.0
    return line_through(time, lag + sign * late, _LEAST_OF_MOVES * period)


def _passing(value: FloatArray, time: FloatArray, begin: float, end: float) -> FloatArray | None:
    """Times at which streams (N, C) pass the levels on their way; None where it is unclear."""
    rests = [time < begin - _EDGE, time > end + _EDGE]
    ends = np.stack([value[rest].mean(axis=0) for rest in rests])
    return times_of_passing(value, time, ends, rests)
