"""Logs as Parquet: the wanted columns only, batch by batch.

Page checksums are verified where the file has them; pyarrow does not say whether it has.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from os import SEEK_END
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_numpy
from tdfscal.files.rig.recorders import UNITS, canonical
from tdfscal.files.saving import in_utf8
from tdfscal.files.yaml import shorten
from tdfscal.logs.log_file import AGAIN, EMPTY, LogFile, Piece, Request
from tdfscal.logs.table import (
    DATES,
    TICKS,
    columns_of,
    first_date,
    has_zone,
    holes,
    is_number,
    seconds_of_all,
    table_piece,
    takes_turns,
)
from tdfscal.records import BoolArray, FloatArray

if TYPE_CHECKING:
    from tdfscal.logs.contents import Contents

_MARK: Final = b"PAR1"
"""With which a file begins and ends."""
_AT_ONCE: Final = 32 << 20
"""Largest row group, in bytes, whose columns are read in one go: faster."""
_BUFFER: Final = 1 << 20
_WIDEST: Final = 32  # bytes of a number
_SEARCHED_ROWS: Final = 256
_ROWS: Final = 1 << 16  # at a time
_LOOKED_AT: Final = 1 << 17  # rows
_FEWEST: Final = 4096  # rows of a group
_GROUPS: Final = 32
_TOGETHER: Final = 64  # columns; a table may have thousands


class ParquetLog(LogFile):
    """One Parquet file."""

    faults = (pa.ArrowException,)
    mark, kind = _MARK, "Parquet file"

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the rows of the wanted columns."""
        with _opened(self.path) as file:
            names = _wanted(file, request)
            timed = request.mapping.time_field in names
            row, sparse, zoned = 0, False, False
            for number in range(file.num_row_groups):
                for table in _tables(file, number, names, _ROWS):
                    if not row and timed:
                        sparse = _takes_turns(table.slice(0, _SEARCHED_ROWS), request)
                        date = first_date(table.column(request.mapping.time_field))
                        zoned = date is not None and has_zone(date)
                    time = _time(table, request, row, zoned=zoned) if timed else None
                    vectors = _vectors(table, request, row, sparse=sparse)
                    yield table_piece(request, vectors, time, row, sparse=sparse)
                    row += table.num_rows
            groups = map(file.metadata.row_group, range(file.num_row_groups))
            lacking = sum(group.num_rows for group in groups) - row
        if lacking:
            what = f"the file lacks {lacking} rows of the columns that are read"
            raise DataError(what, hint=AGAIN)
        if row == 0:
            raise DataError("the file has no rows", hint=EMPTY)

    def look(self) -> Contents:
        """Its schema, and rows from the beginning of some row groups."""
        from tdfscal.logs.contents import DATED, SAMPLES, TableLook  # not needed to read it

        with _opened(self.path) as file:
            leaves = _leaves(file)
            plain = [f.path for f in leaves if _holds(f) in (None, "string")]
            rows = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
            groups = np.linspace(0, len(rows) - 1, min(len(rows), _GROUPS)).round().astype(int)
            size = max(_FEWEST, _LOOKED_AT // max(len(groups), 1))
            look = TableLook(-(-_GROUPS * SAMPLES // max(len(groups), 1)))
            for group in groups.tolist():
                for begin in range(0, len(plain), _TOGETHER):
                    names = plain[begin : begin + _TOGETHER]
                    for table in islice(_tables(file, group, names, size), 1):
                        look.add(sum(rows[:group]), table)
        columns = [
            (name, name, DATED if look.kind(name) == DATED else _kind(leaf), None)
            for leaf, name in ((leaf, leaf.path) for leaf in leaves)
        ]
        return look.contents(self.path, "parquet", sum(rows), columns)


@contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a file such that page checksums are verified where there are any."""
    with path.open("rb") as stream:
        size = stream.seek(-len(_MARK), SEEK_END) + len(_MARK)
        if stream.read() != _MARK:
            what = f"the file ends at byte {size} without a footer that says where columns are"
            raise DataError(f"{what}: it was cut short, or more was written behind", hint=AGAIN)
        known = pq.read_metadata(stream)
        sizes = [known.row_group(k).total_byte_size for k in range(known.num_row_groups)]
        # Pyarrow takes no other names than UTF-8; Python opens any.
        named = in_utf8(str(path)) == str(path)
        with pq.ParquetFile(
            path if named else stream,
            metadata=known,
            page_checksum_verification=True,
            pre_buffer=False,
            buffer_size=_BUFFER if max(sizes, default=0) > _AT_ONCE else 0,
        ) as file:
            yield file


def _tables(
    file: pq.ParquetFile, group: int, names: Sequence[str], size: int
) -> Iterator[pa.Table]:
    """Yield a row group in tables of the named columns: no structs, texts of one type."""
    for batch in file.iter_batches(batch_size=size, row_groups=[group], columns=names):
        table = pa.Table.from_batches([batch])
        while any(pa.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        for k, field in enumerate(table.schema):
            kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
            kind = pa.string() if pa.types.is_large_string(kind) else kind
            if kind != field.type:
                table = table.set_column(k, field.name, table[k].cast(kind))
        yield table


def _leaves(file: pq.ParquetFile) -> list[Any]:
    """Columns of the schema, structs taken apart, as pyarrow's `ColumnSchema`."""
    return [file.schema.column(k) for k in range(len(file.schema))]


def _holds(leaf: Any) -> str | None:
    """What a column holds whose rows cannot be numbers of a few bytes each; None of numbers."""
    if leaf.max_repetition_level:
        return "a list"
    match leaf.physical_type:
        case "BOOLEAN":
            return "bool"
        case "BYTE_ARRAY":
            return "string" if leaf.logical_type.type == "STRING" else "bytes"
        case "FIXED_LEN_BYTE_ARRAY" if leaf.length > _WIDEST:
            return "bytes"
    return None


def _kind(leaf: Any) -> str:
    logical = str(leaf.logical_type.type).lower()
    return logical if logical not in ("none", "unknown") else str(leaf.physical_type).lower()


def _wanted(file: pq.ParquetFile, request: Request) -> list[str]:
    """Names of the columns to read. Raises DataError where one is missing or holds no numbers."""
    leaves = _leaves(file)
    column_of = columns_of(request, [leaf.path for leaf in leaves])
    for name, k in column_of.items():
        holds = _holds(leaves[k])
        dated = name == request.mapping.time_field and holds == "string"
        if holds is not None and not dated:
            raise _no_numbers(name, holds)
    return list(column_of)


def _takes_turns(opening: pa.Table, request: Request) -> bool:
    """Whether a table is of streams with times of their own; see `table.takes_turns`."""
    filled = [
        sum(~holes(opening.column(name)) for name in signal.components)
        for signal in request.signals
    ]
    return takes_turns(np.array(filled))


def _vectors(table: pa.Table, request: Request, row: int, *, sparse: bool) -> FloatArray:
    """The signals (signals, 3, N), SI; NaN where a row of a sparse table leaves one out."""
    vectors = np.empty((len(request.signals), 3, table.num_rows))
    for vector, signal in zip(vectors, request.signals, strict=True):
        columns = [table.column(name) for name in signal.components]
        absent = np.zeros(table.num_rows, dtype=np.bool_)
        if sparse:
            absent = np.logical_and.reduce([holes(column) for column in columns])
        each = zip(vector, signal.components, columns, signal.factors, strict=True)
        for axis, name, column, factor in each:
            np.multiply(_numbers(column, name, row, absent), factor, out=axis)
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
        raise _fault("the cell is empty", name, row + int(np.argmax(holes(column))))
    if not row and first_date(column) is None:
        raise _no_numbers(name, "string")
    seconds = seconds_of_all(column, zoned=zoned)
    if (none := np.isnan(seconds)).any():
        k = int(np.argmax(none))
        what = f"{shorten(column[k].as_py())!r} is no date and time as the first row has one"
        raise _fault(what, name, row + k, hint=DATES)
    return seconds


def _numbers(column: Any, name: str, row: int, absent: BoolArray | None = None) -> FloatArray:
    """Return a column as (N,) float64, each value present, but for those absent, and finite."""
    kind = column.type
    if not is_number(kind):
        raise _no_numbers(name, str(kind))
    if column.null_count:
        empty = holes(column) if absent is None else holes(column) & ~absent
        if empty.all() and not row:
            raise _fault("no cell of the column holds a number", name, row, fields=(name,))
        if empty.any():
            raise _fault("the cell is empty", name, row + int(np.argmax(empty)))
        column = column.fill_null(0)
    numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False)
    values = as_numpy(numbers)
    if not (np.isfinite(values.sum()) or np.isfinite(values).all()):
        k = int(np.argmin(np.isfinite(values)))
        fields = (name,) if np.isnan(values).all() and not row else ()
        raise _fault(f"{values[k]} is not a finite number", name, row + k, fields=fields)
    return values


def _fault(
    what: str,
    name: str,
    row: int,
    *,
    hint: str = "correct that cell, or leave its row out",
    fields: Sequence[str] = (),
) -> DataError:
    """The error for a cell; fields : the column, where none of its cells is a number."""
    where = f"column {name}, row {row}"
    return DataError(what, where=where, hint=f"{hint}; rows count from 0", fields=fields)


def _no_numbers(name: str, holds: str) -> DataError:
    return DataError(
        f"column {name} holds {holds}, not numbers",
        hint="name a column of numbers in the log block of rig.yaml",
        fields=(name,),
    )
