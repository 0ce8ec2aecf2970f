"""Logs as Parquet: the wanted columns only, batch by batch.

Page checksums are verified where the file has them; pyarrow does not say whether it has.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.files.units import UNITS, canonical
from tdfscal.files.yaml import shorten
from tdfscal.logs.log_file import EMPTY, MAX_SAMPLES, LogFile
from tdfscal.logs.parquet_file import (
    MARK,
    batches,
    element_of,
    flattened,
    is_no_number,
    is_text,
    leaves_of,
    lists_of,
    open_parquet,
)
from tdfscal.logs.request import Piece, Request
from tdfscal.logs.table import (
    DATES,
    TICKS,
    Sampled,
    columns_of,
    has_zone,
    holes,
    is_date_time,
    is_number,
    repeated,
    sampled,
    seconds_of_all,
    table_piece,
    takes_turns,
)
from tdfscal.records import BoolArray, FloatArray

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents

_SEARCHED_ROWS: Final = 256
_OPENING: Final = 4096
_LOOKED_AT: Final = 1 << 17  # rows
_GROUPS: Final = 32
_TOGETHER: Final = 64  # columns; a table may have thousands


class ParquetLog(LogFile):
    """One Parquet file."""

    faults = (pa.ArrowException,)
    mark, kind = MARK, "Parquet file"

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the rows of the wanted columns."""
        with open_parquet(self.path) as file:
            names = _wanted(file, request)
            timed = request.mapping.time_field in names
            row, sparse, zoned = 0, False, False
            share = self.path.stat().st_size / max(file.metadata.num_rows, 1)
            for number in range(file.num_row_groups):
                for table in batches(file, number, names, MAX_SAMPLES):
                    if not row:
                        sparse = timed and _takes_turns(table, request)
                        zoned = timed and _is_zoned(table.column(request.mapping.time_field))
                    time = _time(table, request, row, zoned=zoned) if timed else None
                    vectors = _vectors(table, request, row, sparse=sparse)
                    factors = [signal.factors for signal in request.signals]
                    yield table_piece(request, vectors, factors, time, row, sparse=sparse)
                    row += table.num_rows
                    self.position = int(row * share)
        if row == 0:
            raise DataError("the file has no rows", hint=EMPTY)

    def look(self) -> Contents:
        """Its schema, and rows from the beginning of some row groups."""
        from tdfscal.logs.contents import SAMPLES, table_contents

        numbers: dict[str, Sampled] = {}
        with open_parquet(self.path) as file:
            leaves = leaves_of(file)
            twice = repeated([leaf.path for leaf in leaves])
            dated = {
                f.path: _is_zoned(first)
                for f in leaves
                if is_text(f) and f.path not in twice and (first := _dates(file, f.path))
            }
            small = [f.path for f in leaves if is_no_number(f) is None and f.path not in twice]
            small += dated
            lists = [_elements(file, column) for column in lists_of(file)]
            portions = [small[k : k + _TOGETHER] for k in range(0, len(small), _TOGETHER)]
            elements: list[str] = []
            for portion in (*portions, *lists):
                try:
                    looked_at = _looked_at(file, portion)
                except DataError:  # rows of a list that have fewer numbers than the first
                    continue
                elements += portion if portion in lists else []
                most = -(-_GROUPS * SAMPLES // max(len(looked_at), 1))
                for name in portion if looked_at else ():
                    parts = [(row, table.column(name)) for row, table in looked_at]
                    if name in dated:
                        seconds = [seconds_of_all(c, zoned=dated[name]) for _, c in parts]
                        parts = [
                            (row, pa.chunked_array([as_arrow(one, np.isnan(one))]))
                            for (row, _), one in zip(parts, seconds, strict=True)
                        ]
                    found = sampled(parts, most)
                    if found is not None:
                        numbers[name] = found
            kinds = {f.path: "date and time" if f.path in dated else _kind(f) for f in leaves}
            columns = [(f.path, kinds[f.path], None) for f in leaves]
            columns += [(name, "element of a list", None) for name in elements]
            groups = map(file.metadata.row_group, range(file.num_row_groups))
            rows = sum(group.num_rows for group in groups)
            return table_contents(self.path, "parquet", rows, columns, numbers)


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
    """Whether a table is of streams with times of their own; see `table.takes_turns`."""
    opening = table.slice(0, _SEARCHED_ROWS)
    filled = [
        sum(~holes(opening.column(name)) for name in signal.components)
        for signal in request.signals
    ]
    return takes_turns(np.array(filled))


def _vectors(table: pa.Table, request: Request, row: int, *, sparse: bool) -> FloatArray:
    """The signals (signals, 3, N); NaN where a row of a sparse table leaves one out."""
    vectors = np.empty((len(request.signals), 3, table.num_rows))
    for vector, signal in zip(vectors, request.signals, strict=True):
        columns = [table.column(name) for name in signal.components]
        absent = np.zeros(table.num_rows, dtype=np.bool_)
        if sparse:
            absent = np.logical_and.reduce([holes(column) for column in columns])
        for axis, name, column in zip(vector, signal.components, columns, strict=True):
            axis[:] = _numbers(column, name, row, absent)
        if sparse:
            vector[:, absent] = np.nan
    return vectors


def _time(table: pa.Table, request: Request, row: int, *, zoned: bool) -> FloatArray:
    """The time (N,), s. A column that is a time by its type has its own unit."""
    name = request.mapping.time_field
    column, kind = table.column(name), table.schema.field(name).type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        return _numbers(column.cast(pa.int64()), name, row) / TICKS[kind.unit]
    if not pa.types.is_string(kind):
        return _numbers(column, name, row) * UNITS["time"][canonical(request.mapping.time_unit)]
    if column.null_count:
        raise _empty(name, row + int(np.argmax(holes(column))))
    if len(column) and not row and not is_date_time(column[0].as_py()):
        raise _no_numbers(name, "string")
    seconds = seconds_of_all(column, zoned=zoned)
    if (none := np.isnan(seconds)).any():
        k = int(np.argmax(none))
        raise DataError(
            f"{shorten(column[k].as_py())!r} is no date and time as the first row has one",
            where=f"column {name}, row {row + k}",
            hint=f"{DATES}; rows count from 0",
        )
    return seconds


def _numbers(column: Any, name: str, row: int, absent: BoolArray | None = None) -> FloatArray:
    """Return a column as (N,) float64, each value present, but for those absent, and finite."""
    kind = column.type
    if not is_number(kind):
        raise _no_numbers(name, str(kind))
    if column.null_count:
        empty = holes(column) if absent is None else holes(column) & ~absent
        if empty.any():
            raise _empty(name, row + int(np.argmax(empty)))
        column = column.fill_null(0)
    numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False)
    values = as_numpy(numbers)
    if not (np.isfinite(values.sum()) or np.isfinite(values).all()):
        k = int(np.argmin(np.isfinite(values)))
        raise DataError(
            f"{values[k]} is not a finite number",
            where=f"column {name}, row {row + k}",
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


def _dates(file: pq.ParquetFile, name: str) -> Any:
    """The first rows of a column of texts that are dates; None of another, or a damaged one."""
    with suppress(pa.ArrowException, OSError, ValueError):
        first = next(batches(file, 0, [name], 1), None)
        if first is not None and is_date_time(first.column(name)[0].as_py() or ""):
            return first.column(name)
    return None


def _is_zoned(column: Any) -> bool:
    """Whether a column of texts has dates with a zone, going by the first."""
    texts = pa.types.is_string(column.type) and len(column)
    return bool(texts) and has_zone(column[0].as_py() or "")


def _elements(file: pq.ParquetFile, column: str) -> list[str]:
    """Names of the numbers of a list, by the first row."""
    first = next(iter(file.iter_batches(batch_size=1, columns=[column])), None)
    if first is None or not first.num_rows:
        return []
    row = flattened(first).column(column)[0].as_py() or ()
    return [f"{column}[{k}]" for k in range(min(len(row), _TOGETHER))]


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
