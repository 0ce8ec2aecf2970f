"""Reduction of samples to short bins on common edges, in one pass and bounded memory.

Per bin and stream: number of samples, mean, scatter about the mean, and for forces the extremes.
Everything later works on bins, so an hour at 1 kHz is 180 000 rows instead of 3.6 million.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tdfscal.dwells.options import DwellOptions
from tdfscal.errors import DataError
from tdfscal.records import FloatArray, IntArray, Log, Series

Float32Array = npt.NDArray[np.float32]

_WIDTH = 0.02  # s; shorter than any settling, long enough to average the samples of a fast log
_PAGE = 1024  # bins allocated at once; a gap of hours between two logs then costs nothing
_SLAB = 65536  # samples reduced at once; stays in the cache
_PEEK = 2048  # samples per slab searched for the smallest step of the readings


@dataclass(frozen=True, slots=True)
class Bins:
    """A log reduced to B bins of equal width; S = 2n streams, positions (m) then forces (N).

    start : (B,), s, ascending; bins without any sample are missing.
    count : (B, S). mean : (B, S, 3), NaN where count is 0. scatter : (B, S, 3), sum of squared
    deviations from the bin's mean. low, high : (B, n, 3), extremes of the forces minus their mean.
    period : (S,), s, median sample interval. quantum : (S, 3), smallest step between successive
    readings, 0 where none was seen.
    """

    supports: tuple[str, ...]
    width: float
    start: FloatArray
    count: IntArray
    mean: FloatArray
    scatter: FloatArray
    low: FloatArray
    high: FloatArray
    period: FloatArray
    quantum: FloatArray

    def __len__(self) -> int:
        return len(self.start)


@dataclass(slots=True)
class _Page:
    """Running moments of consecutive bins; extremes relative to the mean keep float32 exact."""

    count: npt.NDArray[np.int32]  # (P, S)
    mean: FloatArray  # (P, S, 3)
    scatter: Float32Array  # (P, S, 3)
    low: Float32Array  # (P, S, 3)
    high: Float32Array

    @classmethod
    def empty(cls, size: int, streams: int) -> _Page:
        shape = (size, streams, 3)
        return cls(
            np.zeros((size, streams), np.int32),
            np.zeros(shape),
            np.zeros(shape, np.float32),
            np.zeros(shape, np.float32),
            np.zeros(shape, np.float32),
        )


def _merge(a: _Page, b: _Page) -> _Page:
    """Moments of the union of two sets of samples, elementwise (Chan, Golub, LeVeque 1979)."""
    count = a.count + b.count
    share = np.divide(b.count, count, out=np.zeros(count.shape), where=count > 0)[..., None]
    delta = b.mean - a.mean
    # An empty side has mean 0: share is then 0 or 1, which leaves the other side's mean exact.
    mean = np.where(a.count[..., None] > 0, a.mean + share * delta, b.mean)
    scatter = a.scatter + b.scatter + share * a.count[..., None] * delta**2
    has_a, has_b = a.count[..., None] > 0, b.count[..., None] > 0
    low = np.minimum(
        np.where(has_a, a.mean - mean + a.low, np.inf),
        np.where(has_b, b.mean - mean + b.low, np.inf),
    )
    high = np.maximum(
        np.where(has_a, a.mean - mean + a.high, -np.inf),
        np.where(has_b, b.mean - mean + b.high, -np.inf),
    )
    some = has_a | has_b
    return _Page(
        count,
        mean,
        scatter.astype(np.float32),
        np.where(some, low, 0).astype(np.float32),
        np.where(some, high, 0).astype(np.float32),
    )


def _view(page: _Page, rows: slice | IntArray, columns: slice) -> _Page:
    return _Page(
        page.count[rows, columns],
        page.mean[rows, columns],
        page.scatter[rows, columns],
        page.low[rows, columns],
        page.high[rows, columns],
    )


def _store(page: _Page, rows: slice | IntArray, columns: slice, new: _Page) -> None:
    page.count[rows, columns] = new.count
    page.mean[rows, columns] = new.mean
    page.scatter[rows, columns] = new.scatter
    page.low[rows, columns] = new.low
    page.high[rows, columns] = new.high


def _moments(value: FloatArray, first: IntArray, *, extremes: bool) -> _Page:
    """Moments of the samples value (N, 3) in groups that begin at `first`; one stream wide."""
    columns = np.array(value.T, dtype=np.float64, order="C")
    reference = columns[:, :1].copy()
    columns -= reference
    count = np.diff(first, append=len(value))
    mean = np.add.reduceat(columns, first, axis=1)
    mean /= count
    low = high = mean
    if extremes:
        low = np.minimum.reduceat(columns, first, axis=1)
        high = np.maximum.reduceat(columns, first, axis=1)
    np.multiply(columns, columns, out=columns)
    square = np.add.reduceat(columns, first, axis=1)
    scatter = square - count * mean**2
    # A constant reading has no scatter, although the sums round.
    scatter[scatter < 64 * np.finfo(np.float64).eps * square] = 0.0
    return _Page(
        count.astype(np.int32)[:, None],
        (mean + reference).T[:, None],
        scatter.astype(np.float32).T[:, None],
        (low - mean).astype(np.float32).T[:, None],
        (high - mean).astype(np.float32).T[:, None],
    )


class _Binner:
    """Collects bins page by page; coarsens when there are too many."""

    def __init__(self, supports: tuple[str, ...], origin: float, width: float, limit: int) -> None:
        self.supports = supports
        self.streams = 2 * len(supports)
        self.origin, self.width, self.limit = origin, width, limit
        self.pages: dict[int, _Page] = {}
        self.last = np.full(self.streams, -np.inf)
        self.quantum = np.full((self.streams, 3), np.inf)

    def add(self, piece: Log) -> None:
        """Take a piece's samples in."""
        if piece.supports != self.supports:
            raise DataError(
                f"supports {', '.join(piece.supports)} follow {', '.join(self.supports)}",
                hint="give logs of one rig",
            )
        edges: dict[int, list[tuple[slice, IntArray, IntArray]]] = {}
        for stream, series in enumerate((*piece.position, *piece.force)):
            self._check(stream, series)
            key = id(series.time)  # the streams of a table share one time column
            if key not in edges:
                edges[key] = list(self._groups(series.time))
            for rows, index, first in edges[key]:
                value = series.value[rows]
                self._note_quantum(stream, value[:_PEEK])
                forces = stream >= len(self.supports)
                self._put(stream, index, _moments(value, first, extremes=forces))
        if len(self.pages) * _PAGE > self.limit:
            self._coarsen()

    def finish(self, period: FloatArray) -> Bins:
        """All bins in order."""
        kept = []
        n = len(self.supports)
        while self.pages:
            number = min(self.pages)
            page = self.pages.pop(number)
            rows = np.flatnonzero(page.count.any(axis=1))
            kept.append((number * _PAGE + rows, _view(page, rows, slice(None))))
        count = np.concatenate([page.count for _, page in kept]).astype(np.int64)
        mean = np.concatenate([page.mean for _, page in kept])
        mean[count == 0] = np.nan
        return Bins(
            supports=self.supports,
            width=self.width,
            start=self.origin + self.width * np.concatenate([index for index, _ in kept]),
            count=count,
            mean=mean,
            scatter=np.concatenate([page.scatter for _, page in kept]).astype(np.float64),
            low=np.concatenate([page.low[:, n:] for _, page in kept]).astype(np.float64),
            high=np.concatenate([page.high[:, n:] for _, page in kept]).astype(np.float64),
            period=period,
            quantum=np.where(np.isfinite(self.quantum), self.quantum, 0.0),
        )

    def _check(self, stream: int, series: Series) -> None:
        n = len(self.supports)
        where = f"{self.supports[stream % n]}, {'position' if stream < n else 'force'}"
        time, value = series.time, series.value
        if value.shape != (len(time), 3):
            raise DataError(f"expected ({len(time)}, 3) values, got {value.shape}", where=where)
        if not len(time):
            return
        late = np.flatnonzero(~(np.diff(time, prepend=self.last[stream]) >= 0))
        if len(late):
            raise DataError(
                "time steps back or is not a number",
                where=f"{where}, t = {time[late[0]]:.6f} s",
                hint="give the logs in the order of their times, without overlaps",
            )
        if not np.isfinite(value.sum()):
            bad = time[np.flatnonzero(~np.isfinite(value).all(axis=1))[0]]
            raise DataError(
                "a reading is not a number",
                where=f"{where}, t = {bad:.6f} s",
                hint="repair the recording or cut this stretch out",
            )
        self.last[stream] = time[-1]

    def _groups(self, time: FloatArray) -> Iterator[tuple[slice, IntArray, IntArray]]:
        for begin in range(0, len(time), _SLAB):
            rows = slice(begin, begin + _SLAB)
            index = np.floor((time[rows] - self.origin) / self.width).astype(np.int64)
            first = np.flatnonzero(np.diff(index, prepend=index[0] - 1))
            yield rows, index[first], first

    def _note_quantum(self, stream: int, value: FloatArray) -> None:
        step = np.abs(np.diff(value, axis=0))
        smallest = np.where(step > 0, step, np.inf).min(axis=0, initial=np.inf)
        self.quantum[stream] = np.minimum(self.quantum[stream], smallest)

    def _put(self, stream: int, index: IntArray, new: _Page) -> None:
        number = index // _PAGE
        cuts = [0, *(np.flatnonzero(np.diff(number)) + 1), len(index)]
        column = slice(stream, stream + 1)
        for begin, end in pairwise(cuts):
            key = int(number[begin])
            page = self.pages.setdefault(key, _Page.empty(_PAGE, self.streams))
            rows = index[begin:end] - key * _PAGE
            piece = _view(new, slice(begin, end), slice(None))
            # All but the first bin of a piece are new, as a rule.
            known = np.flatnonzero(page.count[rows, stream])
            if len(known):
                merged = _merge(_view(page, rows[known], column), _view(piece, known, slice(None)))
                _store(piece, known, slice(None), merged)
            dense = rows[-1] - rows[0] + 1 == len(rows)
            _store(page, slice(rows[0], rows[-1] + 1) if dense else rows, column, piece)

    def _coarsen(self) -> None:
        """Double the width until the pages are few enough."""
        even, odd = slice(0, None, 2), slice(1, None, 2)
        while len(self.pages) * _PAGE > self.limit and len(self.pages) > 1:
            old, self.pages = self.pages, {}
            for number in sorted(old):
                page, everything = old.pop(number), slice(None)
                half = _merge(_view(page, even, everything), _view(page, odd, everything))
                target = self.pages.setdefault(number // 2, _Page.empty(_PAGE, self.streams))
                begin = (number % 2) * (_PAGE // 2)
                _store(target, np.arange(begin, begin + _PAGE // 2), everything, half)
            self.width *= 2


def _all_series(piece: Log) -> tuple[Series, ...]:
    return (*piece.position, *piece.force)


def _opening(pieces: Iterator[Log]) -> tuple[list[Log], FloatArray, float]:
    """Pieces until each stream has shown its rate; median intervals (S,), s; earliest time, s."""
    held: list[Log] = []
    times: list[list[FloatArray]] = []
    for piece in pieces:
        held.append(piece)
        times = times or [[] for _ in _all_series(piece)]
        for known, series in zip(times, _all_series(piece), strict=True):
            known.append(series.time[:100_000])
        if min(sum(len(t) for t in known) for known in times) >= 1000:
            break
    joined = [np.concatenate(known) for known in times]
    if not joined or min(len(t) for t in joined) < 2:
        raise DataError("the log holds fewer than two samples", hint="record again")
    period = np.array([np.median(np.diff(t)) for t in joined])
    if not np.all(period > 0):
        raise DataError(
            "most samples of a signal carry one and the same time",
            hint="record with times that resolve the sample interval",
        )
    return held, period, min(float(t[0]) for t in joined)


def reduce_to_bins(pieces: Iterable[Log], options: DwellOptions | None = None) -> Bins:
    """Samples → bins, one pass, memory bounded by `options.max_bins`.

    pieces : consecutive in time per stream; streams may differ in rate and times.

    Raises
    ------
    DataError
        for an empty log, times that step back, readings that are not numbers.
    """
    options = options or DwellOptions()
    stream = iter(pieces)
    held, period, begin = _opening(stream)
    width = options.bin_width or max(_WIDTH, 2.0 * float(period.max()))
    # Half a sample early: samples then lie amid the bins, and rounding cannot move them.
    origin = begin - 0.5 * float(period.min())
    binner = _Binner(held[0].supports, origin, width, options.max_bins)
    while held:
        binner.add(held.pop(0))
    for piece in stream:
        binner.add(piece)
    return binner.finish(period)
