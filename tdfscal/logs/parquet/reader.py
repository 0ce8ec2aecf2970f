"""Logs as Parquet: the wanted columns only, batch by batch."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.logs.common import units
from tdfscal.logs.common.damage import damage, one_line
from tdfscal.logs.common.request import (
    Block,
    Outcome,
    Piece,
    Reached,
    Request,
    by_signal,
    columns_of,
    takes_turns,
)
from tdfscal.logs.common.table import TICKS
from tdfscal.logs.parquet.footer import (
    Places,
    check_pages,
    is_duration,
    is_no_number,
    leaves_of,
    open_parquet,
    stated_twice,
)
from tdfscal.records import BoolArray, FloatArray

_MAX_SAMPLES: Final = 1 << 16
_SEARCHED_ROWS: Final = 256


@dataclass(frozen=True, slots=True)
class _Columns:
    """Leaf columns by path; time is None where rows are postures and the file has no time."""

    time: str | None
    components: tuple[tuple[str, str, str], ...]

    @property
    def names(self) -> list[str]:
        """All paths to read, each once: one may stand for an axis that is not measured."""
        three = (name for signal in self.components for name in signal)
        return [*dict.fromkeys([*([self.time] if self.time is not None else []), *three])]


def read_parquet(
    path: Path, request: Request, *, salvage: bool, reached: Reached
) -> Generator[Piece, None, Outcome]:
    """Read a Parquet log in pieces; see `request.Reader`.

    Page checksums are verified where the file has them, else its integrity is unverified.
    """
    warnings: list[str] = []
    with damage(path, pa.ArrowException), open_parquet(path) as file:
        rows = file.metadata.num_rows
        columns = _resolve(file, request)
        verified = check_pages(path, file, columns.names)
        if verified and (what := stated_twice(file, columns.names)):
            raise DataError(what)
        verified &= not is_duration(file, columns.time)
        paths = [leaf.path for leaf in leaves_of(file)]
        read_from = Places(file.metadata, [paths.index(name) for name in columns.names])
        first_row, sparse = 0, False
        read = 0
        share = path.stat().st_size / max(rows, 1)
        for number in range(file.num_row_groups):
            stated, in_group = file.metadata.row_group(number).num_rows, 0
            try:
                for batch in batches(file, number, columns.names):
                    if not in_group:
                        read_from.add(number)
                    if not first_row + in_group:
                        sparse = _takes_turns(batch, columns)
                    row = first_row + in_group
                    piece = _piece(batch, columns, request, row, sparse=sparse)
                    in_group += batch.num_rows
                    reached(int((first_row + in_group) * share))
                    yield piece
                if in_group != stated:
                    raise DataError(
                        f"row group {number} has {in_group} rows where {stated} are stated"
                    )
            except (pa.ArrowException, OSError, ValueError, DataError) as error:
                if not salvage:
                    raise
                warnings.append(
                    f"row group {number} is damaged ({one_line(error)}); of its "
                    f"{stated} rows {stated - in_group} are lost"
                )
            first_row += stated
            read += in_group
    if read == 0:
        raise DataError("the file has no rows", hint="record the log again")
    if warnings:
        return Outcome("salvaged", tuple(warnings))
    return Outcome("verified" if verified else "unverified")


def _resolve(file: pq.ParquetFile, request: Request) -> _Columns:
    leaves = leaves_of(file)
    column_of = columns_of(request, [leaf.path for leaf in leaves])
    for name, k in column_of.items():
        if (holds := is_no_number(leaves[k])) is not None:
            raise _no_numbers(name, holds)
    time = request.time_field if request.time_field in column_of else None
    return _Columns(time, tuple(signal.components for signal in request.signals))


def batches(
    file: pq.ParquetFile, group: int, names: Sequence[str], size: int = _MAX_SAMPLES
) -> Iterator[pa.Table]:
    """Yield a row group in tables whose columns are those of the file's leaves."""
    for batch in file.iter_batches(batch_size=size, row_groups=[group], columns=list(names)):
        table = pa.Table.from_batches([batch])
        while any(pa.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        yield table


def _takes_turns(table: pa.Table, columns: _Columns) -> bool:
    """Whether a table is of streams with times of their own; see `request.takes_turns`."""
    if columns.time is None:
        return False
    opening = table.slice(0, _SEARCHED_ROWS)
    filled = np.array(
        [
            sum(~opening.column(name).is_null().to_numpy() for name in three)
            for three in columns.components
        ]
    )
    return takes_turns(filled)


def _piece(
    table: pa.Table, columns: _Columns, request: Request, first_row: int, *, sparse: bool
) -> Piece:
    value: dict[int, FloatArray] = {}
    vectors = np.empty((len(request.signals), 3, table.num_rows))
    for number, signal in enumerate(request.signals):
        three = [table.column(name) for name in columns.components[number]]
        if sparse:
            empty = np.logical_and.reduce([column.is_null().to_numpy() for column in three])
        for axis, name in enumerate(columns.components[number]):
            whole = three[axis]
            if sparse:
                whole = _filled(whole, empty, name, first_row)
            column = _numbers(whole, name, first_row)
            np.multiply(column, signal.factors[axis], out=vectors[number, axis])
        if sparse:
            vectors[number][:, empty] = np.nan
        value[number] = vectors[number].T
    if columns.time is None:
        time = np.arange(first_row, first_row + table.num_rows, dtype=np.float64)
        return (Block("row", time, value),)
    time = _time(table.column(columns.time), columns.time, request, first_row)
    clock = f"column {columns.time}"
    return by_signal(clock, time, value, request) if sparse else (Block(clock, time, value),)


def _filled(column: Any, empty: BoolArray, name: str, first_row: int) -> Any:
    """The column with zeros in the rows that leave its signal out; others may not be empty."""
    if (hole := column.is_null().to_numpy() & ~empty).any():
        raise _empty(name, first_row + int(np.argmax(hole)))
    return column.fill_null(0)


def _time(column: Any, name: str, request: Request, first_row: int) -> FloatArray:
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        # Such a column knows its own unit.
        ticks = column.cast(pa.int64())
        return _numbers(ticks, name, first_row) / TICKS[column.type.unit]
    return _numbers(column, name, first_row) * units.factor("time", request.time_unit)


def _numbers(column: Any, name: str, first_row: int) -> FloatArray:
    """Return a column as (N,) float64, each value present and finite."""
    kind = column.type
    is_number = pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)
    if not is_number:
        raise _no_numbers(name, str(kind))
    if column.null_count:
        raise _empty(name, first_row + int(np.argmax(column.is_null().to_numpy())))
    numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False)
    values = as_numpy(numbers)
    if not (np.isfinite(values.sum()) or np.isfinite(values).all()):
        k = int(np.argmin(np.isfinite(values)))
        raise DataError(
            f"{values[k]} is not a finite number",
            where=f"column {name}, row {first_row + k}",
            hint="each cell must be a finite number; rows count from 0",
        )
    return values


def _empty(name: str, row: int) -> DataError:
    return DataError(
        "the cell is empty",
        where=f"column {name}, row {row}",
        hint="a log has no holes; rows count from 0",
    )


def _no_numbers(name: str, holds: str) -> DataError:
    return DataError(
        f"column {name} holds {holds}, not numbers",
        hint="name a column of numbers in the log block of rig.yaml",
    )
