"""Logs as Parquet: the wanted columns only, batch by batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.files.yaml import shorten
from tdfscal.logs.common import units
from tdfscal.logs.common.damage import damage
from tdfscal.logs.common.request import (
    Items,
    Outcome,
    Piece,
    Reached,
    Request,
    columns_of,
    table_piece,
    takes_turns,
)
from tdfscal.logs.common.table import TICKS, holes, is_number
from tdfscal.logs.parquet.dates import DateTexts, begins_with_date
from tdfscal.logs.parquet.file import (
    batches,
    element_of,
    is_no_number,
    is_text,
    leaves_of,
    lists_of,
    open_parquet,
)
from tdfscal.logs.text.date_times import DATES
from tdfscal.records import BoolArray, FloatArray

_MAX_SAMPLES: Final = 1 << 16
_SEARCHED_ROWS: Final = 256


def read_parquet(path: Path, request: Request, *, reached: Reached) -> Items:
    """Read a Parquet log in pieces; see `request.Reader`.

    Page checksums are verified where the file has them; pyarrow does not say whether it has.
    """
    with damage(path, pa.ArrowException), open_parquet(path) as file:
        names = _wanted(file, request)
        timed = request.mapping.time_field in names
        texts = DateTexts() if timed else None
        row, sparse = 0, False
        share = path.stat().st_size / max(file.metadata.num_rows, 1)
        for number in range(file.num_row_groups):
            for batch in batches(file, number, names, _MAX_SAMPLES):
                if not row:
                    sparse = timed and _takes_turns(batch, request)
                yield _piece(batch, request, row, texts, sparse=sparse)
                row += batch.num_rows
                reached(int(row * share))
    if row == 0:
        raise DataError("the file has no rows", hint="record the log again")
    yield Outcome("unverified")


def _wanted(file: pq.ParquetFile, request: Request) -> list[str]:
    """Names of the columns to read. Raises DataError where one is missing or holds no numbers."""
    lists = lists_of(file)
    names = [request.mapping.time_field, *(n for s in request.signals for n in s.components)]
    elements = dict.fromkeys(name for name in names if element_of(name, lists))
    others = [first for name in lists if (first := f"{name}[0]") not in elements]
    leaves = leaves_of(file)
    column_of = columns_of(request, [*(leaf.path for leaf in leaves), *elements, *others])
    for name, k in column_of.items():
        if k >= len(leaves) or (name == request.mapping.time_field and is_text(leaves[k])):
            continue
        if (holds := is_no_number(leaves[k])) is not None:
            raise _no_numbers(name, holds)
    return list(column_of)


def _takes_turns(table: pa.Table, request: Request) -> bool:
    """Whether a table is of streams with times of their own; see `request.takes_turns`."""
    opening = table.slice(0, _SEARCHED_ROWS)
    filled = [
        sum(~holes(opening.column(name)) for name in signal.components)
        for signal in request.signals
    ]
    return takes_turns(np.array(filled))


def _piece(
    table: pa.Table, request: Request, row: int, texts: DateTexts | None, *, sparse: bool
) -> Piece:
    """The rows of a table; texts : of the time, None where there is none."""
    vectors = np.empty((len(request.signals), 3, table.num_rows))
    for vector, signal in zip(vectors, request.signals, strict=True):
        three = [(name, table.column(name)) for name in signal.components]
        if sparse:
            empty = np.logical_and.reduce([holes(column) for _, column in three])
            three = [(name, _filled(column, empty, name, row)) for name, column in three]
        for axis, (name, column) in zip(vector, three, strict=True):
            axis[:] = _numbers(column, name, row)
        if sparse:
            vector[:, empty] = np.nan
    factors = [signal.factors for signal in request.signals]
    name = request.mapping.time_field
    time = None if texts is None else _time(table.column(name), name, request, row, texts)
    return table_piece(request, vectors, factors, time, row, sparse=sparse)


def _filled(column: Any, empty: BoolArray, name: str, first_row: int) -> Any:
    """The column with zeros in the rows that leave its signal out; others may not be empty."""
    if (hole := holes(column) & ~empty).any():
        raise _empty(name, first_row + int(np.argmax(hole)))
    return column.fill_null(0)


def _time(column: Any, name: str, request: Request, first_row: int, texts: DateTexts) -> FloatArray:
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
        # Such a column knows its own unit.
        ticks = column.cast(pa.int64())
        return _numbers(ticks, name, first_row) / TICKS[column.type.unit]
    if pa.types.is_dictionary(column.type):
        return _dates(column, name, first_row, texts)
    return _numbers(column, name, first_row) * units.factor("time", request.mapping.time_unit)


def _dates(column: Any, name: str, first_row: int, texts: DateTexts) -> FloatArray:
    """Return a column of dates with times of day as (N,) s."""
    if column.null_count:
        raise _empty(name, first_row + int(np.argmax(holes(column))))
    if not first_row and not begins_with_date(column):
        raise _no_numbers(name, "string")
    seconds = texts.seconds(column)
    if np.isnan(seconds).any():
        k = int(np.argmax(np.isnan(seconds)))
        raise DataError(
            f"{shorten(column[k].as_py())!r} is no date and time as the first row has one",
            where=f"column {name}, row {first_row + k}",
            hint=f"{DATES}; rows count from 0",
        )
    return seconds


def _numbers(column: Any, name: str, first_row: int) -> FloatArray:
    """Return a column as (N,) float64, each value present and finite."""
    kind = column.type
    if not is_number(kind):
        raise _no_numbers(name, str(kind))
    if column.null_count:
        raise _empty(name, first_row + int(np.argmax(holes(column))))
    numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False)
    values = as_numpy(numbers)
    if not (np.isfinite(values.sum()) or np.isfinite(values).all()):
        k = int(np.argmin(np.isfinite(values)))
        raise DataError(
            f"{values[k]} is not a finite number",
            where=f"column {name}, row {first_row + k}",
            hint="each cell must be a finite number; rows count from 0",
            fields=(name,),
        )
    return values


def _empty(name: str, row: int) -> DataError:
    return DataError(
        "the cell is empty",
        where=f"column {name}, row {row}",
        hint="a log has no holes; rows count from 0",
        fields=(name,),
    )


def _no_numbers(name: str, holds: str) -> DataError:
    return DataError(
        f"column {name} holds {holds}, not numbers",
        hint="name a column of numbers in the log block of rig.yaml",
        fields=(name,),
    )
