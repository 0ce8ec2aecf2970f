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
from tdfscal.logs.parquet.footer import check_pages, is_no_number, leaves_of, open_parquet
from tdfscal.logs.parquet.reader import TICKS, batches
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
    there: dict[str, FloatArray] = {}
    with damage(path, pa.ArrowException), open_parquet(path) as file:
        leaves = leaves_of(file)
        names = [leaf.path for leaf in leaves]
        twice = sorted({name for name in names if names.count(name) > 1})
        small = [f.path for f in leaves if is_no_number(f) is None and f.path not in twice]
        for begin in range(0, len(small), _TOGETHER):
            portion = small[begin : begin + _TOGETHER]
            check_pages(path, file, portion)
            looked_at = _looked_at(file, portion)
            for name in looked_at[0][1].column_names if looked_at else ():
                if (found := _sampled(looked_at, name)) is not None:
                    there[name], sample[name], first[name] = found
        fields, vectors, columns = table_contents(
            names, [_kind(leaf) for leaf in leaves], [None] * len(names), sample, first, there
        )
        rows = file.metadata.num_rows
    problems = (f"columns are there more than once: {', '.join(twice)}",) if twice else ()
    return Contents(
        path, "parquet", path.stat().st_size, (Stream("table", "", rows, fields),), vectors,
        columns, problems=problems,
    )  # fmt: skip


def _looked_at(file: pq.ParquetFile, names: list[str]) -> list[tuple[int, pa.Table]]:
    """The first rows of some row groups, and the number of the first."""
    groups = np.linspace(0, file.num_row_groups - 1, min(file.num_row_groups, _GROUPS))
    size = max(_OPENING, _LOOKED_AT // max(len(groups), 1))
    rows = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
    chosen = np.unique(np.rint(groups)).astype(int).tolist()
    tables = [(sum(rows[:k]), next(batches(file, k, names, size), None)) for k in chosen]
    return [(begin, table) for begin, table in tables if table is not None]


def _sampled(
    looked_at: list[tuple[int, pa.Table]], name: str
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Some rows of a column that are not empty, its values there, and its first ones."""
    count = -(-_GROUPS * SAMPLES // len(looked_at))
    rows, values = [], []
    for begin, table in looked_at:
        column = table.column(name)
        filled = np.flatnonzero(~column.is_null().to_numpy())
        thin = np.linspace(0, len(filled) - 1, min(count, len(filled))).astype(np.int64)
        chosen = filled[np.unique(thin)]
        if (numbers := _numbers(column.take(as_arrow(chosen)))) is None:
            return None
        rows.append(begin + chosen.astype(np.float64))
        values.append(numbers)
    opening = _numbers(looked_at[0][1].column(name).slice(0, _OPENING).drop_null())
    return np.concatenate(rows), np.concatenate(values), np.asarray(opening)


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
