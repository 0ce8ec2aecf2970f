"""Temperatures of a log, kept while it passes and averaged over each stretch of rest."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.records import FloatArray, Log

_STEP = 0.5  # s; a temperature changes slowly, and is kept as means over this time


@dataclass(slots=True)
class Thermometer:
    """Lets pieces of a log pass and keeps their temperatures as means over short steps.

    time, value : per field, pieces of (steps,), s and °C.
    """

    rows: bool = False
    time: list[list[FloatArray]] = field(default_factory=list)
    value: list[list[FloatArray]] = field(default_factory=list)

    def passing(self, pieces: Iterable[Log]) -> Iterator[Log]:
        """Pass pieces on."""
        for piece in pieces:
            self.rows = piece.rows == "postures"
            self.time = self.time or [[] for _ in piece.temperature]
            self.value = self.value or [[] for _ in piece.temperature]
            for series, time, value in zip(piece.temperature, self.time, self.value, strict=True):
                known = np.isfinite(series.value[:, 0])
                if known.any():
                    stamps, celsius = series.time[known], series.value[known, 0]
                    step = np.floor(stamps / _STEP) if not self.rows else stamps
                    first = np.flatnonzero(np.append(True, np.diff(step) > 0))
                    count = np.diff(np.append(first, len(step)))
                    time.append(np.add.reduceat(stamps, first) / count)
                    value.append(np.add.reduceat(celsius, first) / count)
            yield piece

    def at(self, start: FloatArray, end: FloatArray, n: int) -> FloatArray | None:
        """Mean temperature (K, n), °C, over K stretches at n sensors; None where none is recorded.

        A stretch without a sample gets what lies between its neighbours. Raises DataError where a
        field holds no number.
        """
        if not self.time:
            return None
        columns = []
        for times, values in zip(self.time, self.value, strict=True):
            if not times:
                raise DataError(Finding("temperature-unreadable"))
            time, value = np.concatenate(times), np.concatenate(values)
            total = np.append(0.0, np.cumsum(value))
            first, last = np.searchsorted(time, start), np.searchsorted(time, end, side="right")
            count = last - first
            between = np.interp((start + end) / 2, time, value)
            mean = (total[last] - total[first]) / np.maximum(count, 1)
            columns.append(np.where(count > 0, mean, between))
        return np.stack(columns if len(columns) > 1 else columns * n, axis=1)
