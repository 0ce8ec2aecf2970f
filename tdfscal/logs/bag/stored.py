"""A recording in any bag; its messages are put side by side as a recording's buffer holds them."""

from __future__ import annotations

import struct
from abc import abstractmethod
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from mcap.records import Channel, Schema

from tdfscal.errors import DataError
from tdfscal.logs.common.contents import Format
from tdfscal.logs.messages.buffer import DATA, Messages, Recording, gather

_HEAD: Final = struct.Struct("<BQHIQQ")
_MESSAGE: Final = 5  # the kind of record
_AT_ONCE: Final = 4 << 20


@dataclass(slots=True)
class Stored(Recording):
    """A bag while it is read; none has checksums.

    opening : with which its file begins, and what it is. damage : what its library raises.
    """

    form: ClassVar[Format] = "bag"
    opening: ClassVar[tuple[bytes, str]]
    damage: ClassVar[tuple[type[Exception], ...]]

    @abstractmethod
    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Define the channels; yield (channel, ns, data) of each message."""

    def is_cut_short(self) -> bool:
        """Tell whether the file states to be longer than it is."""
        return False

    def messages(self) -> Generator[Messages, None, None]:
        """Yield the messages in the order that the bag has them."""
        mark, kind = self.opening
        with self.path.open("rb") as file:
            if file.read(len(mark)) != mark:
                raise DataError(f"the file is no {kind}", hint="copy the recording again")
        try:
            yield from self._packed()
        except self.damage as error:
            if not self.counts or not self.is_cut_short():
                raise ValueError(f"the {kind} cannot be read") from error
            self.cut_at = self.path.stat().st_size

    def define(
        self, number: int, topic: str, encoding: str, kind: str, schema: tuple[str, bytes]
    ) -> None:
        """Note a channel; schema : the encoding and text of its message definition."""
        encoded, text = schema
        self.schemas[number + 1] = Schema(id=number + 1, name=kind, encoding=encoded, data=text)
        self.channels[number] = Channel(
            id=number, topic=topic, message_encoding=encoding, metadata={}, schema_id=number + 1
        )

    def _packed(self) -> Iterator[Messages]:
        """Some MB of messages at a time, and count them."""
        size = max(self.path.stat().st_size, 1)
        buffer = bytearray()
        starts: list[int] = []
        for number, time, data in self.rows():
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
    return Messages(data, offset, length, gather(data, offset + 9, "<u2").astype(np.int64))
