"""Logs as Parquet: the wanted columns only, batch by batch."""

from __future__ import annotations

import base64
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.logs import units
from tdfscal.logs.damage import damage, one_line
from tdfscal.logs.parquet.footer import MAX_FOOTER, MAX_LIST, Footer, read_footer
from tdfscal.logs.parquet.pages import check_pages
from tdfscal.logs.request import (
    Block,
    Outcome,
    Piece,
    Reached,
    Request,
    check_fields_differ,
    missing_fields,
)
from tdfscal.records import FloatArray

_MAX_SAMPLES: Final = 1 << 16
_AT_ONCE: Final = 32 << 20
"""Largest row group, in bytes as stored, whose columns are read in one go: faster."""
_BUFFER: Final = 1 << 20
_TICKS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True, slots=True)
class _Columns:
    """Leaf columns by path; time is None where rows are postures and the file has no time."""

    time: str | None
    components: tuple[tuple[str, str, str], ...]

    @property
    def names(self) -> list[str]:
        """All paths to read."""
        three = [name for signal in self.components for name in signal]
        return ([self.time] if self.time is not None else []) + three


def read_parquet(
    path: Path, request: Request, *, salvage: bool, reached: Reached
) -> Generator[Piece, None, Outcome]:
    """Read a Parquet log in pieces; see `request.Reader`.

    Page checksums are verified where the file has them, else its integrity is unverified.

    Raises
    ------
    DataError : with the column and row of what is wrong.
    """
    where = str(path)
    warnings: list[str] = []
    with damage(path, pa.ArrowException):
        footer = read_footer(path)
        columns = _resolve(footer, request, where)
        parts = [k for k, leaf in enumerate(footer.leaves) if leaf.path in set(columns.names)]
        with open_parquet(path, footer) as file:
            units_differ = _units_differ(file, columns.time)
            verified = not _is_duration(file, columns.time)
            first_row = 0
            read = 0
            share = path.stat().st_size / max(footer.rows, 1)
            for number, group in enumerate(footer.groups):
                in_group = 0
                try:
                    verified &= check_pages(path, [group.parts[k] for k in parts])
                    if verified and units_differ:
                        raise DataError(units_differ, where=where)
                    for batch in _batches(file, number, columns):
                        piece = _piece(batch, columns, request, first_row + in_group, where)
                        in_group += batch.num_rows
                        reached(int((first_row + in_group) * share))
                        yield piece
                    if in_group != group.rows:
                        raise DataError(
                            f"row group {number} has {in_group} rows where {group.rows} are stated",
                            where=where,
                        )
                except (pa.ArrowException, OSError, ValueError, DataError) as error:
                    if not salvage:
                        raise
                    warnings.append(
                        f"{where}: row group {number} is damaged ({one_line(error)}); of its "
                        f"{group.rows} rows {group.rows - in_group} are lost"
                    )
                first_row += group.rows
                read += in_group
    if read == 0:
        raise DataError("the file has no rows", where=where, hint="record the log again")
    if warnings:
        return Outcome("salvaged", tuple(warnings))
    return Outcome("verified" if verified else "unverified")


@contextmanager
def open_parquet(path: Path, footer: Footer) -> Iterator[pq.ParquetFile]:
    """Open a file such that checksums are verified and no absurd length is believed.

    Its pages must be checked before they are read.

    footer : as `read_footer` read it.
    """
    largest = max((sum(p.end - p.begin for p in g.parts) for g in footer.groups), default=0)
    with (
        path.open("rb") as stream,
        pq.ParquetFile(
            path if _is_utf8(path) else stream,
            page_checksum_verification=True,
            pre_buffer=False,
            buffer_size=_BUFFER if largest > _AT_ONCE else 0,
            thrift_string_size_limit=MAX_FOOTER,
            thrift_container_size_limit=MAX_LIST,
        ) as file,
    ):
        yield file


def _is_utf8(path: Path) -> bool:
    """Pyarrow takes no other names; Python opens any."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _resolve(footer: Footer, request: Request, where: str) -> _Columns:
    check_fields_differ(request, where=where)
    paths = [leaf.path for leaf in footer.leaves]
    names = [name for signal in request.signals for name in signal.components]
    timed = request.rows == "timeseries" or request.time_field in paths
    wanted = ([request.time_field] if timed else []) + names
    missing = [name for name in wanted if name not in paths]
    if missing:
        raise missing_fields(missing, paths, where=where, kind="column")
    for name in wanted:
        if paths.count(name) > 1:
            raise DataError(
                f"column {name} is there {paths.count(name)} times",
                where=where,
                hint="give each column its own name",
            )
        leaf = footer.leaves[paths.index(name)]
        if not leaf.small:
            raise _no_numbers(name, leaf.holds, where)
    return _Columns(
        request.time_field if timed else None, tuple(s.components for s in request.signals)
    )


def _units_differ(file: pq.ParquetFile, time: str | None) -> str | None:
    """What is wrong where Parquet and Arrow state different units of the time in the footer.

    No checksum covers these. A writer that coerces times leaves them different too, so only a file
    that claims to be intact is to be refused for it.
    """
    encoded = (file.metadata.metadata or {}).get(b"ARROW:schema")
    if encoded is None or time not in file.schema_arrow.names:
        return None
    stated = pa.ipc.read_schema(pa.py_buffer(base64.b64decode(encoded)))
    if time not in stated.names:
        return f"the footer contradicts itself about column {time}"
    read, known = (getattr(s.field(time).type, "unit", None) for s in (file.schema_arrow, stated))
    # Parquet knows no seconds; Arrow writes ms for them.
    if read == known or (read, known) == ("ms", "s"):
        return None
    return f"the footer states the unit of column {time} twice, as {read} and as {known}"


def _is_duration(file: pq.ParquetFile, time: str | None) -> bool:
    """Whether the time's unit stands in the Arrow schema alone, which no checksum covers."""
    schema = file.schema_arrow
    return time in schema.names and pa.types.is_duration(schema.field(time).type)


def _batches(file: pq.ParquetFile, group: int, columns: _Columns) -> Iterator[pa.Table]:
    names = columns.names
    for batch in file.iter_batches(batch_size=_MAX_SAMPLES, row_groups=[group], columns=names):
        table = pa.Table.from_batches([batch])
        while any(pa.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        yield table


def _piece(
    table: pa.Table, columns: _Columns, request: Request, first_row: int, where: str
) -> Piece:
    value: dict[int, FloatArray] = {}
    vectors = np.empty((len(request.signals), 3, table.num_rows))
    for number, signal in enumerate(request.signals):
        for axis, name in enumerate(columns.components[number]):
            column = _numbers(table.column(name), name, first_row, where)
            np.multiply(column, signal.factor, out=vectors[number, axis])
        value[number] = vectors[number].T
    if columns.time is None:
        time = np.arange(first_row, first_row + table.num_rows, dtype=np.float64)
        return (Block("row", time, value),)
    time = _time(table.column(columns.time), columns.time, request, first_row, where)
    return (Block(f"column {columns.time}", time, value),)


def _time(column: Any, name: str, request: Request, first_row: int, where: str) -> FloatArray:
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        # Such a column knows its own unit.
        ticks = column.cast(pa.int64())
        return _numbers(ticks, name, first_row, where) / _TICKS[column.type.unit]
    factor = units.factor("time", request.time_unit)
    if factor is None:
        raise ValueError(request.time_unit)
    return _numbers(column, name, first_row, where) * factor


def _numbers(column: Any, name: str, first_row: int, where: str) -> FloatArray:
    """Return a column as (N,) float64, each value present and finite."""
    kind = column.type
    is_number = pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)
    if not is_number:
        raise _no_numbers(name, str(kind), where)
    if column.null_count:
        row = first_row + int(np.argmax(column.is_null().to_numpy()))
        raise DataError(
            "the cell is empty", where=f"{where}, column {name}, row {row}",
            hint="a log has no holes; rows count from 0",
        )  # fmt: skip
    numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False)
    values = as_numpy(numbers)
    if not (np.isfinite(values.sum()) or np.isfinite(values).all()):
        k = int(np.argmin(np.isfinite(values)))
        raise DataError(
            f"{values[k]} is not a finite number",
            where=f"{where}, column {name}, row {first_row + k}",
            hint="each cell must be a finite number; rows count from 0",
        )
    return values


def _no_numbers(name: str, holds: str, where: str) -> DataError:
    return DataError(
        f"column {name} holds {holds}, not numbers",
        where=where,
        hint="name a column of numbers in the log block of rig.yaml",
    )
