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
from tdfscal.files.rig.recorders import UNITS, canonical
from tdfscal.files.saving import in_utf8
from tdfscal.logs.log_file import AGAIN, EMPTY, LogFile, Piece, Request
from tdfscal.logs.table import (
    Wanted,
    columns_of,
    first_date,
    has_zone,
    holes,
    no_numbers,
    table_piece,
    takes_turns,
)

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
_LOOKED_AT: Final = 1 << 15  # rows, of so many groups at most
_GROUPS: Final = 32


class ParquetLog(LogFile):
    """One Parquet file."""

    faults = (pa.ArrowException,)
    mark, kind = _MARK, "Parquet file"

    def read(self, request: Request) -> Iterator[Piece]:
        """Yield the rows of the wanted columns."""
        with _opened(self.path) as file:
            names, row, wanted = _names(file, request), 0, None
            for number in range(file.num_row_groups):
                for table in _tables(file, number, names, _ROWS):
                    wanted = wanted or _wanted(table.slice(0, _SEARCHED_ROWS), request)
                    vectors, time = wanted.values(table, row)
                    yield table_piece(request, vectors, time, row, sparse=wanted.sparse)
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
        from tdfscal.logs.contents import table_contents  # not needed to read it

        with _opened(self.path) as file:
            leaves, parts = _leaves(file), list[tuple[int, pa.Table]]()
            plain = [leaf.path for leaf in leaves if _holds(leaf) in (None, "string")]
            rows = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
            groups = np.linspace(0, len(rows) - 1, min(len(rows), _GROUPS)).round().astype(int)
            for group in groups.tolist():
                some = _tables(file, group, plain, _LOOKED_AT // len(groups))
                parts += [(sum(rows[:group]), table) for table in islice(some, 1)]
        columns = [(leaf.path, leaf.path, _kind(leaf), None) for leaf in leaves]
        return table_contents(self.path, "parquet", sum(rows), parts, columns)


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


def _names(file: pq.ParquetFile, request: Request) -> list[str]:
    """Names of the columns to read. Raises DataError where one is missing or holds no numbers."""
    leaves = _leaves(file)
    column_of = columns_of(request, [leaf.path for leaf in leaves])
    for name, k in column_of.items():
        holds = _holds(leaves[k])
        dated = name == request.mapping.time.field and holds == "string"
        if holds is not None and not dated:
            raise no_numbers(name, holds)
    return list(column_of)


def _wanted(opening: pa.Table, request: Request) -> Wanted:
    """The wanted columns, by the first rows of the table."""
    signals = tuple((signal.components, signal.factors) for signal in request.signals)
    name, second = request.mapping.time.field, UNITS["time"][canonical(request.mapping.time.unit)]
    if name not in opening.column_names:
        return Wanted(signals, None, second, None, sparse=False)
    date = first_date(opening.column(name))
    filled = [sum(~holes(opening.column(axis)) for axis in three) for three, _ in signals]
    zoned = None if date is None else has_zone(date)
    return Wanted(signals, name, second, zoned, takes_turns(np.array(filled)))
