"""Reduction of samples to short bins on common edges, in one pass and bounded memory.

Per bin and stream: number of samples, mean, scatter about the mean, and for forces the extremes.
Everything later works on bins, so an hour at 1 kHz is 180 000 rows instead of 3.6 million.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.records import FloatArray, IntArray, Log, Series

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

_WIDTH = 0.02  # s; shorter than any settling, long enough to average the samples of a fast log
#: Above this many bins their width doubles, so that memory stays bounded: 70 MB with three
#: supports. An hour fits at 20 ms, ten hours at 160 ms; from there on it takes four times as many
#: bins until they double again, so that forty hours are seen in steps of 160 ms too.
MOST_BINS = 225 * 1024
_WIDEST, _LONG = 0.16, 4  # s, and how many times as many bins there may be from then on
_SLOWEST = 2.0  # s
#: No force is sampled at shorter intervals, s; nor at the second ones in so short a log.
_FASTEST, _FAST, _SHORTEST_LOG = 1.9e-5, 1.1e-4, 5.0
_MANY = 100_000
_SLAB = 16384  # samples reduced at once; they stay in the cache
# samples searched for the smallest step of the readings, and for zeros
_PEEK, _PEEK_OF = 2048, 65536
_ZEROS = 1e-4  # share of samples at which a stream drops to 0, 0, 0


@record
class Bins:
    """A log reduced to B bins of equal width; S = 2n streams, positions (m) then forces (N).

    start : (B,), s, ascending; bins without any sample are missing.
    count : (B, S). mean : (B, S, 3), NaN where count is 0. scatter : (B, S, 3), sum of squared
    deviations from the bin's mean. low, high : (B, n, 3), extremes of the forces minus their mean.
    period : (S,), s, median sample interval. quantum : (S, 3), smallest step between successive
    readings, 0 where none was seen. zeros : (S,), share of samples at which a
    stream drops to exactly 0, 0, 0.

    In memory each axis is one row: `mean[:, s, a]` is contiguous.
    """

    supports: tuple[str, ...]
    width: float
    start: FloatArray
    count: Int32Array
    mean: FloatArray
    scatter: Float32Array
    low: Float32Array
    high: Float32Array
    period: FloatArray
    quantum: FloatArray
    zeros: FloatArray

    def __len__(self) -> int:
        return len(self.start)


@record
class _Moments:
    """Of the samples of one stream in P bins: number, count (P,); the others (P, 3), as in `Bins`.

    Extremes less the mean are exact enough in float32; of a position they are 0.
    """

    number: IntArray
    count: IntArray
    mean: FloatArray
    scatter: Float32Array
    low: Float32Array
    high: Float32Array

    def of(self, some: slice) -> _Moments:
        """Those of some bins."""
        return _Moments(*(getattr(self, field.name)[some] for field in fields(self)))


def _moments(value: FloatArray, number: IntArray, first: IntArray, *, extremes: bool) -> _Moments:
    """Moments of the samples value (N, 3) in bins `number` that begin at `first`, (P,) both."""
    bounds = np.append(first, len(value))
    count = np.diff(bounds)
    mean = np.empty((3, len(first)))
    scatter, low, high = (np.zeros(mean.shape, np.float32) for _ in range(3))
    for start, stop, even in _slabs(bounds, count):
        part, size = slice(start, stop), count[start:stop]
        begin = None if even else bounds[start:stop] - bounds[start]
        samples = value[bounds[start] : bounds[stop]].T
        # Counted from each bin's first sample: a constant reading has no scatter, and its own mean.
        if begin is None:  # sample k of all bins is a row, and whole rows are added
            deviation = samples.reshape(3, -1, size[0]).transpose(0, 2, 1).copy()
            reference = deviation[:, 0].copy()
            deviation -= reference[:, None]
        else:
            reference = samples[:, begin]
            deviation = samples - np.repeat(reference, size, axis=1)
        middle = _reduced(np.add, deviation, begin) / size
        mean[:, part] = middle + reference
        if extremes:
            low[:, part] = _reduced(np.minimum, deviation, begin) - middle
            high[:, part] = _reduced(np.maximum, deviation, begin) - middle
        deviation *= deviation
        scatter[:, part] = np.maximum(_reduced(np.add, deviation, begin) - size * middle**2, 0.0)
    return _Moments(number, count, mean.T, scatter.T, low.T, high.T)


def _reduced(ufunc: np.ufunc, value: FloatArray, begin: IntArray | None) -> FloatArray:
    """Each bin's (3, G), of (3, N) where bins begin at `begin`, of (3, size, G) without."""
    if begin is None:
        return np.asarray(ufunc.reduce(value, axis=1))
    return np.asarray(ufunc.reduceat(value, begin, axis=1))


def _slabs(bounds: IntArray, size: IntArray) -> Iterator[tuple[int, int, bool]]:
    """Bins that are reduced at once, about _SLAB samples or one bin, and whether of one size.

    The longest run of bins of one size is taken as such: most of them where the clock is steady.
    """
    change = np.concatenate(([0], np.flatnonzero(np.diff(size)) + 1, [len(size)]))
    k = int(np.argmax(np.diff(change)))
    cuts = np.searchsorted(bounds, np.arange(0, bounds[-1], _SLAB))
    for start, stop in pairwise(np.unique([*cuts, *change[k : k + 2], len(size)]).tolist()):
        yield start, stop, bool(change[k] <= start < change[k + 1])


def _joined(parts: Sequence[_Moments]) -> _Moments:
    """Moments of consecutive parts; bins of one number become one (Chan, Golub, LeVeque 1979)."""
    each = ([getattr(part, field.name) for part in parts] for field in fields(_Moments))
    one = _Moments(*(np.concatenate(arrays) for arrays in each))
    first = np.flatnonzero(np.diff(one.number, prepend=-1))
    if len(first) == len(one.number):
        return one
    size = np.diff(first, append=len(one.number))
    count = np.add.reduceat(one.count, first)
    away = one.mean - np.repeat(one.mean[first], size, axis=0)
    weight = one.count[:, None]
    middle = np.add.reduceat(weight * away, first) / count[:, None]
    away -= np.repeat(middle, size, axis=0)
    kept = (
        np.add.reduceat(one.scatter + weight * away**2, first),
        np.minimum.reduceat(away + one.low, first),
        np.maximum.reduceat(away + one.high, first),
    )
    mean = one.mean[first] + middle
    return _Moments(one.number[first], count, mean, *(x.astype(np.float32) for x in kept))


class _Binner:
    """Collects bins; doubles their width when there are too many."""

    def __init__(self, supports: tuple[str, ...], origin: float, width: float, limit: int) -> None:
        self.supports = supports
        self.origin, self.width, self.limit = origin, width, limit
        streams = 2 * len(supports)
        self.parts: list[list[_Moments]] = [[] for _ in range(streams)]
        self.last = np.full(streams, -np.inf)
        self.quantum = np.full((streams, 3), np.inf)
        self.zeros, self.seen = np.zeros(streams), np.zeros(streams)

    def add(self, piece: Log) -> None:
        """Take a piece's samples in."""
        if piece.supports != self.supports:
            raise DataError(
                f"supports {', '.join(piece.supports)} follow {', '.join(self.supports)}",
                hint="give logs of one rig",
            )
        clocks: dict[int, tuple[IntArray, IntArray]] = {}
        for stream, series in enumerate((*piece.position, *piece.force)):
            time = series.time
            if not len(time):
                continue
            if id(time) not in clocks or time[0] < self.last[stream]:
                if not (np.diff(time, prepend=self.last[stream]) >= 0).all():
                    raise self._stepping_back(stream, time)
                # Numbers of the bins that hold samples, and where each begins; the streams of a
                # table share one time.
                index = np.floor((time - self.origin) / self.width).astype(np.int64)
                begin = np.flatnonzero(np.diff(index, prepend=index[0] - 1))
                clocks[id(time)] = index[begin], begin
            self.last[stream] = time[-1]
            extremes = stream >= len(self.supports)
            with np.errstate(invalid="ignore", over="ignore"):
                found = _moments(series.value, *clocks[id(time)], extremes=extremes)
            if not np.isfinite(found.mean).all():
                raise self._no_number(stream, series)
            self._look(stream, series.value)
            parts = self.parts[stream]
            if parts and parts[-1].number[-1] == found.number[0]:  # one bin of two pieces
                before = parts.pop()
                seam = _joined([before.of(slice(-1, None)), found.of(slice(1))])
                each = (before.of(slice(-1)), seam, found.of(slice(1, None)))
                parts += [part for part in each if len(part.number)]
            else:
                parts.append(found)
        # More bins are held once wider ones would hide a stop of a second.
        while max(sum(len(part.number) for part in parts) for parts in self.parts) > self.limit * (
            1 if self.width < _WIDEST else _LONG
        ):
            self.width *= 2
            for parts in self.parts:
                parts[:] = [_joined([replace(part, number=part.number // 2) for part in parts])]

    def finish(self, period: FloatArray) -> Bins:
        """All bins in order."""
        numbers = [np.concatenate([part.number for part in parts]) for parts in self.parts]
        number = numbers[0]
        for own in numbers[1:]:
            if not np.array_equal(own, number):
                number = np.union1d(own, number)
        n, shape = len(self.supports), (2 * len(self.supports), 3, len(number))
        count, mean = np.zeros((shape[0], shape[2]), np.int32), np.full(shape, np.nan)
        scatter, low, high = (np.zeros(shape, np.float32) for _ in range(3))
        for k, (own, parts) in enumerate(zip(numbers, self.parts, strict=True)):
            every, end = len(own) == len(number), 0
            for part in parts:
                begin, end = end, end + len(part.number)
                here = slice(begin, end) if every else np.searchsorted(number, own[begin:end])
                count[k, here] = part.count
                mean[k][:, here], scatter[k][:, here] = part.mean.T, part.scatter.T
                low[k][:, here], high[k][:, here] = part.low.T, part.high.T
        return Bins(
            supports=self.supports,
            width=self.width,
            start=np.asarray(self.origin + self.width * number),
            count=count.T,
            mean=mean.transpose(2, 0, 1),
            scatter=scatter.transpose(2, 0, 1),
            low=low[n:].transpose(2, 0, 1),
            high=high[n:].transpose(2, 0, 1),
            period=period,
            quantum=np.where(np.isfinite(self.quantum), self.quantum, 0.0),
            zeros=self.zeros / np.maximum(self.seen, 1.0),
        )

    def _name(self, stream: int) -> str:
        n = len(self.supports)
        return f"{self.supports[stream % n]}, {'position' if stream < n else 'force'}"

    def _stepping_back(self, stream: int, time: FloatArray) -> DataError:
        at = int(np.argmin(np.diff(time, prepend=self.last[stream]) >= 0))
        return DataError(
            "time steps back or is not a number",
            where=f"{self._name(stream)}, t = {time[at]:.6f} s",
            hint="give the logs in the order of their times, without overlaps",
        )

    def _no_number(self, stream: int, series: Series) -> DataError:
        bad = ~np.isfinite(series.value).all(axis=1)
        return DataError(
            "a reading is not a number",
            where=f"{self._name(stream)}, t = {series.time[np.argmax(bad)]:.6f} s",
            hint="repair the recording or cut this stretch out",
        )

    def _look(self, stream: int, value: FloatArray) -> None:
        """Smallest step and zero readings of a share of the samples."""
        for begin in range(0, len(value), _PEEK_OF):
            some = value[begin : begin + _PEEK]
            self.seen[stream] += len(some)
            zero = (some == 0.0).all(axis=1)
            self.zeros[stream] += np.count_nonzero(zero[1:] & ~zero[:-1])
            step = np.abs(np.diff(some.T))
            smallest = step.min(axis=1, initial=np.inf, where=step > 0)
            np.minimum(self.quantum[stream], smallest, out=self.quantum[stream])


def _opening(stream: Iterator[Log]) -> tuple[list[Log], list[FloatArray]]:
    """Take pieces until each stream has shown its rate; them, and the first times of each."""
    held: list[Log] = []
    times: list[list[FloatArray]] = []
    begin, end = np.inf, -np.inf
    for piece in stream:
        held.append(piece)
        each = [series.time for series in (*piece.position, *piece.force)]
        times = times or [[] for _ in each]
        for known, time in zip(times, each, strict=True):
            known.append(time[:_MANY])
            begin, end = min([begin, *time[:1]]), max([end, *time[-1:]])
        count = min(sum(len(t) for t in known) for known in times)
        if count >= (1000 if end - begin >= _SHORTEST_LOG else _MANY):
            break
    return held, [np.concatenate(known) for known in times]


def reduce_to_bins(
    pieces: Iterable[Log], width: float | None = None, most: int = MOST_BINS
) -> Bins:
    """Samples → bins, one pass, in bounded memory.

    pieces : consecutive in time per stream; streams may differ in rate and times. width : of a bin,
    s; by default 20 ms, at least two samples of the slowest stream. most : bins, above which it
    doubles.

    Raises
    ------
    DataError
        for an empty log, times that step back or are not in seconds, readings that are not numbers.
    """
    stream = iter(pieces)
    held, joined = _opening(stream)
    if not joined or min(len(t) for t in joined) < 2:
        raise DataError(Finding("samples-few"))
    period = np.array([np.median(np.diff(t)) for t in joined])
    if not np.all(period > 0):
        raise DataError(Finding("times-alike"))
    if period.max() > _SLOWEST:
        values: dict[str, Value] = {"limit": _SLOWEST}
        raise DataError(Finding("samples-sparse", (), float(period.max()), "s", values=values))
    begin, end = min(float(t[0]) for t in joined), max(float(t[-1]) for t in joined)
    if period.min() < (_FAST if end - begin < _SHORTEST_LOG else _FASTEST):
        values = {"span": end - begin if len(joined[0]) < _MANY else None}
        raise DataError(
            Finding("samples-dense", (), 1.0 / float(period.min()), "Hz", values=values)
        )
    width = width or max(_WIDTH, 2.0 * float(period.max()))
    # Half a sample early: samples then lie amid the bins, and rounding cannot move them.
    origin = begin - 0.5 * float(period.min())
    binner = _Binner(held[0].supports, origin, width, most)
    while held:
        binner.add(held.pop(0))
    for piece in stream:
        binner.add(piece)
    return binner.finish(period)


def zeros(bins: Bins) -> Finding | None:
    """Readings that drop to 0, 0, 0 and return, as no noisy signal does."""
    worst = int(np.argmax(bins.zeros))
    if bins.zeros[worst] <= _ZEROS:
        return None
    n = len(bins.supports)
    values: dict[str, Value] = {"signal": "position" if worst < n else "force"}
    subject = (bins.supports[worst % n],)
    return Finding("readings-zero", subject, float(bins.zeros[worst]), values=values)
