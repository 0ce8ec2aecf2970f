"""Messages of a bag, put side by side as a recording's buffer holds them."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from mcap.records import Channel, Schema

from tdfscal.logs.messages.buffer import DATA, Messages, Recording

_HEAD: Final = struct.Struct("<BQHIQQ")
_MESSAGE: Final = 5  # the kind of record
_AT_ONCE: Final = 4 << 20


@dataclass(slots=True)
class Stored(Recording):
    """A recording in any bag; none has checksums."""

    def define(
        self, number: int, topic: str, encoding: str, kind: str, schema: tuple[str, bytes]
    ) -> None:
        """Note a channel; schema : the encoding and text of its message definition."""
        self.schemas[number + 1] = Schema(
            id=number + 1, name=kind, encoding=schema[0], data=schema[1]
        )
        self.channels[number] = Channel(
            id=number, topic=topic, message_encoding=encoding, metadata={}, schema_id=number + 1
        )

    def packed(self, rows: Iterable[tuple[int, int, bytes]]) -> Iterator[Messages]:
        """Yield (channel, ns, data) as messages, some MB at a time, and count them."""
        size = max(self.path.stat().st_size, 1)
        buffer = bytearray()
        starts: list[int] = []
        for number, time, data in rows:
            if number not in self.channels:
                raise ValueError("a message belongs to no topic")
            if not 0 <= time < 1 << 63:
                raise ValueError(f"a message was recorded at {time} ns")
            starts.append(len(buffer))
            buffer += _HEAD.pack(_MESSAGE, DATA - 9 + len(data), number, 0, time, time)
            buffer += data
            self.counts[number] = self.counts.get(number, 0) + 1
            if len(buffer) >= _AT_ONCE:
                self.reached = min(self.reached + len(buffer), size)
                yield _messages(buffer, starts)
                buffer, starts = bytearray(), []
        if starts:
            yield _messages(buffer, starts)


def _messages(buffer: bytearray, starts: list[int]) -> Messages:
    data = bytes(buffer)
    offset = np.array(starts, dtype=np.int64)
    length = np.diff(offset, append=len(data)) - DATA
    at = np.frombuffer(data, np.uint8)
    channel = at[offset + 9].astype(np.int64) + 256 * at[offset + 10].astype(np.int64)
    return Messages(data, offset, length, channel)
