"""What a decimation still needs of its streams: samples, or means of a few of a fast stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.records import BoolArray, FloatArray, IntArray

#: Means of consecutive samples per step of the time base that the kernel works on, where a stream
#: has at least twice as many samples: they weaken 1 Hz by 6e-5, and all streams alike.
_BOXES = 8
#: Differences of times, in steps or in means, that are rounding: 50 ns.
EVEN = 1e-6


@dataclass(slots=True)
class Held:
    """Samples of one group of streams, or means of a few, that are still needed.

    time : (M,). value : (M, C). clipped : (M,), one of the samples stands at its capacity.
    tail : samples of a mean that is not complete. origin, box : s, where means begin, and their
    length; 0 where samples stand for themselves. known : offsets and weights of the last instants.
    """

    time: FloatArray
    value: FloatArray
    clipped: BoolArray
    tail: Samples
    origin: float = 0.0
    box: float = 0.0
    known: tuple[FloatArray, FloatArray, BoolArray] | None = None

    @classmethod
    def empty(cls, columns: int) -> Held:
        """Nothing yet."""
        none = Samples(np.empty(0), np.empty((0, columns)), np.empty(0, dtype=np.bool_))
        return cls(none.time, none.value, none.clipped, none)

    def boxed(self, origin: float, step: float) -> None:
        """Take means from now on, of a stream that is fast enough for it."""
        box = step / _BOXES
        if float(np.median(np.diff(self.time))) > 0.5 * box:
            return
        so_far = Samples(self.time, self.value, self.clipped)
        self.origin, self.box = origin, box
        self.time, self.value, self.clipped = so_far.time[:0], so_far.value[:0], so_far.clipped[:0]
        self.add(so_far)

    def add(self, more: Samples, last: bool = False) -> None:
        """Append samples; last : none follow."""
        if self.box and len(more.time) + len(self.tail.time):
            samples = _joined(self.tail, more)
            number = np.floor((samples.time - self.origin) / self.box + EVEN)
            first = np.flatnonzero(np.diff(number, prepend=-np.inf))
            more, self.tail = _means(samples, first, last)
        joined = _joined(Samples(self.time, self.value, self.clipped), more)
        self.time, self.value, self.clipped = joined.time, joined.value, joined.clipped

    def forget(self, before: float) -> None:
        """Drop what lies before a time."""
        first = int(np.searchsorted(self.time, before))
        self.time, self.value = self.time[first:].copy(), self.value[first:].copy()
        self.clipped = self.clipped[first:].copy()


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of one group of streams: time (M,), value (M, C), and whether one clips (M,)."""

    time: FloatArray
    value: FloatArray
    clipped: BoolArray


def _joined(before: Samples, more: Samples) -> Samples:
    if not len(before.time):
        return more
    return Samples(
        np.concatenate([before.time, more.time]),
        np.concatenate([before.value, more.value]),
        np.concatenate([before.clipped, more.clipped]),
    )


def _means(samples: Samples, first: IntArray, last: bool) -> tuple[Samples, Samples]:
    """Means of the samples from each of `first` to the next, and what is left of the last one."""
    end = len(samples.time) if last else int(first[-1])
    first = first[first < end]
    rest = Samples(samples.time[end:], samples.value[end:], samples.clipped[end:])
    if not first.size:
        return Samples(samples.time[:0], samples.value[:0], samples.clipped[:0]), rest
    count = np.diff(first, append=end)
    return Samples(
        np.add.reduceat(samples.time[:end] - samples.time[0], first) / count + samples.time[0],
        np.add.reduceat(samples.value[:end], first, axis=0) / count[:, None],
        np.logical_or.reduceat(samples.clipped[:end], first),
    ), rest
