"""Smallest and largest values of a long signal over time: enough to draw it, in bounded memory."""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray

#: Bins kept at most; twice what a figure's width can show.
_BINS = 4000


class Envelope:
    """Extremes of a signal of C columns in up to 4000 bins of as many samples each."""

    def __init__(self) -> None:
        self._size = 1
        self._rest: tuple[FloatArray, FloatArray] | None = None
        self._time: list[FloatArray] = []
        self._low: list[FloatArray] = []
        self._high: list[FloatArray] = []
        self._count = 0

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Take in samples: time (N,), s; value (N, C)."""
        if self._rest is not None:
            time = np.concatenate([self._rest[0], time])
            value = np.concatenate([self._rest[1], value])
        whole = len(time) // self._size * self._size
        self._rest = time[whole:].copy(), value[whole:].copy()
        if not whole:
            return
        blocks = value[:whole].reshape(-1, self._size, value.shape[1])
        self._time.append(time[:whole].reshape(-1, self._size).mean(axis=1))
        self._low.append(blocks.min(axis=1))
        self._high.append(blocks.max(axis=1))
        self._count += whole // self._size
        while self._count > _BINS:
            self._halve()

    def _halve(self) -> None:
        """Join neighbouring bins; an odd one at the end stays as if it were two."""
        time, low, high = map(np.concatenate, (self._time, self._low, self._high))
        if len(time) % 2:
            time, low, high = (np.concatenate([a, a[-1:]]) for a in (time, low, high))
        self._time = [time.reshape(-1, 2).mean(axis=1)]
        self._low = [low.reshape(-1, 2, low.shape[1]).min(axis=1)]
        self._high = [high.reshape(-1, 2, high.shape[1]).max(axis=1)]
        self._count, self._size = len(self._time[0]), 2 * self._size

    def finish(self) -> tuple[FloatArray, FloatArray]:
        """Return time (2M,) and value (2M, C): of each bin its smallest and its largest."""
        time, low, high = list(self._time), list(self._low), list(self._high)
        if self._rest is not None and len(self._rest[0]):
            time.append(self._rest[0].mean(keepdims=True))
            low.append(self._rest[1].min(axis=0, keepdims=True))
            high.append(self._rest[1].max(axis=0, keepdims=True))
        both = np.stack([np.concatenate(low), np.concatenate(high)], axis=1)
        return np.repeat(np.concatenate(time), 2), both.reshape(-1, both.shape[2])
