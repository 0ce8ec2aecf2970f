"""Contents of a Parquet log."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.logs.common.contents import SAMPLES, Contents, Stream, table_contents
from tdfscal.logs.common.damage import damage
from tdfscal.logs.parquet.reader import (
    TICKS,
    batches,
    check_pages,
    is_no_number,
    leaves_of,
    open_parquet,
)
from tdfscal.records import FloatArray

_OPENING: Final = 4096
_LOOKED_AT: Final = 1 << 17  # rows
_GROUPS: Final = 32
_TOGETHER: Final = 64  # columns; a table may have thousands


def parquet_contents(path: Path) -> Contents:
    """Look into a Parquet file: its schema, and rows from the beginning of some row groups.

    Raises
    ------
    UsageError, DataError : it cannot be read.
    """
    sample: dict[str, FloatArray] = {}
    first: dict[str, FloatArray] = {}
    with damage(path, pa.ArrowException), open_parquet(path) as file:
        leaves = leaves_of(file)
        names = [leaf.path for leaf in leaves]
        twice = sorted({name for name in names if names.count(name) > 1})
        small = [f.path for f in leaves if is_no_number(f) is None and f.path not in twice]
        for begin in range(0, len(small), _TOGETHER):
            portion = small[begin : begin + _TOGETHER]
            check_pages(path, file, portion)
            opening, thinned = _sampled(file, portion)
            for name in thinned.column_names:
                if (values := _numbers(thinned.column(name))) is not None:
                    sample[name] = values
                    first[name] = _numbers(opening.column(name))  # type: ignore[assignment]
        fields, vectors, columns = table_contents(
            names, [_kind(leaf) for leaf in leaves], [None] * len(names), sample, first
        )
        rows = file.metadata.num_rows
    problems = (f"columns are there more than once: {', '.join(twice)}",) if twice else ()
    return Contents(
        path, "parquet", path.stat().st_size, (Stream("table", "", rows, fields),), vectors,
        columns, problems=problems,
    )  # fmt: skip


def _sampled(file: pq.ParquetFile, names: list[str]) -> tuple[pa.Table, pa.Table]:
    """The first rows, and some rows of some row groups."""
    groups = np.linspace(0, file.num_row_groups - 1, min(file.num_row_groups, _GROUPS))
    size = max(_OPENING, _LOOKED_AT // max(len(groups), 1))
    tables = [next(batches(file, int(k), names, size), None) for k in np.unique(np.rint(groups))]
    there = [table for table in tables if table is not None]
    if not there:
        return pa.table({}), pa.table({})
    count = -(-_GROUPS * SAMPLES // len(there))
    rows = [np.linspace(0, len(t) - 1, min(count, len(t))).astype(np.int64) for t in there]
    thinned = [t.take(as_arrow(np.unique(r))) for t, r in zip(there, rows, strict=True)]
    return there[0].slice(0, _OPENING), pa.concat_tables(thinned)


def _kind(leaf: Any) -> str:
    logical = str(leaf.logical_type.type).lower()
    return logical if logical not in ("none", "unknown") else str(leaf.physical_type).lower()


def _numbers(column: Any) -> FloatArray | None:
    """A column as float64 seconds or numbers; None where it holds neither."""
    kind = column.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        return as_numpy(column.cast(pa.int64()).cast(pa.float64(), safe=False)) / TICKS[kind.unit]
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind):
        return as_numpy(column.cast(pa.float64(), safe=False))
    return None
