"""What an MCAP file repeats at its end, read before the rest.

So a wrong mapping is named at once, and definitions that are damaged in their place are known.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Footer, Schema, Statistics

from tdfscal.logs.mcap.chunk import exact
from tdfscal.logs.mcap.record_stream import (
    HEAD,
    IN_SUMMARY,
    RecordStream,
    TruncatedError,
    summary_crc,
)

_FOOTER_BYTES: Final = HEAD.size + 20 + 8  # with the mark at the end
_LARGEST: Final = 64 << 20


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
        with path.open("rb") as file:
            end = path.stat().st_size - _FOOTER_BYTES
            stream = RecordStream(file, path)
            stream.seek(max(end, 0))
            _, content = stream.record(frozenset({Opcode.FOOTER}))
            footer = Footer.read(exact(content))
            if not footer.summary_start:
                return Summary({}, {}, complete=False, sound=True)
            if end - footer.summary_start > _LARGEST:
                raise ValueError("the footer points to the wrong place")
            stream.seek(footer.summary_start)
            while (record := stream.record(IN_SUMMARY))[0] != Opcode.FOOTER:
                opcode, content = record
                if opcode == Opcode.SCHEMA:
                    schema = Schema.read(exact(content))
                    schemas[schema.id] = schema
                elif opcode == Opcode.CHANNEL:
                    channel = Channel.read(exact(content))
                    channels[channel.id] = channel
                elif opcode == Opcode.STATISTICS:
                    stated = Statistics.read(exact(content)).channel_count
    except (OSError, ValueError, struct.error, McapError, TruncatedError):
        return Summary({}, {}, complete=False, sound=False)
    sound = footer.summary_crc in (0, summary_crc(stream.crc_before, record[1]))
    return Summary(schemas, channels, complete=len(channels) == stated > 0, sound=sound)
