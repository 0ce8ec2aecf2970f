"""What a decimation still needs of its streams: samples, or means of a few of a fast stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.records import BoolArray, FloatArray

#: Means of consecutive samples per step of the time base that the kernel works on, where a stream
#: has at least twice as many samples: they weaken 1 Hz by 6e-5, and all streams alike.
_BOXES = 8
#: Differences of times, in steps or in means, that are rounding: 50 ns.
EVEN = 1e-6


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of one group of streams: time (M,), values (M, c) of each, any clips (M,)."""

    time: FloatArray
    values: tuple[FloatArray, ...]
    clipped: BoolArray


@dataclass(frozen=True, slots=True)
class _Open:
    """A mean that is not complete: its place among all, how many samples it has, and the mean."""

    number: float
    count: float
    time: float
    value: FloatArray
    clipped: bool


@dataclass(slots=True)
class Held:
    """Samples of one group of streams, or means of a few, that are still needed.

    time : (M,). value : (M, C). clipped : (M,), one of the samples stands at its capacity.
    origin, box : s, where means begin, and their length; 0 where samples stand for themselves.
    known : offsets and weights of the last instants.
    """

    time: FloatArray
    value: FloatArray
    clipped: BoolArray
    origin: float = 0.0
    box: float = 0.0
    open: _Open | None = None
    known: tuple[FloatArray, FloatArray, BoolArray] | None = None

    @classmethod
    def empty(cls, columns: int) -> Held:
        """Nothing yet."""
        return cls(np.empty(0), np.empty((0, columns)), np.empty(0, dtype=np.bool_))

    def boxed(self, origin: float, step: float) -> None:
        """Take means from now on, of a stream that is fast enough for it."""
        box = step / _BOXES
        if float(np.median(np.diff(self.time))) > 0.5 * box:
            return
        so_far = Samples(self.time, (self.value,), self.clipped)
        self.origin, self.box = origin, box
        self.time, self.value, self.clipped = self.time[:0], self.value[:0], self.clipped[:0]
        self.add(so_far)

    def add(self, more: Samples) -> None:
        """Append samples."""
        if not self.box:
            self._append(more.time, np.concatenate(more.values, axis=1), more.clipped)
        elif more.time.size:
            self._add_means(more)

    def finish(self) -> None:
        """Append the last mean, as it is."""
        last = self.open
        if last is not None:
            self._append(np.array([last.time]), last.value[None], np.array([last.clipped]))
        self.open = None

    def forget(self, before: float) -> None:
        """Drop what lies before a time."""
        first = int(np.searchsorted(self.time, before))
        self.time, self.value = self.time[first:].copy(), self.value[first:].copy()
        self.clipped = self.clipped[first:].copy()

    def _append(self, time: FloatArray, value: FloatArray, clipped: BoolArray) -> None:
        self.time = np.concatenate([self.time, time])
        self.value = np.concatenate([self.value, value])
        self.clipped = np.concatenate([self.clipped, clipped])

    def _add_means(self, more: Samples) -> None:
        """Append the means that are complete; the last one stays open."""
        number = np.floor((more.time - self.origin) / self.box + EVEN)
        first = np.flatnonzero(np.diff(number, prepend=-np.inf))
        count = np.diff(first, append=len(number)).astype(np.float64)
        start = more.time[0]
        time = np.add.reduceat(more.time - start, first) / count + start
        value = np.concatenate([np.add.reduceat(v, first, axis=0) for v in more.values], axis=1)
        value /= count[:, None]
        clipped = np.logical_or.reduceat(more.clipped, first)
        before = self.open
        if before is not None and before.number == number[0]:
            count[0] += before.count
            share = before.count / count[0]
            time[0] += share * (before.time - time[0])
            value[0] += share * (before.value - value[0])
            clipped[0] |= before.clipped
        else:
            self.finish()
        self._append(time[:-1], value[:-1], clipped[:-1])
        self.open = _Open(
            float(number[-1]), float(count[-1]), float(time[-1]), value[-1], bool(clipped[-1])
        )
