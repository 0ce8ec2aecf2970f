"""What the pages of a Parquet file state before they are decompressed: sizes and checksums.

pyarrow verifies a page's CRC where there is one and does not say whether there was; it allocates
what a page states. A page header is a Thrift struct in the compact protocol: PageHeader {1: type,
2: uncompressed size, 3: compressed size, 4: optional crc, …} (parquet-format, parquet.thrift).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

MAX_PAGE: Final = 256 << 20
"""Largest page, in bytes when decompressed, that is read."""

_GLANCE: Final = 256
_MOST: Final = 4096
_UNCOMPRESSED, _COMPRESSED, _CRC = 2, 3, 4
_TRUE, _FALSE, _I8, _DOUBLE, _BINARY, _LIST, _SET, _STRUCT = 1, 2, 3, 7, 8, 9, 10, 12
_VARINTS: Final = frozenset({4, 5, 6})


@dataclass(frozen=True, slots=True)
class _Page:
    uncompressed: int
    end: int
    checked: bool


def check_pages(path: Path, group: Any, columns: Sequence[int]) -> bool:
    """Look at the page headers of a row group; tell whether every page has a checksum.

    Parameters
    ----------
    group : pyarrow's RowGroupMetaData. columns : numbers of leaf columns.

    Raises
    ------
    ValueError : a page states more than MAX_PAGE bytes, or the pages do not fill their column.
    """
    checked = True
    with path.open("rb") as file:
        for k in columns:
            chunk = group.column(k)
            start = chunk.data_page_offset
            if chunk.has_dictionary_page and chunk.dictionary_page_offset is not None:
                start = min(start, chunk.dictionary_page_offset)
            for page in _pages(file, start, start + chunk.total_compressed_size):
                if not 0 <= page.uncompressed <= MAX_PAGE:
                    raise ValueError(
                        f"a page of column {chunk.path_in_schema} states {page.uncompressed} "
                        f"bytes, more than {MAX_PAGE >> 20} MiB"
                    )
                checked &= page.checked
    return checked


def _pages(file: BinaryIO, position: int, end: int) -> Iterator[_Page]:
    """Go from page to page; a header that statistics make long is read again with more bytes."""
    while position < end:
        glance = _GLANCE
        while True:
            file.seek(position)
            data = file.read(glance)
            try:
                numbers, length = _fields(data)
                break
            except IndexError:
                if len(data) < glance or glance > 1 << 20:
                    raise ValueError("a page header does not end") from None
                glance *= 16
        size = numbers.get(_COMPRESSED, -1)
        if size < 0 or position + length + size > end:
            raise ValueError("a page is longer than its column")
        position += length + size
        yield _Page(numbers.get(_UNCOMPRESSED, -1), position, _CRC in numbers)


def _fields(data: bytes) -> tuple[dict[int, int], int]:
    """Integer fields of the struct at the begin of data, and its length in bytes."""
    found: dict[int, int] = {}
    position, field = 0, 0
    while data[position]:
        kind, delta = data[position] & 0x0F, data[position] >> 4
        position += 1
        if delta:
            field += delta
        else:
            number, position = _varint(data, position)
            field = _signed(number)
        if kind in _VARINTS:
            number, position = _varint(data, position)
            found[field] = _signed(number)
        else:
            position = _skip(data, position, kind, 0)
    return found, position + 1


def _skip(data: bytes, position: int, kind: int, depth: int) -> int:
    """Return where a value that does not matter ends."""
    if depth > 8:
        raise ValueError("a page header is nested too deeply")
    if kind in (_TRUE, _FALSE):
        return position
    if kind == _I8:
        return position + 1
    if kind in _VARINTS:
        return _varint(data, position)[1]
    if kind == _DOUBLE:
        return position + 8
    if kind == _BINARY:
        length, position = _varint(data, position)
        return position + length
    if kind in (_LIST, _SET):
        count, inner = data[position] >> 4, data[position] & 0x0F
        position += 1
        if count == 15:
            count, position = _varint(data, position)
        if count > _MOST:
            raise ValueError("a page header holds too long a list")
        for _ in range(count):
            # Within a list each truth value takes a byte.
            position = position + 1 if inner in (_TRUE, _FALSE) else (
                _skip(data, position, inner, depth + 1)
            )  # fmt: skip
        return position
    if kind == _STRUCT:
        while data[position]:
            inner, delta = data[position] & 0x0F, data[position] >> 4
            position += 1
            if not delta:
                position = _varint(data, position)[1]
            position = _skip(data, position, inner, depth + 1)
        return position + 1
    raise ValueError("a page header holds an unknown type")


def _varint(data: bytes, position: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = data[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise ValueError("a number in a page header is too long")


def _signed(number: int) -> int:
    return (number >> 1) ^ -(number & 1)
