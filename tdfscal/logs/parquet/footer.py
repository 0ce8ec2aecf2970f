"""What the footer of a Parquet file states, and how far it is believed."""

from __future__ import annotations

import base64
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from tdfscal.errors import DataError
from tdfscal.files.hashing import printable
from tdfscal.logs.parquet.pages import look_at_pages

MAX_FOOTER: Final = 16 << 20
"""Longest text, in bytes, that a footer may state; that of a day at 1 kHz has a few MB in all."""
MAX_LIST: Final = 1 << 20
"""Longest list in a footer."""
MAX_PAGES: Final = 640 << 20
"""Bytes that the largest page may take, times the columns that are read together."""

_ROWS_PER_BYTE: Final = 4
_VALUE: Final = 8  # bytes
_WIDEST: Final = 32  # bytes
_AT_ONCE: Final = 32 << 20
"""Largest row group, in bytes, whose columns are read in one go: faster."""
_BUFFER: Final = 1 << 20


@contextmanager
def open_parquet(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a file such that checksums are verified and no absurd length is believed.

    Texts come as dictionaries: each is there once, however many rows repeat it.

    Raises ValueError where its footer is absurd, or contradicts itself.
    """
    size = path.stat().st_size
    limits = {"thrift_string_size_limit": MAX_FOOTER, "thrift_container_size_limit": MAX_LIST}
    with path.open("rb") as stream:
        first = pq.ParquetFile(stream, pre_buffer=False, **limits)
        known, texts = first.metadata, [leaf.path for leaf in leaves_of(first) if is_text(leaf)]
        groups = [known.row_group(k) for k in range(known.num_row_groups)]
        if known.num_rows != sum(group.num_rows for group in groups):
            raise ValueError("the footer contradicts itself about the number of rows")
        if known.num_rows > _ROWS_PER_BYTE * size:
            raise ValueError(f"{known.num_rows} rows are stated in a file of {size} bytes")
        largest = max((group.total_byte_size for group in groups), default=0)
        # Pyarrow takes no other names than UTF-8; Python opens any.
        named = printable(str(path)) == str(path)
        with pq.ParquetFile(
            path if named else stream,
            metadata=known,
            read_dictionary=texts,
            page_checksum_verification=True,
            pre_buffer=False,
            buffer_size=_BUFFER if largest > _AT_ONCE else 0,
            **limits,
        ) as file:
            yield file


def check_pages(path: Path, file: pq.ParquetFile, names: Sequence[str]) -> bool:
    """Tell whether every page of a file has a checksum; names : of the columns to be read.

    Raises DataError for pages that need too much memory.
    """
    known = file.metadata
    pages = look_at_pages(path)
    complete = pages.values >= known.num_rows * known.num_columns
    # Without all page headers, as if each column of a row group were one page.
    longest = max((known.row_group(k).num_rows for k in range(known.num_row_groups)), default=0)
    largest = pages.largest if complete else max(pages.largest, _VALUE * longest)
    if largest * len(names) > MAX_PAGES:
        raise DataError(
            f"a page states {largest} bytes; one of each of the {len(names)} columns needs more "
            f"than {MAX_PAGES >> 20} MiB",
            hint="write the file again with row groups of a million rows at most",
        )
    return complete and pages.checked


@dataclass(slots=True)
class Places:
    """Which bytes the columns of these indices are read from; no two may share any.

    No checksum covers the footer: a page that it has taken for another column's is a sound one.
    """

    known: pq.FileMetaData
    columns: Sequence[int]
    taken: list[tuple[int, int]] = field(default_factory=list)

    def add(self, group: int) -> None:
        """Note a row group of which pyarrow has begun to read.

        Not before: asking for the place of a column that it cannot read ends the process.
        """
        for column in dict.fromkeys(self.columns):  # two signals may share one
            chunk = self.known.row_group(group).column(column)
            # Pyarrow begins at the dictionary where that comes first.
            places = (chunk.data_page_offset, chunk.dictionary_page_offset)
            begin = min((place for place in places if place), default=0)
            end = begin + chunk.total_compressed_size
            k = bisect_right(self.taken, (begin, end))
            if any(b < end and begin < e for b, e in self.taken[max(k - 1, 0) : k + 1]):
                raise ValueError("the footer contradicts itself about where its columns lie")
            self.taken.insert(k, (begin, end))


def leaves_of(file: pq.ParquetFile) -> list[Any]:
    """Columns of the schema, structs taken apart, as pyarrow's `ColumnSchema`."""
    return [file.schema.column(k) for k in range(len(file.schema))]


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


def stated_twice(file: pq.ParquetFile, names: Sequence[str]) -> str | None:
    """What is wrong where Parquet and Arrow state different types of a column in the footer.

    No checksum covers these. A writer that coerces times leaves them different too, so only a file
    that claims to be intact is to be refused for it.
    """
    encoded = (file.metadata.metadata or {}).get(b"ARROW:schema")
    if encoded is None:
        return None
    written = pa.ipc.read_schema(pa.py_buffer(base64.b64decode(encoded)))
    there = file.schema_arrow.names
    for name in (n if n in there else n.partition(".")[0] for n in names):
        if (written.names.count(name), there.count(name)) != (1, 1):
            return f"the footer contradicts itself about column {name}"
        read, known = (schema.field(name).type for schema in (file.schema_arrow, written))
        if pa.types.is_dictionary(read):
            continue  # texts, whatever Arrow has kept them in
        # Parquet knows no seconds; Arrow writes ms for them.
        if read != known and (read, known) != (pa.timestamp("ms"), pa.timestamp("s")):
            return f"the footer states the type of column {name} twice, as {read} and as {known}"
    return None


def is_duration(file: pq.ParquetFile, time: str) -> bool:
    """Whether the time's unit stands in the Arrow schema alone, which no checksum covers."""
    schema = file.schema_arrow
    return time in schema.names and pa.types.is_duration(schema.field(time).type)
