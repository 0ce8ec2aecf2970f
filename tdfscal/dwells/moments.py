"""Moments of samples in consecutive bins, kept by stream while a log passes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tdfscal.frozen import record, replace
from tdfscal.records import FloatArray, IntArray

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

_SLAB = 16384  # samples reduced at once; they stay in the cache


@record
class Moments:
    """Of the samples of one stream in the P bins that hold any.

    number : (P,), ascending. count : (P,). mean : (3, P). scatter : (3, P), sum of squared
    deviations. low, high : (3, P), extremes less the mean, which keeps float32 exact; (0, P) for
    a position.
    """

    number: IntArray
    count: Int32Array
    mean: FloatArray
    scatter: Float32Array
    low: Float32Array
    high: Float32Array

    def at(self, bins: slice | IntArray) -> Moments:
        """Some of the bins; a view where they are a slice."""
        return Moments(
            self.number[..., bins],
            self.count[..., bins],
            self.mean[..., bins],
            self.scatter[..., bins],
            self.low[..., bins],
            self.high[..., bins],
        )

    def put(self, bins: slice | IntArray, new: Moments) -> None:
        """Overwrite some of the bins."""
        self.count[bins], self.mean[:, bins] = new.count, new.mean
        self.scatter[:, bins] = new.scatter
        self.low[:, bins], self.high[:, bins] = new.low, new.high


def moments(value: FloatArray, number: IntArray, first: IntArray, *, extremes: bool) -> Moments:
    """Moments of the samples value (N, 3) in bins `number` that begin at `first`, (P,) both."""
    bounds = np.append(first, len(value))
    count = np.diff(bounds)
    mean, scatter = np.empty((3, len(first))), np.empty((3, len(first)), np.float32)
    low, high = (np.empty((3 if extremes else 0, len(first)), np.float32) for _ in range(2))
    for start, stop, even in _slabs(bounds):
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
    return Moments(number, count.astype(np.int32), mean, scatter, low, high)


def _reduced(ufunc: np.ufunc, value: FloatArray, begin: IntArray | None) -> FloatArray:
    """Each bin's (3, G), of (3, N) where bins begin at `begin`, of (3, size, G) without."""
    if begin is None:
        return np.asarray(ufunc.reduce(value, axis=1))
    return np.asarray(ufunc.reduceat(value, begin, axis=1))


def _slabs(bounds: IntArray) -> Iterator[tuple[int, int, bool]]:
    """Bins that are reduced at once, about _SLAB samples or one bin, and whether of one size.

    The longest run of bins of one size is taken as such: most of them where the clock is steady.
    """
    size = np.diff(bounds)
    change = np.concatenate(([0], np.flatnonzero(np.diff(size)) + 1, [len(size)]))
    k = int(np.argmax(np.diff(change)))
    cuts = np.searchsorted(bounds, np.arange(0, bounds[-1], _SLAB))
    for start, stop in pairwise(np.unique([*cuts, *change[k : k + 2], len(size)]).tolist()):
        yield start, stop, bool(change[k] <= start < change[k + 1])


def merge(a: Moments, b: Moments) -> Moments:
    """Moments of the union of two sets of samples, elementwise (Chan, Golub, LeVeque 1979)."""
    count = a.count + b.count
    share = b.count / count
    delta = b.mean - a.mean
    mean = a.mean + share * delta
    scatter = a.scatter + b.scatter + share * a.count * delta**2
    # None of a position, whose extremes have no rows.
    of_a, of_b = (x.mean[: len(x.low)] - mean[: len(x.low)] for x in (a, b))
    low, high = np.minimum(of_a + a.low, of_b + b.low), np.maximum(of_a + a.high, of_b + b.high)
    kept = (x.astype(np.float32) for x in (scatter, low, high))
    return Moments(a.number, count, mean, *kept)


def _joined(parts: Sequence[Moments]) -> Moments:
    """Moments of consecutive bins, part after part."""
    if len(parts) == 1:
        return parts[0]
    each = ([getattr(part, field.name) for part in parts] for field in fields(Moments))
    return Moments(*(np.concatenate(arrays, axis=-1) for arrays in each))


class Streams:
    """Moments of S streams, positions first, each in the order of time, as pieces come."""

    def __init__(self, streams: int) -> None:
        self._parts: list[list[Moments]] = [[] for _ in range(streams)]

    def __len__(self) -> int:
        return max(sum(len(part.number) for part in parts) for parts in self._parts)

    def add(self, stream: int, new: Moments) -> None:
        """Take in what follows."""
        parts, last = self._parts[stream], slice(-1, None)
        if parts and parts[-1].number[-1] == new.number[0]:
            # The first bin began in the piece before.
            parts[-1].put(last, merge(parts[-1].at(last), new.at(slice(1))))
            new = new.at(slice(1, None))
        if len(new.number):
            parts.append(new)

    def coarsen(self) -> None:
        """Join bins two by two."""
        for parts in self._parts:
            fine = _joined(parts)
            fine = replace(fine, number=fine.number // 2)
            first = np.flatnonzero(np.diff(fine.number, prepend=-1))
            two = np.flatnonzero(np.diff(fine.number) == 0)
            coarse = fine.at(first)
            coarse.put(np.searchsorted(first, two), merge(fine.at(two), fine.at(two + 1)))
            parts[:] = [coarse]

    def finish(self) -> Moments:
        """All streams' moments, (S, …, B), in the bins that hold any sample.

        NaN is the mean, and 0 the count, of a stream without one; positions have no extremes.
        """
        held = [_joined(parts) for parts in self._parts]
        number = held[0].number
        for own in held[1:]:
            if not np.array_equal(own.number, number):
                number = np.union1d(own.number, number)
        S, half, B = len(held), len(held) // 2, len(number)
        low, high, scatter = (np.zeros((k, 3, B), np.float32) for k in (half, half, S))
        mean, count = np.full((S, 3, B), np.nan), np.zeros((S, B), np.int32)
        for k, own in enumerate(held):
            here = np.searchsorted(number, own.number)
            count[k, here], mean[k][:, here], scatter[k][:, here] = own.count, own.mean, own.scatter
            if k >= half:
                low[k - half][:, here], high[k - half][:, here] = own.low, own.high
        return Moments(number, count, mean, scatter, low, high)
