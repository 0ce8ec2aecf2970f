"""Columns of texts, read as dictionaries, that are dates with times of day."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from tdfscal.files.arrow import as_numpy
from tdfscal.logs.text.date_times import is_date_time, seconds_of, seconds_of_all
from tdfscal.records import FloatArray


def begins_with_date(column: pa.ChunkedArray) -> bool:
    """Tell whether the first cell of a column of texts is a date with a time of day."""
    first = column[0].as_py() if len(column) else None
    return first is not None and is_date_time(first)


def seconds_of_texts(column: pa.ChunkedArray) -> FloatArray:
    """Return (N,) s since 1970; NaN where a cell is empty, or no date and time."""
    return np.concatenate([np.empty(0), *map(_seconds, column.chunks)])


def _seconds(chunk: Any) -> FloatArray:
    texts = chunk.dictionary
    known = seconds_of_all(texts)
    if known is None:
        known = np.array([seconds_of(text) for text in texts.to_pylist()], dtype=np.float64)
    which = as_numpy(chunk.indices.cast(pa.int64()).fill_null(-1))
    return np.asarray(np.append(known, np.nan)[which])
