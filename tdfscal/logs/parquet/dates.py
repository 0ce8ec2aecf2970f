"""Columns of texts, read as dictionaries, that are dates with times of day."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from tdfscal.files.arrow import as_numpy
from tdfscal.logs.text.date_times import has_zone, is_date_time, seconds_of, seconds_of_all
from tdfscal.records import FloatArray


def begins_with_date(column: pa.ChunkedArray) -> bool:
    """Tell whether the first cell of a column of texts is a date with a time of day."""
    first = column[0].as_py() if len(column) else None
    return first is not None and is_date_time(first)


class DateTexts:
    """A column of texts as seconds, table by table; the first shows whether all have a zone."""

    def __init__(self) -> None:
        self._zoned: bool | None = None

    def seconds(self, column: pa.ChunkedArray) -> FloatArray:
        """Return (N,) s since 1970; NaN where a cell is empty, or no date and time."""
        if self._zoned is None and len(column):
            self._zoned = has_zone(str(column[0].as_py()))
        return np.concatenate([np.empty(0), *map(self._of_chunk, column.chunks)])

    def _of_chunk(self, chunk: Any) -> FloatArray:
        texts = chunk.dictionary
        known = seconds_of_all(texts, zoned=bool(self._zoned))
        if known is None:
            found = [seconds_of(text, zoned=self._zoned) for text in texts.to_pylist()]
            known = np.array(found, dtype=np.float64)
        which = as_numpy(chunk.indices.cast(pa.int64()).fill_null(-1))
        return np.asarray(np.append(known, np.nan)[which])
