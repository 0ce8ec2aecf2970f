"""Contents of a Parquet log."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.files.arrow import as_arrow
from tdfscal.logs.common.contents import SAMPLES, Contents
from tdfscal.logs.common.damage import damage
from tdfscal.logs.common.table import Sampled, holes, repeated, sampled, table_contents
from tdfscal.logs.parquet.dates import DateTexts, begins_with_date
from tdfscal.logs.parquet.file import (
    batches,
    flattened,
    is_no_number,
    is_text,
    leaves_of,
    lists_of,
    open_parquet,
)

_OPENING: Final = 4096
_LOOKED_AT: Final = 1 << 17  # rows
_GROUPS: Final = 32
_TOGETHER: Final = 64  # columns; a table may have thousands


def parquet_contents(path: Path) -> Contents:
    """Look into a Parquet file: its schema, and rows from the beginning of some row groups."""
    numbers: dict[str, Sampled] = {}
    with damage(path, pa.ArrowException), open_parquet(path) as file:
        leaves = leaves_of(file)
        twice = repeated([leaf.path for leaf in leaves])
        small = [f.path for f in leaves if is_no_number(f) is None and f.path not in twice]
        texts = [f.path for f in leaves if is_text(f) and f.path not in twice]
        dated = {name for name in texts if _is_dated(file, name)}
        elements = [name for column in lists_of(file) for name in _elements(file, column)]
        small += [*dated, *elements]
        for begin in range(0, len(small), _TOGETHER):
            portion = small[begin : begin + _TOGETHER]
            looked_at = _looked_at(file, portion)
            most = -(-_GROUPS * SAMPLES // max(len(looked_at), 1))
            for name in portion if looked_at else ():
                parts = [(row, table.column(name)) for row, table in looked_at]
                if name in dated:
                    dates = DateTexts()
                    parts = [(row, _seconds(column, dates)) for row, column in parts]
                found = sampled(parts, most)
                if found is not None:
                    numbers[name] = found
        columns = [(f.path, "date and time" if f.path in dated else _kind(f), None) for f in leaves]
        columns += [(name, "element of a list", None) for name in elements]
        return table_contents(path, "parquet", file.metadata.num_rows, columns, numbers)


def _elements(file: pq.ParquetFile, column: str) -> list[str]:
    """Names of the numbers of a list, by the first row."""
    first = next(iter(file.iter_batches(batch_size=1, columns=[column])), None)
    if first is None or not first.num_rows:
        return []
    row = flattened(first).column(column)[0].as_py() or ()
    return [f"{column}[{k}]" for k in range(min(len(row), _TOGETHER))]


def _is_dated(file: pq.ParquetFile, name: str) -> bool:
    """Whether a column of texts begins with a date; a damaged one is not asked for yet."""
    with suppress(pa.ArrowException, OSError, ValueError):
        first = next(batches(file, 0, [name], 1), None)
        return first is not None and begins_with_date(first.column(name))
    return False


def _seconds(column: pa.ChunkedArray, texts: DateTexts) -> Any:
    return pa.chunked_array([as_arrow(texts.seconds(column), holes(column))])


def _looked_at(file: pq.ParquetFile, names: list[str]) -> list[tuple[int, pa.Table]]:
    """The first rows of some row groups, and the number of the first."""
    groups = np.linspace(0, file.num_row_groups - 1, min(file.num_row_groups, _GROUPS))
    size = max(_OPENING, _LOOKED_AT // max(len(groups), 1))
    rows = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
    chosen = np.unique(np.rint(groups)).astype(int).tolist()
    tables = [(sum(rows[:k]), next(batches(file, k, names, size), None)) for k in chosen]
    return [(begin, table) for begin, table in tables if table is not None]


def _kind(leaf: Any) -> str:
    logical = str(leaf.logical_type.type).lower()
    return logical if logical not in ("none", "unknown") else str(leaf.physical_type).lower()
