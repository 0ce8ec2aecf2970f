"""Contents of a Parquet log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.logs.contents import SAMPLES, Contents, Stream, table_contents
from tdfscal.logs.damage import damage
from tdfscal.logs.parquet.footer import Footer, read_footer
from tdfscal.logs.parquet.pages import check_pages
from tdfscal.logs.parquet.reader import open_parquet
from tdfscal.records import FloatArray

_BATCH = 1 << 16
_TOGETHER = 64  # columns; a table may have thousands


def parquet_contents(path: Path) -> Contents:
    """Look through a Parquet file: its schema, and a sample of the rows of each batch.

    Raises
    ------
    UsageError, DataError : it cannot be read.
    """
    with damage(path, pa.ArrowException):
        footer = read_footer(path)
        names = [leaf.path for leaf in footer.leaves]
        sample: dict[str, FloatArray] = {}
        opening: dict[str, FloatArray] = {}
        with open_parquet(path, footer) as file:
            kinds = [_kind(file, k) for k in range(len(names))]
            twice = sorted({name for name in names if names.count(name) > 1})
            once = [
                k for k, leaf in enumerate(footer.leaves) if leaf.small and leaf.path not in twice
            ]
            for begin in range(0, len(once), _TOGETHER):
                portion = once[begin : begin + _TOGETHER]
                first, whole = _sampled(path, file, footer, portion)
                for name in whole.column_names:
                    values = _numbers(whole.column(name))
                    if values is not None:
                        sample[name] = values
                        start = _numbers(first.column(name))
                        opening[name] = values if start is None else start
        fields, vectors, columns = table_contents(
            names, kinds, [None] * len(names), sample, opening
        )
        problems = (f"columns are there more than once: {', '.join(twice)}",) if twice else ()
    return Contents(
        path, "parquet", path.stat().st_size, (Stream("table", "", footer.rows, fields),), vectors,
        columns, problems=problems,
    )  # fmt: skip


def _sampled(
    path: Path, file: pq.ParquetFile, footer: Footer, portion: Sequence[int]
) -> tuple[pa.Table, pa.Table]:
    """Some columns: the first rows, and some rows of each batch."""
    first: list[pa.Table] = []
    thinned: list[pa.Table] = []
    columns = [footer.leaves[k].path for k in portion]
    for number, group in enumerate(footer.groups):
        check_pages(path, [group.parts[k] for k in portion])
        for batch in file.iter_batches(batch_size=_BATCH, row_groups=[number], columns=columns):
            table = _flat(pa.Table.from_batches([batch]))
            first = first or [table.slice(0, 4096)]
            count = min(-(-SAMPLES * len(table) // min(_BATCH, footer.rows)), len(table))
            rows = np.linspace(0, len(table) - 1, count).astype(np.int64)
            thinned.append(table.take(as_arrow(np.unique(rows))))
    if not thinned:
        return pa.table({}), pa.table({})
    return first[0], pa.concat_tables(thinned)


def _kind(file: pq.ParquetFile, k: int) -> str:
    column = file.schema.column(k)
    logical = str(column.logical_type.type).lower()
    return logical if logical not in ("none", "unknown") else str(column.physical_type).lower()


def _flat(table: pa.Table) -> pa.Table:
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


def _numbers(column: Any) -> FloatArray | None:
    """A column as float64 seconds or numbers; None where it holds neither."""
    kind = column.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        ticks = column.cast(pa.int64()).cast(pa.float64(), safe=False)
        return as_numpy(ticks) / {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind):
        return as_numpy(column.cast(pa.float64(), safe=False))
    return None
