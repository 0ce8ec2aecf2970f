"""All streams of a log on one even, slow time base, decimated while they are read.

What calibrates is slow: a terminal of hundreds of kilograms moves below a hertz. Every stream is
brought to the same instants by one kernel of zero phase, positions and forces alike, so that the
balance of the filtered signals is the filtered balance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.dynamics import Moving
from tdfscal.model.samples_in_motion import joined, together
from tdfscal.numerics.streams import even_spline
from tdfscal.records import BoolArray, FloatArray, Log, Series

#: Rate of the even time base, Hz, or that of the slowest stream where it is lower.
RATE = 20.0
#: Half width of the kernel in steps of the time base, and its cut-off as a share of the rate.
REACH, _CUT = 3.0, 0.4
#: Least sum of the kernel's weights, as a share of their sizes: else its side lobes prevail.
_LOBES = 0.2
#: Means of consecutive samples per step of the time base that the kernel works on, where a stream
#: has at least twice as many samples: they weaken 1 Hz by 6e-5, and all streams alike.
_BOXES = 8
#: Differences of times, in steps or in means, that are rounding: 50 ns.
_EVEN = 1e-6
#: Differences of stamps, in steps, that a sum of as many means as a log has rounds off.
_ALIKE = 1e-8
#: Longest hole in a stream, in steps of the time base, that the kernel bridges.
_HOLE = 1.5
#: Steps beyond an instant, at least, in which nothing bears on it.
_PAST = REACH + _HOLE
#: Weights of output instants worked out at once, in a cache.
_CHUNK = 6144
#: Rows read before the rate is known, and rows looked at for the step of the positions.
_FIRST, _QUANTUM_SAMPLES = 16, 20_000
#: Share of a capacity from which on a reading is clipped.
_CLIPPED = 0.999


@record
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


class Decimator:
    """Takes the pieces of a log as they are read; holds only what is still needed of them.

    capacity : (n, 3), N; a sample at 99.9 % of it is clipped.
    """

    def __init__(self, capacity: FloatArray) -> None:
        self._full = np.concatenate([np.full_like(capacity, np.inf), _CLIPPED * capacity])
        self._supports: tuple[str, ...] = ()
        self._first: list[Series] = []
        self._groups: list[_Group] = []
        self._out = [np.empty((0, 2 + self._full.size))]
        self._quantum = self._rate = self._start = self._step = 0.0
        self._cursor, self._chunk = 0, 1

    def add(self, piece: Log) -> None:
        """Take the next piece."""
        self._supports, streams = piece.supports, [*piece.position, *piece.force]
        if not self._groups:
            streams = list(map(joined, self._first, streams)) if self._first else streams
            if min(len(stream.time) for stream in streams) < _FIRST:
                self._first = streams
                return
            self._begin(streams)
        if len(self._groups) == 1 and not together(streams):
            self._groups = self._groups[0].parted()
        members = len(streams) // len(self._groups)
        for k, group in enumerate(self._groups):
            group.add(streams[members * k : members * (k + 1)])
        self._advance(REACH)

    def finish(self) -> Slow:
        """Return the slow streams. Raises DataError where the log is too short for any."""
        for group in self._groups:
            group.finish()
        if self._groups:
            self._advance(0.0)
        samples = np.concatenate(self._out)
        if not len(samples):
            raise DataError(Finding("streams-short"))
        time, clipped, value = np.split(samples, [1, 2], axis=1)
        position, force = np.split(value.reshape(len(value), -1, 3), 2, axis=1)
        return Slow(
            supports=self._supports,
            time=self._start + time[:, 0],
            position=position.copy(),
            force=force.copy(),
            step=self._step,
            rate=self._rate,
            clipped=clipped[:, 0] > 0,
            quantum=self._quantum,
        )

    def _begin(self, streams: list[Series]) -> None:
        """Lay out the time base, for streams that share their stamps together."""
        spacing = [float(np.median(np.diff(stream.time))) for stream in streams]
        self._quantum = min(_quantum(stream.value) for stream in streams[: len(self._supports)])
        self._rate = 1 / max(spacing)
        self._step = 1 / min(RATE, self._rate)
        self._start = max(float(stream.time[0]) for stream in streams)
        parts = [self._full] if together(streams) else np.split(self._full, len(streams))
        self._groups = [
            _Group(full, own, self._start, self._step)
            for full, own in zip(parts, spacing[: len(parts)], strict=True)
        ]
        about = 2 * REACH * self._step / min(group.spacing for group in self._groups)
        self._chunk = max(1, int(_CHUNK / about))

    def _advance(self, short: float) -> None:
        """Work out the instants up to some steps short of what all streams have reached."""
        reach = min(group.reach for group in self._groups) / self._step - short
        last = int(np.floor(reach)) if reach >= self._cursor else self._cursor - 1
        begin = self._cursor
        while begin <= last:
            # A pause has no instants: whole chunks of it are passed over.
            clear = max(group.next_stamp((begin - _PAST) * self._step) for group in self._groups)
            passed = (min(clear / self._step, last) - _PAST - begin) // self._chunk
            begin += self._chunk * max(int(passed), 0)
            instant = np.arange(begin, min(begin + self._chunk, last + 1), dtype=np.float64)
            time = np.asarray(self._step * instant)
            parts = [group.at(time) for group in self._groups]
            clipped = sum(part[:, :1] for part in parts)
            out = np.hstack([time[:, None], clipped, *(part[:, 1:] for part in parts)])
            self._out.append(out[np.isfinite(out).all(axis=1)])
            begin += self._chunk
        self._cursor = last + 1
        for group in self._groups:
            group.forget((self._cursor - _PAST) * self._step)


def slow_streams(pieces: Iterable[Log], capacity: FloatArray) -> Slow:
    """Decimate the pieces of a log; see `Decimator`."""
    decimator = Decimator(capacity)
    for piece in pieces:
        decimator.add(piece)
    return decimator.finish()


class _Group:
    """What is still needed of m streams that share their stamps: samples, or means of a few.

    full : (m, 3), size from which on a value is clipped. spacing, step : s, of the stamps and of
    the time base. start : s, from which times count.
    """

    def __init__(self, full: FloatArray, spacing: float, start: float, step: float) -> None:
        self._full, self._start, self._step = full, start, step
        #: Length of the means, s; 0 where samples stand for themselves.
        self._box = step / _BOXES if spacing <= 0.5 * step / _BOXES else 0.0
        self.spacing = self._box or spacing
        #: Samples of each mean, time, share that is clipped, values; and sums of a mean that is not
        #: complete, after its place among all.
        self._rows = np.empty((0, 3 + full.size))
        self._open = np.empty((0, 4 + full.size))

    @property
    def reach(self) -> float:
        """Time that the rows have reached, s."""
        return float(self._stamps[-1]) if len(self._rows) else -np.inf

    @property
    def _stamps(self) -> FloatArray:
        return self._rows[:, 1]

    def parted(self) -> list[_Group]:
        """The streams each by itself, from now on."""
        out = []
        for i, full in enumerate(self._full):
            one = copy(self)
            own = [0, 1, 2, *range(3 * i + 3, 3 * i + 6)]
            one._full, one._rows = full[None], self._rows[:, own]
            one._open = self._open[:, [0, *(1 + k for k in own)]]
            out.append(one)
        return out

    def add(self, streams: Sequence[Series]) -> None:
        """Append samples, or the means of those that are complete; the last one stays open."""
        time, values = streams[0].time - self._start, [stream.value for stream in streams]
        clipped = np.zeros(len(time))
        for value, full in zip(values, self._full, strict=True):
            if np.isfinite(full).any():
                clipped[(np.abs(value) >= full).any(axis=1)] = 1.0
        if not self._box:
            alone = np.column_stack([np.ones(len(time)), time, clipped, *values])
            self._rows = np.vstack([self._rows, alone])
        elif len(time):
            number = np.floor(time / self._box + _EVEN)
            first = np.flatnonzero(np.diff(number, prepend=-np.inf))
            sums = [np.add.reduceat(part, first, axis=0) for part in (time, clipped, *values)]
            count = np.diff(first, append=len(time))
            means = np.column_stack([number[first], count, *sums])
            if len(self._open) and self._open[0, 0] == means[0, 0]:
                means[0, 1:] += self._open[0, 1:]
            else:
                means = np.vstack([self._open, means])
            self._rows = np.vstack([self._rows, _mean(means[:-1, 1:])])
            self._open = means[-1:]

    def finish(self) -> None:
        """Append the last mean, as it is."""
        self._rows = np.vstack([self._rows, _mean(self._open[:, 1:])])

    def next_stamp(self, time: float) -> float:
        """Return the first stamp that is not before a time, s; ∞ where there is none."""
        k = int(np.searchsorted(self._stamps, time))
        return float(self._stamps[k]) if k < len(self._rows) else np.inf

    def forget(self, before: float) -> None:
        """Drop what lies before a time."""
        self._rows = self._rows[int(np.searchsorted(self._stamps, before)) :].copy()

    def at(self, time: FloatArray) -> FloatArray:
        """Whether the streams are clipped at times (J,), and their kernel averages, (J, 1 + 3 m).

        NaN where the streams do not cover them.
        """
        stamps, reach = self._stamps, (REACH + _EVEN) * self._step
        low = np.searchsorted(stamps, time - reach)
        high = np.searchsorted(stamps, time + reach, side="right")
        if low[0] == high[-1]:
            return np.full((len(time), self._rows.shape[1] - 2), np.nan)
        rows = self._rows[low[0] : high[-1]]
        # Samples about each instant (J, M); those that an instant has fewer are out of its reach.
        near = low[:, None] + np.arange(int((high - low).max()))
        few = near >= high[:, None]
        near = np.minimum(near, high[-1] - 1) - low[0]
        offset = np.where(few, 2 * REACH, (rows[near, 1] - time[:, None]) / self._step)
        count = rows[near, 0]
        # Even stamps lie alike about every instant.
        even = np.abs(offset - offset[0]).max() < _ALIKE and (count == count[0]).all()
        weight, covered = _weights(offset[:1], count[:1]) if even else _weights(offset, count)
        used: BoolArray = weight != 0.0
        finite = np.asarray(np.isfinite(rows).all(axis=1))
        covered = covered & _without_hole(rows[:, 1], time, self._step)
        covered &= (finite[near] | ~used).all(axis=1)
        value = np.where(finite[:, None], rows[:, 2:], 0.0)
        out: FloatArray = (weight[:, None] @ value[near])[:, 0]
        out[:, 0] = (used & (rows[near, 2] > 0)).any(axis=1)
        out[~covered] = np.nan
        return out


def _mean(sums: FloatArray) -> FloatArray:
    """Counts and means (N, c) of counts and sums (N, c)."""
    return np.concatenate([sums[:, :1], sums[:, 1:] / sums[:, :1]], axis=1)


def _weights(offset: FloatArray, count: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Weights (J, M) of means at offsets (J, M) in steps, and where they are enough (J,).

    count : (J, M), samples of each mean: every sample weighs by where it is, not by how many
    happen to share its mean.
    """
    # Low-pass of zero phase: a sinc under a Hann window.
    near = np.abs(offset) < REACH
    window = np.where(near, count * np.cos(np.pi * offset / (2 * REACH)) ** 2, 0.0)
    weight = np.sinc(2 * _CUT * offset) * window
    total = weight.sum(axis=1)
    fine = total > _LOBES * np.abs(weight).sum(axis=1)
    weight = weight / np.where(fine, total, 1.0)[:, None]
    # What is added keeps straight lines straight, at the log's ends and under stamps that jitter:
    # the window times a line in time, as a sinc's own second moment is next to none.
    moment = window * offset
    h0, h1, h2 = window.sum(axis=1), moment.sum(axis=1), (moment * offset).sum(axis=1)
    det = h0 * h2 - h1**2
    fine &= det > 1e-9 * np.maximum(h0 * h2, 1e-300)
    added = -(weight * offset).sum(axis=1) / np.where(fine, det, 1.0)
    return weight + added[:, None] * (h0[:, None] * moment - h1[:, None] * window), fine


def _quantum(value: FloatArray) -> float:
    """Least step between different values of the first samples (N, 3) of a stream; 0: none."""
    steps = []
    for column in value[:_QUANTUM_SAMPLES].T:
        different = np.unique(column[np.isfinite(column)])
        if different.size > 1:
            steps.append(float(np.diff(different).min()))
    return min(steps, default=0.0)


def _without_hole(stamp: FloatArray, time: FloatArray, step: float) -> BoolArray:
    """Whether no hole of the stream comes near each instant, and the stream reaches it."""
    ok = (time >= stamp[0] - 1e-9) & (time <= stamp[-1] + 1e-9)
    for h in np.flatnonzero(np.diff(stamp) > _HOLE * step):
        ok &= (time <= stamp[h]) | (time >= stamp[h + 1])
    return np.asarray(ok)


def shifted(slow: Slow, rows: slice, moving: Moving) -> FloatArray:
    """Servo positions (N, n, 3) at the instants at which the forces of these rows were felt."""
    lag = moving.lag(after_middle(slow, rows))
    return course_of(slow, rows)(lag) if lag.any() else slow.position[rows]


def after_middle(slow: Slow, rows: slice) -> FloatArray:
    """Times (N,), s, of these rows after the middle of the log."""
    return np.asarray(slow.time[rows] - (slow.time[0] + slow.time[-1]) / 2)


def course_of(slow: Slow, rows: slice) -> Callable[[FloatArray], FloatArray]:
    """Servo positions (N, n, 3) of these rows as a function of their delays (N,), s."""
    course = even_spline(slow.position[rows])
    place = np.arange(len(slow.time[rows]), dtype=np.float64)
    return lambda lag: course(np.clip(place - lag / slow.step, 0.0, place[-1]))
