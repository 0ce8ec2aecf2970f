"""Moments of samples in consecutive bins, and a store of them that grows page by page."""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from tdfscal.records import FloatArray, IntArray

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

_PAGE = 1024  # bins allocated at once; a gap of hours between two logs then costs nothing
_FIRST_PAGES = 256  # those of an hour and a half
_SLACK = 16
_SLAB = 16384  # samples reduced at once; they stay in the cache


@dataclass(frozen=True, slots=True)
class Moments:
    """Of the samples of one stream in P bins.

    count : (P,). mean : (3, P), 0 in an empty bin. scatter : (3, P), sum of squared deviations.
    low, high : (3, P), extremes less the mean, which keeps float32 exact; None for a position.
    """

    count: Int32Array
    mean: FloatArray
    scatter: Float32Array
    low: Float32Array | None
    high: Float32Array | None

    def at(self, bins: slice | IntArray) -> Moments:
        """Some of the bins; a view where they are a slice."""
        low = None if self.low is None else self.low[:, bins]
        high = None if self.high is None else self.high[:, bins]
        return Moments(self.count[bins], self.mean[:, bins], self.scatter[:, bins], low, high)

    def put(self, bins: slice | IntArray, new: Moments) -> None:
        """Overwrite some of the bins."""
        self.count[bins] = new.count
        self.mean[:, bins] = new.mean
        self.scatter[:, bins] = new.scatter
        if self.low is not None and self.high is not None:
            self.low[:, bins] = new.low
            self.high[:, bins] = new.high


def moments(value: FloatArray, first: IntArray, *, extremes: bool) -> Moments:
    """Moments of the samples value (N, 3) in G groups that begin at `first`, (G,)."""
    bounds = np.append(first, len(value))
    count = np.diff(bounds)
    mean, scatter = np.empty((3, len(first))), np.empty((3, len(first)), np.float32)
    low, high = (np.empty_like(scatter) if extremes else None for _ in range(2))
    scratch = np.empty(0)
    for part, groups in _slabs(bounds):
        samples = groups.of(value[bounds[part.start] : bounds[part.stop]].T)
        if scratch.size < samples.size:
            scratch = np.empty(samples.size)
        reference = value[bounds[part.start]]
        deviation = scratch[: samples.size].reshape(samples.shape)
        np.subtract(samples.T, reference, out=deviation.T)
        middle = groups.reduced(np.add, deviation)
        middle /= count[part]
        mean[:, part] = middle + reference[:, None]
        deviation -= groups.spread(middle)
        if low is not None and high is not None:
            low[:, part] = groups.reduced(np.minimum, deviation)
            high[:, part] = groups.reduced(np.maximum, deviation)
        np.multiply(deviation, deviation, out=deviation)
        square = groups.reduced(np.add, deviation)
        # A constant reading has no scatter, although its mean rounds.
        square[square < count[part] * (64 * np.finfo(np.float64).eps * middle) ** 2] = 0.0
        scatter[:, part] = square
    return Moments(count.astype(np.int32), mean, scatter, low, high)


@dataclass(frozen=True, slots=True)
class _Uneven:
    """Groups of any size, (G,), one after the other."""

    start: IntArray
    size: IntArray

    def of(self, samples: FloatArray) -> FloatArray:
        """(3, N) as it is."""
        return samples

    def reduced(self, ufunc: np.ufunc, samples: FloatArray) -> FloatArray:
        """(3, G)."""
        return np.asarray(ufunc.reduceat(samples, self.start, axis=1))

    def spread(self, group: FloatArray) -> FloatArray:
        """(3, G) → (3, N)."""
        return np.repeat(group, self.size, axis=1)


@dataclass(frozen=True, slots=True)
class _Even:
    """Groups of one size: sample k of all of them is a row, and whole rows are added."""

    size: int

    def of(self, samples: FloatArray) -> FloatArray:
        """(3, N) → (3, size, G), a view."""
        return samples.reshape(3, -1, self.size).transpose(0, 2, 1)

    def reduced(self, ufunc: np.ufunc, samples: FloatArray) -> FloatArray:
        """(3, G)."""
        return np.asarray(ufunc.reduce(samples, axis=1))

    def spread(self, group: FloatArray) -> FloatArray:
        """(3, G) → (3, 1, G)."""
        return group[:, None]


def _slabs(bounds: IntArray) -> Iterator[tuple[slice, _Even | _Uneven]]:
    """Groups that are reduced at once: about _SLAB samples, or one group."""
    size = np.diff(bounds)
    begin, end = _alike(size)
    cuts = np.searchsorted(bounds, np.arange(0, bounds[-1], _SLAB))
    for start, stop in pairwise(np.unique([*cuts, begin, end, len(size)]).tolist()):
        if begin <= start < end:
            yield slice(start, stop), _Even(int(size[start]))
        else:
            part = slice(start, stop)
            yield part, _Uneven(bounds[part] - bounds[start], size[part])


def _alike(size: IntArray) -> tuple[int, int]:
    """The longest run of groups of one size: most of them where the clock is steady."""
    change = np.concatenate(([0], np.flatnonzero(np.diff(size)) + 1, [len(size)]))
    k = int(np.argmax(np.diff(change)))
    return int(change[k]), int(change[k + 1])


def merge(a: Moments, b: Moments) -> Moments:
    """Moments of the union of two sets of samples, elementwise (Chan, Golub, LeVeque 1979)."""
    count = a.count + b.count
    share = np.divide(b.count, count, out=np.zeros(count.shape), where=count > 0)
    delta = b.mean - a.mean
    # An empty side has mean 0: share is then 0 or 1, which leaves the other side's mean exact.
    mean = np.where(a.count > 0, a.mean + share * delta, b.mean)
    scatter = (a.scatter + b.scatter + share * a.count * delta**2).astype(np.float32)
    if a.low is None or a.high is None or b.low is None or b.high is None:
        return Moments(count, mean, scatter, None, None)
    of_a, of_b = a.mean - mean, b.mean - mean
    low = np.minimum(
        np.where(a.count > 0, of_a + a.low, np.inf), np.where(b.count > 0, of_b + b.low, np.inf)
    )
    high = np.maximum(
        np.where(a.count > 0, of_a + a.high, -np.inf), np.where(b.count > 0, of_b + b.high, -np.inf)
    )
    low, high = (np.where(count > 0, x, 0.0).astype(np.float32) for x in (low, high))
    return Moments(count, mean, scatter, low, high)


_ZERO = np.zeros(1, np.float32)
_NOTHING = Moments(np.zeros(1, np.int32), np.zeros(1), _ZERO, _ZERO, _ZERO)


@dataclass(slots=True)
class _Arrays:
    """Moments of all S streams in C bins; bins never written take no memory.

    count : (S, C). mean, scatter : (S, 3, C). low, high : of the forces, (S/2, 3, C).
    """

    count: Int32Array
    mean: FloatArray
    scatter: Float32Array
    low: Float32Array
    high: Float32Array

    @classmethod
    def empty(cls, streams: int, bins: int) -> _Arrays:
        all_streams, forces = (streams, 3, bins), (streams // 2, 3, bins)
        return cls(
            _untouched((streams, bins), np.int32),
            _untouched(all_streams, np.float64),
            _untouched(all_streams, np.float32),
            _untouched(forces, np.float32),
            _untouched(forces, np.float32),
        )

    def of(self, stream: int) -> Moments:
        """A view of one stream."""
        force = stream - len(self.low)
        return Moments(
            self.count[stream],
            self.mean[stream],
            self.scatter[stream],
            self.low[force] if force >= 0 else None,
            self.high[force] if force >= 0 else None,
        )


def _untouched(shape: tuple[int, ...], dtype: type[np.generic]) -> npt.NDArray[Any]:
    """Zeros whose pages take memory once they are written; numpy's own come in huge pages."""
    size = math.prod(shape)
    private = {"flags": mmap.MAP_PRIVATE} if hasattr(mmap, "MAP_PRIVATE") else {}
    pages = mmap.mmap(-1, max(size * np.dtype(dtype).itemsize, 1), **private)
    return np.frombuffer(pages, dtype, size).reshape(shape)


class Store:
    """Moments by stream and by number of bin; only stretches that hold samples take memory.

    limit : bins that it will hold as a rule.
    """

    def __init__(self, streams: int, limit: int) -> None:
        self._streams = streams
        self._slot: dict[int, int] = {}  # page → its place in the arrays
        pages = min(-(-limit // _PAGE), _FIRST_PAGES) + _SLACK
        self._arrays = _Arrays.empty(streams, pages * _PAGE)

    @property
    def size(self) -> int:
        """Bins allocated."""
        return len(self._slot) * _PAGE

    def places(self, index: IntArray) -> IntArray:
        """Where in the store the bins `index`, ascending, are; good until it is coarsened."""
        page, inside = np.divmod(index, _PAGE)
        pages, which = np.unique(page, return_inverse=True)
        slots = [self._slot.setdefault(one, len(self._slot)) for one in pages.tolist()]
        self._grow()
        return np.asarray(np.array(slots)[which] * _PAGE + inside)

    def add(self, stream: int, place: IntArray, new: Moments) -> None:
        """Take in moments of the bins at `place`."""
        known = self._arrays.of(stream)
        dense = place[-1] - place[0] + 1 == len(place) and bool((np.diff(place) == 1).all())
        span = slice(int(place[0]), int(place[-1]) + 1) if dense else place
        met = np.flatnonzero(known.count[span])
        if len(met):
            # The first bin of a piece, as a rule: it began in the piece before.
            joined = merge(known.at(place[met]), new.at(met))
            known.put(span, new)
            known.put(place[met], joined)
        else:
            known.put(span, new)

    def coarsen(self) -> bool:
        """Join bins two by two; False where that saves nothing."""
        if len(self._slot) < 2:
            return False
        self._order()
        pages, self._slot = list(self._slot), {}
        # In place: what a page is joined into is never behind it.
        for k, page in enumerate(pages):
            new = page // 2 not in self._slot
            target = self._slot.setdefault(page // 2, len(self._slot)) * _PAGE
            half = target + (page % 2) * (_PAGE // 2)
            even, odd = (slice(k * _PAGE + j, (k + 1) * _PAGE, 2) for j in (0, 1))
            for stream in range(self._streams):
                known = self._arrays.of(stream)
                joined = merge(known.at(even), known.at(odd))
                if new:
                    known.put(slice(target, target + _PAGE), _NOTHING)
                known.put(slice(half, half + _PAGE // 2), joined)
        rest = slice(len(self._slot) * _PAGE, len(pages) * _PAGE)
        for stream in range(self._streams):
            self._arrays.of(stream).put(rest, _NOTHING)
        return True

    def _order(self) -> None:
        """Put the pages in the order of their numbers, which they have as a rule."""
        pages = sorted(self._slot)
        if pages != list(self._slot):
            slots = np.array([self._slot[page] for page in pages])
            place = (slots[:, None] * _PAGE + np.arange(_PAGE)).ravel()
            for one in fields(self._arrays):  # one after the other, for the memory
                whole = getattr(self._arrays, one.name)
                whole[..., : len(place)] = whole[..., place]
            self._slot = {page: slot for slot, page in enumerate(pages)}

    def finish(self) -> tuple[IntArray, _Arrays]:
        """Numbers (B,) of the bins that hold samples, ascending, and their moments.

        The store is of no use afterwards.
        """
        self._order()
        arrays = self._arrays
        number = (np.array(list(self._slot))[:, None] * _PAGE + np.arange(_PAGE)).ravel()
        held = np.flatnonzero(arrays.count[:, : len(number)].max(axis=0))
        dense = len(held) == held[-1] + 1
        for one in fields(arrays):
            whole = getattr(arrays, one.name)
            if not dense:
                whole[..., : len(held)] = whole[..., held]
            setattr(arrays, one.name, whole[..., : len(held)])
        return number[held], arrays

    def _grow(self) -> None:
        needed, capacity = len(self._slot), self._arrays.count.shape[1] // _PAGE
        if needed <= capacity:
            return
        old = self._arrays
        self._arrays = _Arrays.empty(self._streams, max(2 * capacity, needed + _SLACK) * _PAGE)
        for one in fields(old):
            getattr(self._arrays, one.name)[..., : capacity * _PAGE] = getattr(old, one.name)
