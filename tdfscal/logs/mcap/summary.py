"""What an MCAP file repeats at its end, read before the rest.

So a wrong mapping is named at once, and definitions that are damaged in their place are known.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Schema, Statistics

from tdfscal.logs.mcap.chunk import exact

_HEAD: Final = struct.Struct("<BQ")
_MAGIC_BYTES: Final = 8
_FOOTER_BYTES: Final = _HEAD.size + 20 + _MAGIC_BYTES
_LARGEST: Final = 64 << 20
_DAMAGE: Final = (OSError, ValueError, struct.error, McapError)

Definitions = tuple[Mapping[int, Schema], Mapping[int, Channel]]
"""Schemas and channels by id."""


def announced_topics(path: Path) -> frozenset[str] | None:
    """Return the topics of the summary; None without one, or where it may not name all.

    What is damaged is left to the reading of the file, which says where.
    """
    topics: set[str] = set()
    channels, stated = 0, None
    try:
        for opcode, content in _records(_summary(path)[0]):
            if opcode == Opcode.CHANNEL:
                topics.add(Channel.read(exact(content)).topic)
                channels += 1
            elif opcode == Opcode.STATISTICS:
                stated = Statistics.read(exact(content)).channel_count
    except _DAMAGE:
        return None
    return frozenset(topics) if stated and channels == stated else None


def repeated_definitions(path: Path) -> Definitions:
    """Return the schemas and channels of the summary; none where it is missing or damaged.

    A summary whose checksum does not match is not believed: a name in it may be another one.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    try:
        data, sound = _summary(path)
        for opcode, content in _records(data) if sound else ():
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(exact(content))
                schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(exact(content))
                channels[channel.id] = channel
    except _DAMAGE:
        return {}, {}
    return schemas, channels


def _summary(path: Path) -> tuple[bytes, bool]:
    """Return the records between data section and footer, and whether no checksum denies them.

    Raises OSError, ValueError, struct.error or McapError where it is damaged.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(size - _FOOTER_BYTES, 0))
        head = file.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head)
        if opcode != Opcode.FOOTER or length != 20:
            raise ValueError("there is no footer")
        content = file.read(length)
        footer = Footer.read(exact(content))
        start = footer.summary_start
        if not start:
            return b"", True
        if start >= size or size - start > _LARGEST:
            raise ValueError("the footer points to the wrong place")
        file.seek(start)
        data = file.read(size - start - _FOOTER_BYTES)
    covered = zlib.crc32(head + content[:16], zlib.crc32(data))
    return data, footer.summary_crc in (0, covered)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    position = 0
    while position < len(data):
        opcode, length = _HEAD.unpack_from(data, position)
        position += _HEAD.size
        yield opcode, data[position : position + length]
        position += length
