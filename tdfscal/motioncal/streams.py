"""All streams of a log on one even, slow time base, decimated while they are read.

What calibrates is slow: a terminal of hundreds of kilograms moves below a hertz. Every stream is
brought to the same instants by one kernel of zero phase, positions and forces alike, so that the
balance of the filtered signals is the filtered balance.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from tdfscal.errors import DataError
from tdfscal.motioncal.held import EVEN, Held, Samples
from tdfscal.records import BoolArray, FloatArray, Log, Series

#: Rate of the even time base, Hz, or that of the slowest stream where it is lower.
RATE = 20.0
#: Half width of the kernel in steps of the time base, and its cut-off as a share of the rate.
_REACH, _CUT = 3.0, 0.4
#: Longest hole in a stream, in steps of the time base, that the kernel bridges.
_HOLE = 1.5
#: Output instants worked on at once.
_CHUNK = 128
#: Rows read before the rate is known, and rows looked at for the step of the positions.
_FIRST, _QUANTUM_SAMPLES = 16, 20_000


@dataclass(frozen=True, slots=True)
class Slow:
    """Streams on an even time base.

    time : (N,), s, ascending; consecutive instants are `step` apart except across gaps.
    position : (N, n, 3), m, BCS. force : (N, n, 3), N, readings. step : s.
    rate : Hz, of the slowest stream as recorded. clipped : (N,), a reading near that instant
    stands at its capacity. quantum : m, least step of the recorded positions. temperature :
    (N, n), °C, at each sensor; None where none is recorded.
    """

    supports: tuple[str, ...]
    time: FloatArray
    position: FloatArray
    force: FloatArray
    step: float
    rate: float
    clipped: BoolArray
    quantum: float = 0.0
    temperature: FloatArray | None = None


@dataclass(slots=True)
class _Out:
    time: list[FloatArray] = field(default_factory=list)
    value: list[FloatArray] = field(default_factory=list)
    clipped: list[BoolArray] = field(default_factory=list)


class Decimator:
    """Takes the pieces of a log as they are read; holds only what is still needed of them.

    capacity : (n, 3), N; a sample at 99.9 % of it is clipped.
    """

    def __init__(self, capacity: FloatArray) -> None:
        self.supports: tuple[str, ...] = ()
        self.quantum = 0.0
        self._full = np.concatenate([np.full(capacity.size, np.inf), 0.999 * capacity.ravel()])
        self._held: list[Held] = []
        self._columns: list[list[int]] = []
        self._members: list[list[int]] = []
        self._pending: list[Series] = []
        self._out = _Out()
        self._step = self._rate = self._start = 0.0
        self._cursor = 0

    def add(self, piece: Log) -> None:
        """Take the next piece. Raises DataError where streams part that shared their stamps."""
        streams = [*piece.position, *piece.force]
        if self._pending:
            streams = [_chained(p, more) for p, more in zip(self._pending, streams, strict=True)]
        if not self._members:
            if min(series.time.size for series in streams) < 2:
                self._pending = streams
                return
            self.supports = piece.supports
            self._members = _groups(streams)
            self._columns = [
                [3 * i + c for i in group for c in range(3)] for group in self._members
            ]
            self._held = [Held.empty(len(c)) for c in self._columns]
            self.quantum = min(_quantum(s.value) for s in piece.position)
        parts = [
            _beside([streams[i] for i in group], self._full[columns])
            for group, columns in zip(self._members, self._columns, strict=True)
        ]
        counts = {
            i: len(part.time)
            for group, part in zip(self._members, parts, strict=True)
            for i in group
        }
        self._pending = [
            Series(series.time[counts[i] :], series.value[counts[i] :])
            for i, series in enumerate(streams)
        ]
        for held, part in zip(self._held, parts, strict=True):
            held.add(part)
        if self._step == 0.0:
            if min(h.time.size for h in self._held) < _FIRST:
                return
            self._rate = min(1 / float(np.median(np.diff(h.time))) for h in self._held)
            self._step = 1 / min(RATE, self._rate)
            self._start = max(float(h.time[0]) for h in self._held)
            for held in self._held:
                held.boxed(self._start, self._step)
        self._advance(int(np.floor((self._reach - self._start) / self._step - _REACH)))

    def finish(self) -> Slow:
        """Return the slow streams. Raises DataError where a stream has too few samples."""
        if self._step == 0.0:
            raise DataError(
                "the log holds too few samples to tell its rate",
                where="log",
                hint="record at least a few seconds of every stream",
            )
        for held in self._held:
            held.finish()
        self._advance(int(np.floor((self._reach - self._start) / self._step)))
        n, out = len(self.supports), self._out
        value = np.concatenate(out.value) if out.value else np.empty((0, 6 * n))
        return Slow(
            supports=self.supports,
            time=np.concatenate(out.time) if out.time else np.empty(0),
            position=value[:, : 3 * n].reshape(-1, n, 3),
            force=value[:, 3 * n :].reshape(-1, n, 3),
            step=self._step,
            rate=self._rate,
            clipped=np.concatenate(out.clipped) if out.clipped else np.empty(0, dtype=np.bool_),
            quantum=self.quantum,
        )

    @property
    def _reach(self) -> float:
        """Time that all streams have reached, s."""
        return min(float(h.time[-1]) if h.time.size else -np.inf for h in self._held)

    def _advance(self, last: int) -> None:
        """Work out the instants up to `last`, and drop the samples that no later one needs."""
        if last < self._cursor:
            return
        _emit(
            self._held, self._columns,
            self._start, self._step, self._cursor, last, self._out,
        )  # fmt: skip
        self._cursor = last + 1
        since = self._start + (self._cursor - _REACH - _HOLE) * self._step
        for held in self._held:
            held.forget(since)


def slow_streams(pieces: Iterable[Log], capacity: FloatArray) -> Slow:
    """Decimate the pieces of a log; see `Decimator`."""
    decimator = Decimator(capacity)
    for piece in pieces:
        decimator.add(piece)
    return decimator.finish()


def _quantum(value: FloatArray) -> float:
    """Least step between different values of the first samples (N, 3) of a stream; 0: none."""
    steps = []
    for column in value[:_QUANTUM_SAMPLES].T:
        different = np.unique(column[np.isfinite(column)])
        if different.size > 1:
            steps.append(float(np.diff(different).min()))
    return min(steps, default=0.0)


def _groups(streams: list[Series]) -> list[list[int]]:
    """Streams that share their stamps; a piece may end between the samples of one instant."""
    left = list(range(len(streams)))
    groups = []
    while left:
        first = streams[left[0]].time
        same = [i for i in left if _alike(first, streams[i].time)]
        left = [i for i in left if i not in same]
        groups.append(same)
    return groups


def _alike(first: FloatArray, other: FloatArray) -> bool:
    count = min(len(first), len(other))
    return first is other or np.array_equal(first[:count], other[:count])


def _beside(streams: list[Series], full: FloatArray) -> Samples:
    """Streams of one group side by side, as far as all of them reach; full : capacities (C,).

    Raises DataError where their stamps part.
    """
    first = streams[0].time
    count = min(len(series.time) for series in streams)
    if any(not _alike(first, series.time) for series in streams):
        raise DataError(
            "streams that shared their time stamps no longer do",
            where=f"log, near {first[0] if first.size else 0.0:.3f} s",
            hint="calibrate the parts of the log apart",
        )
    clipped = np.zeros(count, dtype=np.bool_)
    columns = (column for series in streams for column in series.value[:count].T)
    for column, limit in zip(columns, full, strict=True):
        if np.isfinite(limit):
            clipped |= np.abs(column) >= limit
    return Samples(first[:count], tuple(series.value[:count] for series in streams), clipped)


def _chained(before: Series, more: Series) -> Series:
    if not before.time.size:
        return more
    return Series(
        np.concatenate([before.time, more.time]), np.concatenate([before.value, more.value])
    )


def _kernel(u: FloatArray) -> FloatArray:
    """Low-pass of zero phase at distances u in steps: a sinc under a Hann window."""
    inside = np.abs(u) < _REACH
    weight = np.sinc(2 * _CUT * u) * np.cos(np.pi * u / (2 * _REACH)) ** 2
    return np.asarray(np.where(inside, weight, 0.0))


def _emit(
    held: list[Held],
    columns: list[list[int]],
    start: float,
    step: float,
    first: int,
    last: int,
    out: _Out,
) -> None:
    """Append the instants first … last of the time base that all streams cover."""
    width = sum(len(c) for c in columns)
    for begin in range(first, last + 1, _CHUNK):
        instant = np.arange(begin, min(begin + _CHUNK, last + 1), dtype=np.float64)
        time = np.asarray(start + step * instant)
        value = np.empty((len(time), width))
        good = np.ones(len(time), dtype=np.bool_)
        clipped = np.zeros(len(time), dtype=np.bool_)
        for stream, cols in zip(held, columns, strict=True):
            part, covered, full_scale = _smoothed(stream, time, step)
            value[:, cols] = part
            good &= covered
            clipped |= full_scale
        out.time.append(time[good])
        out.value.append(value[good])
        out.clipped.append(clipped[good])


def _smoothed(
    stream: Held, time: FloatArray, step: float
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Kernel averages (J, C) at times (J,), where the stream covers them, and where it clips."""
    reach = (_REACH + EVEN) * step
    low = np.searchsorted(stream.time, time - reach)
    high = np.searchsorted(stream.time, time + reach, side="right")
    no: BoolArray = np.zeros(len(time), dtype=np.bool_)
    if low[0] == high[-1]:
        return np.zeros((len(time), stream.value.shape[1])), no, no
    stretch = slice(int(low[0]), int(high[-1]))
    stamp, value = stream.time[stretch], stream.value[stretch]
    # Samples about each instant (J, M); those that an instant has fewer are out of its reach.
    near = low[:, None] + np.arange(int((high - low).max()))
    few = near >= high[:, None]
    near = np.minimum(near, high[-1] - 1) - stretch.start
    offset = np.where(few, 2 * _REACH, (stamp[near] - time[:, None]) / step)
    weight, fine = _weights(offset, stream)
    covered, clipped = fine & _without_hole(stamp, time, step), no
    if stream.clipped[stretch].any():
        clipped = ((weight != 0.0) & stream.clipped[stretch][near]).any(axis=1)
    finite = np.asarray(np.isfinite(value).all(axis=1))
    if not finite.all():
        covered &= ~((weight != 0.0) & ~finite[near]).any(axis=1)
        value = np.where(np.isfinite(value), value, 0.0)
    return (weight[:, None] @ value[near])[:, 0], covered, clipped


def _weights(offset: FloatArray, stream: Held) -> tuple[FloatArray, BoolArray]:
    """Weights (J, M) of samples at offsets (J, M) in steps, and where they are enough (J,).

    An even recording has the same offsets again and again.
    """
    known = stream.known
    alike = known is not None and known[0].shape == offset.shape
    if known is not None and alike and np.abs(known[0] - offset).max() < EVEN:
        return known[1], known[2]
    weight = _kernel(offset)
    # A weight that is linear in time keeps straight lines straight, also at the log's ends.
    moment = weight * offset
    s0, s1, s2 = weight.sum(axis=1), moment.sum(axis=1), (moment * offset).sum(axis=1)
    det = s0 * s2 - s1**2
    fine = np.abs(det) > 1e-9 * np.maximum(s0 * s2, 1e-300)
    det = np.where(fine, det, 1.0)[:, None]
    weight = (s2[:, None] * weight - s1[:, None] * moment) / det
    stream.known = offset, weight, fine
    return weight, fine


def _without_hole(stamp: FloatArray, time: FloatArray, step: float) -> BoolArray:
    """Whether no hole of the stream comes near each instant, and the stream reaches it."""
    ok = (time >= stamp[0] - 1e-9) & (time <= stamp[-1] + 1e-9)
    hole = np.flatnonzero(np.diff(stamp) > _HOLE * step)
    for h in hole:
        ok &= (time <= stamp[h]) | (time >= stamp[h + 1])
    return np.asarray(ok)
