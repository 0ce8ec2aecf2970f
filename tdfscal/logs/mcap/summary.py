"""What an MCAP file repeats at its end, read before the rest.

So a wrong mapping is named at once, and definitions that are damaged in their place are known.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Schema, Statistics

from tdfscal.logs.mcap.chunk import exact

_HEAD: Final = struct.Struct("<BQ")
_MAGIC_BYTES: Final = 8
_FOOTER_BYTES: Final = _HEAD.size + 20 + _MAGIC_BYTES
_LARGEST: Final = 64 << 20
_DAMAGE: Final = (OSError, ValueError, struct.error, McapError)


class Summary(NamedTuple):
    """Schemas and channels by id. complete : the file has no others. sound : no checksum denies it.

    A name in a summary whose checksum does not match may be another one.
    """

    schemas: Mapping[int, Schema]
    channels: Mapping[int, Channel]
    complete: bool
    sound: bool


def read_summary(path: Path) -> Summary:
    """Return what a file says at its end; nothing where that is missing or damaged.

    What is damaged is left to the reading of the file, which says where.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    stated = 0
    try:
        data, sound = _summary(path)
        position = 0
        while position < len(data):
            opcode, length = _HEAD.unpack_from(data, position)
            position += _HEAD.size
            content = exact(data[position : position + length])
            position += length
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(content)
                schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(content)
                channels[channel.id] = channel
            elif opcode == Opcode.STATISTICS:
                stated = Statistics.read(content).channel_count
    except _DAMAGE:
        return Summary({}, {}, complete=False, sound=False)
    return Summary(schemas, channels, complete=len(channels) == stated > 0, sound=sound)


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
