"""Bags: rosbag2's storage in SQLite, and ROS 1's own format, which rosbags reads.

Their messages are put side by side as an MCAP file's records hold them, and decoded by our own
reader. No bag has checksums.
"""

from __future__ import annotations

import sqlite3
import struct
import zlib
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import closing
from typing import ClassVar, Final
from urllib.parse import quote

import numpy as np
from mcap.records import Channel, Schema
from rosbags.rosbag1 import Reader, ReaderError

from tdfscal.errors import DataError
from tdfscal.logs.log_file import AGAIN
from tdfscal.logs.messages.buffer import DATA, Messages, gather
from tdfscal.logs.messages.recording import Recording

_HEAD: Final = struct.Struct("<BQHIQQ")
_MESSAGE: Final = 5  # the kind of record
_AT_ONCE: Final = 4 << 20
_ROWS: Final = 1024
_MOST_TOPICS: Final = 1 << 16


class _BagFile(Recording):
    """A bag while it is read. broken : what its library raises."""

    form = "bag"
    broken: ClassVar[tuple[type[Exception], ...]]

    @abstractmethod
    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Define the channels; yield (channel, ns, data) of each message."""

    def define(
        self, number: int, topic: str, encoding: str, kind: str, schema: tuple[str, bytes]
    ) -> None:
        """Note a channel; schema : the encoding and text of its message definition."""
        encoded, text = schema
        self.schemas[number + 1] = Schema(id=number + 1, name=kind, encoding=encoded, data=text)
        self.channels[number] = Channel(
            id=number, topic=topic, message_encoding=encoding, metadata={}, schema_id=number + 1
        )

    def stored(self) -> Iterator[Messages]:
        """Some MB of messages at a time, in the order that the bag has them."""
        size = max(self.path.stat().st_size, 1)
        buffer, starts = bytearray(), list[int]()
        try:
            for number, time, data in self.rows():
                if number not in self.channels or not 0 <= time < 1 << 63:
                    raise ValueError(f"a message of topic {number} was recorded at {time} ns")
                starts.append(len(buffer))
                buffer += _HEAD.pack(_MESSAGE, DATA - 9 + len(data), number, 0, time, time)
                buffer += data
                if len(buffer) >= _AT_ONCE:
                    self.position = min(self.position + len(buffer), size)
                    yield _messages(buffer, starts)
                    buffer, starts = bytearray(), []
        except self.broken as error:
            raise ValueError(f"the {self.kind} cannot be read") from error
        if starts:
            yield _messages(buffer, starts)


def _messages(buffer: bytearray, starts: list[int]) -> Messages:
    data = bytes(buffer)
    offset = np.array(starts, dtype=np.int64)
    length = np.diff(offset, append=len(data)) - DATA
    return Messages(data, offset, length, gather(data, offset + 9, "<u2").astype(np.int64))


class SqliteBag(_BagFile):
    """A `.db3` file of rosbag2."""

    mark, kind = b"SQLite format 3\0", "SQLite database"
    broken = (sqlite3.Error, TypeError)

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages in the order of recording.

        Nothing of a file that was cut short: the library would fill up with zeros what is missing.
        """
        with self.path.open("rb") as file:
            size, pages = struct.unpack_from(">16xH10xI", file.read(32))
        size, there = (1 << 16 if size == 1 else size) * pages, self.path.stat().st_size
        if there < size:
            what = f"the file was cut short: it ends at byte {there} where its head states {size}"
            raise DataError(what, hint=AGAIN)
        journal = self.path.with_name(f"{self.path.name}-wal")
        if journal.is_file() and journal.stat().st_size:
            raise DataError(
                f"the recording was not closed: {journal.name} still holds a part of it",
                hint="open and close it once with `ros2 bag info`, or record it again",
            )
        uri = f"file:{quote(str(self.path.resolve()))}?mode=ro"
        # The reader may be closed by another thread than the one that reads.
        with closing(sqlite3.connect(uri, uri=True, check_same_thread=False)) as database:
            self._topics(database)
            rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
            rows.arraysize = _ROWS
            yield from rows

    def _topics(self, database: sqlite3.Connection) -> None:
        stored = "SELECT name FROM sqlite_master WHERE type = 'table'"
        tables = {name for (name,) in database.execute(stored)}
        if not {"topics", "messages"} <= tables:
            raise ValueError("it holds no tables of topics and messages")
        texts: dict[str, tuple[str, bytes]] = {}
        if "message_definitions" in tables:
            for kind, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ):
                texts[str(kind)] = str(encoding), str(text).encode()
        chosen = "SELECT id, name, type, serialization_format FROM topics"
        for identity, name, kind, encoding in database.execute(chosen):
            if not isinstance(identity, int) or not 0 <= identity < _MOST_TOPICS:
                raise ValueError(f"topic {name} has the id {identity!r}")
            # Recorders before ROS 2 Iron store no definitions: those of the standard messages.
            self.define(
                identity, str(name), str(encoding), str(kind), texts.get(str(kind), ("ros2", b""))
            )


class Ros1Bag(_BagFile):
    """A `.bag` file of ROS 1."""

    mark, kind = b"#ROSBAG V2.0\n", "ROS 1 bag"
    broken = (
        ReaderError, AssertionError, KeyError, IndexError, TypeError, RuntimeError,
        UnicodeDecodeError, struct.error, zlib.error, EOFError, OSError,
    )  # fmt: skip

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages in the order of their times."""
        try:
            reader = Reader(self.path)
            reader.open()
        except self.broken as error:
            if "index" not in str(error).lower():
                raise
            raise DataError(
                "the bag was cut short or not closed: it lacks the index that stands at its end",
                hint="write it with `rosbag reindex`, or copy the bag again",
            ) from error
        with closing(reader):
            for one in reader.connections:
                text = one.msgdef.data.encode()
                self.define(one.id, one.topic, "ros1", one.msgtype, ("ros1msg", text))
            for connection, time, data in reader.messages():
                yield connection.id, time, bytes(data)
