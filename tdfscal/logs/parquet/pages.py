"""What the pages of a Parquet file state before they are decompressed: sizes and checksums.

pyarrow verifies a page's CRC where there is one and does not say whether there was; it allocates
what a page states. The CRC covers no page header, so that is held against the footer here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Final

from tdfscal.errors import DataError
from tdfscal.logs.parquet.footer import Part
from tdfscal.logs.parquet.thrift import NUMBER, STRUCT, Cursor

MAX_PAGES: Final = 640 << 20
"""Bytes that the largest page of each column may take, all columns together."""

_GLANCE: Final = 256
_LONGEST: Final = 1 << 20
_MOST: Final = 4096
_UNCOMPRESSED, _COMPRESSED, _CRC = 2, 3, 4
_DATA, _DICTIONARY, _DATA_V2 = 0, 2, 3
_DETAIL: Final = {5: _DATA, 7: _DICTIONARY, 8: _DATA_V2}
_PLAIN: Final = 0


@dataclass(frozen=True, slots=True)
class _Page:
    """detail : integers of the header of its own kind. checked : it has a checksum."""

    kind: int
    uncompressed: int
    compressed: int
    checked: bool
    detail: dict[int, int]

    @property
    def encoding(self) -> int:
        return self.detail.get(4 if self.kind == _DATA_V2 else 2, -1)

    @property
    def values(self) -> int:
        return self.detail.get(1, -1)


def check_pages(path: Path, parts: Sequence[Part]) -> bool:
    """Look at the page headers of a row group; tell whether every page has a checksum.

    Parameters
    ----------
    parts : of the columns that are read together.

    Raises
    ------
    DataError : pages that need too much memory.
    ValueError : pages that are not what the footer says.
    """
    checked = True
    together = 0
    with path.open("rb", buffering=0) as file:
        for part in parts:
            largest: dict[bool, int] = {}
            values = 0
            encodings: dict[int, int] = {}
            for page in _pages(file, part):
                checked &= page.checked
                _check(page, part)
                dictionary = page.kind == _DICTIONARY
                takes = page.uncompressed + (page.compressed if part.compressed else 0)
                largest[dictionary] = max(largest.get(dictionary, 0), takes)
                if page.kind in (_DATA, _DATA_V2):
                    values += page.values
                    encodings[page.encoding] = encodings.get(page.encoding, 0) + 1
            together += sum(largest.values())
            if together > MAX_PAGES:
                raise DataError(
                    f"the pages of column {part.leaf.path} state {sum(largest.values())} bytes; "
                    f"with the columns before it they need more than {MAX_PAGES >> 20} MiB",
                    where=str(path),
                    hint="write the file again with row groups of a million rows at most",
                )
            if values != part.values or any(
                part.encodings.get(encoding, 0) not in (None, count)
                for encoding, count in encodings.items()
            ):
                raise ValueError(f"the pages of column {part.leaf.path} are not those stated")
    return checked


def _check(page: _Page, part: Part) -> None:
    """Hold a page's sizes against the footer; what a flipped bit there would pass unseen."""
    width, size = part.leaf.width, page.uncompressed
    exact = page.kind == _DICTIONARY or (part.leaf.required and page.encoding == _PLAIN)
    if (
        size < 0
        or (page.kind != _DICTIONARY and page.values < 0)
        or (not part.compressed and size != page.compressed)
        or (exact and width is not None and size != width * page.values)
    ):
        raise ValueError(f"a page of column {part.leaf.path} states sizes that do not add up")


def _pages(file: FileIO, part: Part) -> Iterator[_Page]:
    """Go from page to page; a header that statistics make long is read again with more bytes."""
    position = part.begin
    while position < part.end:
        glance = _GLANCE
        while True:
            file.seek(position)
            data = file.read(glance)
            cursor = Cursor(data, most=_MOST)
            try:
                page = _page(cursor)
                break
            except IndexError:
                if len(data) < glance or glance > _LONGEST:
                    raise ValueError("a page header does not end") from None
                glance *= 16
        position += cursor.position + page.compressed
        if page.compressed < 0 or position > part.end:
            raise ValueError("a page is longer than its column")
        yield page


def _page(cursor: Cursor) -> _Page:
    stated: dict[int, int] = {}
    detail: dict[int, dict[int, int]] = {}
    for number, kind in cursor.fields():
        if kind in NUMBER:
            stated[number] = cursor.number()
        elif number in _DETAIL and kind == STRUCT:
            inside = detail[_DETAIL[number]] = {}
            for inner, what in cursor.fields():
                if what in NUMBER:
                    inside[inner] = cursor.number()
                else:
                    cursor.skip(what)
        else:
            cursor.skip(kind)
    kind = stated.get(1, -1)
    return _Page(
        kind, stated.get(_UNCOMPRESSED, -1), stated.get(_COMPRESSED, -1), _CRC in stated,
        detail.get(kind, {}),
    )  # fmt: skip
