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
        #: Bins, and samples that do not fill one yet: a time, the smallest, the largest.
        self._bins: list[FloatArray] = []
        self._rest: list[FloatArray] = []

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Take in samples: time (N,), s; value (N, C)."""
        rows = np.concatenate([*self._rest, np.column_stack([time, value, value])])
        whole = len(rows) // self._size * self._size
        self._rest = [rows[whole:].copy()]
        bins = np.concatenate([*self._bins, _joined(rows[:whole], self._size)])
        while len(bins) > _BINS:
            # An odd one at the end stays as if it were two.
            bins = _joined(np.concatenate([bins, bins[len(bins) // 2 * 2 :]]), 2)
            self._size *= 2
        self._bins = [bins]

    def finish(self) -> tuple[FloatArray, FloatArray]:
        """Return time (2M,) and value (2M, C): of each bin its smallest and its largest."""
        rest = [_joined(rows, len(rows)) for rows in self._rest if len(rows)]
        bins = np.concatenate([*self._bins, *rest])
        return np.repeat(bins[:, 0], 2), bins[:, 1:].reshape(2 * len(bins), -1)


def _joined(bins: FloatArray, size: int) -> FloatArray:
    """So many bins (M, 1 + 2C) after the other as one."""
    parts = bins.reshape(-1, size, bins.shape[1])
    low, high = np.split(parts[:, :, 1:], 2, axis=2)
    return np.column_stack([parts[:, :, 0].mean(axis=1), low.min(axis=1), high.max(axis=1)])
