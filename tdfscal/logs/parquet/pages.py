"""The page headers of a Parquet file, one after the other as they lie.

pyarrow verifies a page's checksum where there is one and does not say whether there was; and it
allocates what a page states. So the headers are looked at before the pages are read.
Field numbers are those of parquet-format's parquet.thrift, in Thrift's compact protocol: a struct
is a list of fields, each headed by its number and type, ended by a zero byte.
"""

from __future__ import annotations

from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Final, NamedTuple

_FIRST: Final = 4  # after the magic; writers put no page elsewhere
_GLANCE: Final = 256
_LONGEST: Final = 1 << 20
_TYPE, _UNCOMPRESSED, _COMPRESSED, _CRC, _VALUES = 1, 2, 3, 4, 1
_DETAIL: Final = {0: 5, 2: 7, 3: 8}  # data page, dictionary, data page v2: where its header stands
_DICTIONARY: Final = 2
_TRUTHS, _BYTE, _NUMBERS, _DOUBLE, _BINARY, _STRUCT = (1, 2), 3, (4, 5, 6), 7, 8, 12
_DEEPEST: Final = 16

Struct = dict[int, "int | Struct"]


class Pages(NamedTuple):
    """What the pages of a file state together.

    values : in all data pages. largest : bytes that the largest page takes while it is read.
    checked : every one has a checksum.
    """

    values: int
    largest: int
    checked: bool


def look_at_pages(path: Path) -> Pages:
    """Go from page to page as far as they lie side by side: what follows them is no page.

    Raises OSError where the file cannot be read.
    """
    values, largest, checked = 0, 0, True
    with path.open("rb", buffering=0) as file:
        for kind, uncompressed, compressed, own, counted in _headers(file, path.stat().st_size):
            values += 0 if kind == _DICTIONARY else counted
            largest = max(largest, uncompressed + compressed)
            checked &= own
    return Pages(values, largest, checked and values > 0)


def _headers(file: FileIO, size: int) -> Iterator[tuple[int, int, int, bool, int]]:
    """Yield kind, bytes uncompressed and compressed, whether there is a checksum, values."""
    position = _FIRST
    while position < size:
        glance = _GLANCE
        while True:  # a header that statistics make long is read again with more bytes
            file.seek(position)
            data = file.read(glance)
            try:
                header, length = _struct(data, 0, 0)
                break
            except IndexError:
                if len(data) < glance or glance > _LONGEST:
                    return
                glance *= 16
            except ValueError:
                return
        detail = header.get(_DETAIL.get(_count(header, _TYPE), 0))
        kind, uncompressed, compressed = (
            _count(header, field) for field in (_TYPE, _UNCOMPRESSED, _COMPRESSED)
        )
        counted = _count(detail, _VALUES) if isinstance(detail, dict) else -1
        if min(kind, uncompressed, compressed, counted) < 0:
            return
        position += length + compressed
        yield kind, uncompressed, compressed, _CRC in header, counted


def _count(struct: Struct, field: int) -> int:
    """A number that is not negative; -1 where there is none."""
    value = struct.get(field)
    return value if isinstance(value, int) else -1


def _struct(data: bytes, place: int, depth: int) -> tuple[Struct, int]:
    """Return the numbers and structs of the struct at a place, and where it ends.

    Raises IndexError where the data end before it, ValueError where it is none.
    """
    found: Struct = {}
    field = 0
    while head := data[place]:
        place += 1
        if head >> 4:
            field += head >> 4
        else:
            field, place = _number(data, place)
        if head & 15 in _NUMBERS:
            found[field], place = _number(data, place)
        elif head & 15 == _STRUCT and depth < _DEEPEST:
            found[field], place = _struct(data, place, depth + 1)
        else:
            place = _after(data, place, head & 15, depth)
    return found, place + 1


def _after(data: bytes, place: int, kind: int, depth: int) -> int:
    """Return where a value that is not wanted ends."""
    if kind in _TRUTHS:
        return place
    if kind in (_BYTE, _DOUBLE):
        return place + (1 if kind == _BYTE else 8)
    if kind == _BINARY:
        length, place = _varint(data, place)
        return place + length
    raise ValueError(f"no page header holds a value of type {kind}")


def _number(data: bytes, place: int) -> tuple[int, int]:
    value, place = _varint(data, place)
    return (value >> 1) ^ -(value & 1), place


def _varint(data: bytes, place: int) -> tuple[int, int]:
    value = shift = 0
    while shift < 70:
        byte = data[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
        shift += 7
    raise ValueError("a number is too long")
