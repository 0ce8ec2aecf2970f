"""Whether the pages of a Parquet file carry checksums.

pyarrow verifies a page's CRC where there is one and does not say whether there was. A page
header is a Thrift struct in the compact protocol: PageHeader {1: type, 2: uncompressed size,
3: compressed size, 4: optional crc, …}, all i32 (parquet-format, parquet.thrift).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

_HEADER_BYTES = 64
_I32 = 5
_CRC = 4


def has_checksums(path: Path, group: Any, columns: Sequence[int]) -> bool:
    """Tell whether the first page of each of the given columns has a checksum.

    Parameters
    ----------
    group : pyarrow's RowGroupMetaData. columns : numbers of leaf columns.
    """
    with path.open("rb") as file:
        for k in columns:
            chunk = group.column(k)
            start = chunk.data_page_offset
            if chunk.has_dictionary_page and chunk.dictionary_page_offset is not None:
                start = min(start, chunk.dictionary_page_offset)
            file.seek(start)
            if not _has_crc(file.read(_HEADER_BYTES)):
                return False
    return True


def _has_crc(header: bytes) -> bool:
    """Read field headers up to field 4; the fields before it are i32 each."""
    position, field = 0, 0
    while position < len(header):
        byte = header[position]
        position += 1
        delta, kind = byte >> 4, byte & 0x0F
        field += delta
        if delta == 0 or kind != _I32 or field > _CRC:
            return False
        if field == _CRC:
            return True
        while position < len(header) and header[position] & 0x80:
            position += 1
        position += 1
    return False
