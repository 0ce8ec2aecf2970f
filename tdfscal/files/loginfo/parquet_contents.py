"""Contents of a Parquet log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.files.loginfo.contents import SAMPLES, Contents, Stream, table_contents
from tdfscal.files.logs.faults import damage
from tdfscal.files.logs.parquet import open_parquet
from tdfscal.records import FloatArray

_BATCH = 1 << 16


def parquet_contents(path: Path) -> Contents:
    """Look through a Parquet file: its schema, and a sample of the rows of each batch.

    Raises
    ------
    UsageError, DataError : it cannot be read.
    """
    with damage(path, pa.ArrowException), open_parquet(path) as file:
        schema = file.schema
        names = [schema.column(k).path for k in range(len(schema))]
        thinned: list[pa.Table] = []
        first: pa.Table | None = None
        for batch in file.iter_batches(batch_size=_BATCH):
            table = _flat(pa.Table.from_batches([batch]))
            first = table.slice(0, 4096) if first is None else first
            rows = np.linspace(0, len(table) - 1, min(SAMPLES, len(table))).astype(np.int64)
            thinned.append(table.take(pa.array(np.unique(rows))))
        kinds = [_kind(file, k) for k in range(len(schema))]
        sample: dict[str, FloatArray] = {}
        opening: dict[str, FloatArray] = {}
        if first is not None:
            whole = pa.concat_tables(thinned)
            for name in names:
                if names.count(name) == 1 and name in whole.column_names:
                    values = _numbers(whole.column(name))
                    if values is not None:
                        sample[name] = values
                        start = _numbers(first.column(name))
                        opening[name] = values if start is None else start
        fields, vectors, columns = table_contents(
            names, kinds, [None] * len(names), sample, opening
        )
        twice = sorted({name for name in names if names.count(name) > 1})
        problems = (f"columns are there more than once: {', '.join(twice)}",) if twice else ()
        rows_all = int(file.metadata.num_rows)
    return Contents(
        path, "parquet", path.stat().st_size, (Stream("table", "", rows_all, fields),), vectors,
        columns, problems=problems,
    )  # fmt: skip


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
        ticks = np.asarray(column.cast(pa.int64()).to_numpy(), dtype=np.float64)
        return ticks / {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind):
        return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
    return None
