"""Which topics an MCAP file announces at its end, so that a wrong mapping is named at once."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Statistics

from tdfscal.files.logs.container import exact

_HEAD: Final = struct.Struct("<BQ")
_MAGIC_BYTES: Final = 8
_FOOTER_BYTES: Final = _HEAD.size + 20 + _MAGIC_BYTES
_LARGEST: Final = 64 << 20


def announced_topics(path: Path) -> frozenset[str] | None:
    """Return the topics of the summary; None without one, or where it may not name all.

    What is damaged is left to the reading of the file, which says where.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            file.seek(size - _FOOTER_BYTES)
            opcode, length = _HEAD.unpack(file.read(_HEAD.size))
            if opcode != Opcode.FOOTER or length != 20:
                return None
            start = Footer.read(exact(file.read(length))).summary_start
            if not 0 < start < size or size - start > _LARGEST:
                return None
            file.seek(start)
            data = file.read(size - start - _FOOTER_BYTES)
        topics: set[str] = set()
        channels, stated = 0, None
        position = 0
        while position < len(data):
            opcode, length = _HEAD.unpack_from(data, position)
            content = data[position + _HEAD.size : position + _HEAD.size + length]
            if opcode == Opcode.CHANNEL:
                topics.add(Channel.read(exact(content)).topic)
                channels += 1
            elif opcode == Opcode.STATISTICS:
                stated = Statistics.read(exact(content)).channel_count
            position += _HEAD.size + length
    except (OSError, ValueError, struct.error, McapError):
        return None
    return frozenset(topics) if stated and channels == stated else None
