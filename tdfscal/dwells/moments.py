"""Moments of samples in consecutive bins, kept by stream while a log passes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tdfscal.records import FloatArray, IntArray

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

_SLAB = 16384  # samples reduced at once; they stay in the cache


@dataclass(frozen=True, slots=True)
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
            self.number[bins],
            self.count[bins],
            self.mean[:, bins],
            self.scatter[:, bins],
            self.low[:, bins],
            self.high[:, bins],
        )


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


def joined(parts: Sequence[Moments]) -> Moments:
    """Bins of several parts, one after the other."""
    return Moments(
        np.concatenate([part.number for part in parts]),
        np.concatenate([part.count for part in parts]),
        np.concatenate([part.mean for part in parts], axis=1),
        np.concatenate([part.scatter for part in parts], axis=1),
        np.concatenate([part.low for part in parts], axis=1),
        np.concatenate([part.high for part in parts], axis=1),
    )


def places(some: IntArray, of: IntArray) -> slice | IntArray:
    """Where the numbers `some` are among others that hold them, ascending both."""
    begin = int(np.searchsorted(of, some[0]))
    end = begin + len(some)
    if end <= len(of) and of[end - 1] == some[-1]:
        return slice(begin, end)
    return np.searchsorted(of, some)


class Stream:
    """Moments of one stream, in the parts that they came in; bins : how many."""

    def __init__(self) -> None:
        self.parts: list[Moments] = []
        self.bins = 0

    def add(self, new: Moments) -> None:
        """Take in what follows."""
        parts = [new]
        if self.parts and self.parts[-1].number[-1] == new.number[0]:
            # The first bin began in the piece before.
            last = self.parts.pop()
            self.bins -= len(last.number)
            met = merge(last.at(slice(-1, None)), new.at(slice(1)))
            parts = [last.at(slice(-1)), met, new.at(slice(1, None))]
        self.parts += [part for part in parts if len(part.number)]
        self.bins += sum(len(part.number) for part in parts)

    def numbers(self) -> IntArray:
        """All bins, ascending."""
        return np.concatenate([part.number for part in self.parts])

    def coarsen(self) -> None:
        """Join bins two by two."""
        if not self.parts:
            return
        fine = joined(self.parts)
        half = fine.number // 2
        even = np.flatnonzero(np.diff(half) == 0)
        alone = np.setdiff1d(np.arange(len(half)), [even, even + 1])
        coarse = joined([fine.at(alone), merge(fine.at(even), fine.at(even + 1))])
        coarse = coarse.at(np.argsort(coarse.number))
        self.parts, self.bins = [replace(coarse, number=coarse.number // 2)], len(coarse.number)
