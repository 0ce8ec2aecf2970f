"""Numbers between Arrow and numpy.

pyarrow's own conversions import pandas first, which takes a quarter of a second.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from tdfscal.records import BoolArray, FloatArray, IntArray


def as_numpy(column: Any) -> FloatArray:
    """A column of float64, (N,), NaN where it is null; read-only, and copied only if in chunks."""
    if column.null_count:
        column = column.fill_null(np.nan)
    if isinstance(column, pa.ChunkedArray):
        column = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
    numbers: FloatArray = np.from_dlpack(column)  # type: ignore[assignment]
    return numbers


def as_arrow(values: FloatArray | IntArray, missing: BoolArray | None = None) -> Any:
    """An array of (N,) numbers, null where they are missing, which shares their memory."""
    known = None if missing is None else pa.py_buffer(np.packbits(~missing, bitorder="little"))
    buffers = [known, pa.py_buffer(np.ascontiguousarray(values))]
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), buffers)
