"""A Parquet file that is open: its columns by name, structs and lists taken apart."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import SEEK_END
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.hashing import printable
from tdfscal.logs.log_file import AGAIN

_WIDEST: Final = 32  # bytes of a number
_AT_ONCE: Final = 32 << 20
"""Largest row group, in bytes, whose columns are read in one go: faster."""
_BUFFER: Final = 1 << 20
MARK: Final = b"PAR1"
"""With which a file begins and ends."""
_ELEMENT: Final = re.compile(r"(?P<column>.+)\[(?P<place>\d{1,6})\]")


@contextmanager
def open_parquet(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a file such that page checksums are verified where there are any."""
    with path.open("rb") as stream:
        size = stream.seek(-len(MARK), SEEK_END) + len(MARK)
        if stream.read() != MARK:
            what = f"the file ends at byte {size} without a footer that says where columns are"
            raise DataError(f"{what}: it was cut short, or more was written behind", hint=AGAIN)
        known = pq.read_metadata(stream)
        sizes = [known.row_group(k).total_byte_size for k in range(known.num_row_groups)]
        # Pyarrow takes no other names than UTF-8; Python opens any.
        named = printable(str(path)) == str(path)
        with pq.ParquetFile(
            path if named else stream,
            metadata=known,
            page_checksum_verification=True,
            pre_buffer=False,
            buffer_size=_BUFFER if max(sizes, default=0) > _AT_ONCE else 0,
        ) as file:
            yield file


def leaves_of(file: pq.ParquetFile) -> list[Any]:
    """Columns of the schema, structs taken apart, as pyarrow's `ColumnSchema`."""
    return [file.schema.column(k) for k in range(len(file.schema))]


def lists_of(file: pq.ParquetFile) -> tuple[str, ...]:
    """Columns that hold a list of numbers in each row."""
    return tuple(_lists(file.schema_arrow, ""))


def _lists(fields: Any, before: str) -> Iterator[str]:
    types = pa.types
    for field in fields:
        kind, name = field.type, before + field.name
        if types.is_struct(kind):
            yield from _lists(kind.fields, f"{name}.")
            continue
        listed = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
        if listed and (types.is_floating(kind.value_type) or types.is_integer(kind.value_type)):
            yield name


def element_of(name: str, lists: Sequence[str]) -> tuple[str, int] | None:
    """Which list column, and which of its elements, a name such as `state[3]` means."""
    match = _ELEMENT.fullmatch(name)
    return (match["column"], int(match["place"])) if match and match["column"] in lists else None


def batches(
    file: pq.ParquetFile, group: int, names: Sequence[str], size: int
) -> Iterator[pa.Table]:
    """Yield a row group in tables of the named columns, elements of lists among them.

    Raises DataError where the columns end before the group does.
    """
    left = file.metadata.row_group(group).num_rows
    lists = lists_of(file)
    elements = {name: found for name in names if (found := element_of(name, lists)) is not None}
    whole = [name for name in names if name not in elements]
    wanted = [*whole, *dict.fromkeys(column for column, _ in elements.values())]
    for batch in file.iter_batches(batch_size=size, row_groups=[group], columns=wanted):
        table = flattened(batch)
        for name, (column, place) in elements.items():
            length = pc.min(pc.list_value_length(table.column(column))).as_py()
            if length is not None and place >= length:
                raise DataError(
                    f"a row of column {column} has {length} numbers",
                    hint=f"elements count from 0: {name} is one more than the list has",
                )
            table = table.append_column(name, pc.list_element(table.column(column), place))
        left -= table.num_rows
        yield table
    if left:
        what = f"row group {group} lacks {left} rows of the columns that are read"
        raise DataError(what, hint=AGAIN)


def flattened(batch: pa.RecordBatch) -> pa.Table:
    """A batch as a table without structs, its texts of one type."""
    table = pa.Table.from_batches([batch])
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    for k, field in enumerate(table.schema):
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if kind != field.type or pa.types.is_large_string(kind):
            texts = pa.types.is_large_string(kind)
            table = table.set_column(k, field.name, table[k].cast(pa.string() if texts else kind))
    return table


def is_no_number(leaf: Any) -> str | None:
    """What a column holds whose rows cannot be numbers of a few bytes each; None of numbers."""
    if leaf.max_repetition_level:
        return "a list"
    match leaf.physical_type:
        case "BOOLEAN":
            return "bool"
        case "BYTE_ARRAY":
            return "string"
        case "FIXED_LEN_BYTE_ARRAY" if leaf.length > _WIDEST:
            return "bytes"
    return None


def is_text(leaf: Any) -> bool:
    """Whether a column holds one text in each row."""
    return not leaf.max_repetition_level and leaf.logical_type.type == "STRING"
