"""Bags: files of rosbag2 in SQLite, and of ROS 1."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import BinaryIO, ClassVar, Final
from urllib.parse import quote

import numpy as np
from mcap.records import Channel, Schema
from rosbags.interfaces import Connection
from rosbags.rosbag1 import reader as ros1

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
        buffer, starts = bytearray(), list[int]()
        try:
            for number, time, data in self.rows():
                if number not in self.channels or not 0 <= time < 1 << 63:
                    raise ValueError(f"a message of topic {number} was recorded at {time} ns")
                starts.append(len(buffer))
                buffer += _HEAD.pack(_MESSAGE, DATA - 9 + len(data), number, 0, time, time)
                buffer += data
                if len(buffer) >= _AT_ONCE:
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
    broken = (sqlite3.Error, TypeError, struct.error)

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages in the order of recording; of a file cut short, the whole ones."""
        journal = self.path.with_name(f"{self.path.name}-wal")
        if journal.is_file() and journal.stat().st_size:
            raise DataError(
                f"the recording was not closed: {journal.name} still holds a part of it",
                hint="open and close it once with `ros2 bag info`, or record it again",
            )
        with self._sound() as path:
            uri = f"file:{quote(str(path.resolve()))}?mode=ro"
            # The reader may be closed by another thread than the one that reads.
            with closing(sqlite3.connect(uri, uri=True, check_same_thread=False)) as database:
                self._topics(database)
                rows = database.execute(
                    "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
                )
                rows.arraysize = _ROWS
                try:
                    yield from rows
                except sqlite3.Error:
                    if self.cut_at is None:  # else a page is asked for that lies beyond its end
                        raise

    @contextmanager
    def _sound(self) -> Iterator[Path]:
        """The file; of one cut short its whole pages: SQLite opens none that lacks a page."""
        with self.path.open("rb") as file:
            page, pages = struct.unpack_from(">16xH10xI", file.read(32))
        page = 1 << 16 if page == 1 else page
        whole = self.path.stat().st_size // page
        if whole >= pages:
            yield self.path
            return
        self.cut_at = whole * page
        with TemporaryDirectory() as folder:
            part = Path(copyfile(self.path, Path(folder, self.path.name)))
            with part.open("r+b") as copy:
                copy.truncate(self.cut_at)
                copy.seek(28)  # where the head states how many pages there are
                copy.write(struct.pack(">I", whole))
            yield part

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
        ros1.ReaderError, AssertionError, KeyError, IndexError, TypeError, RuntimeError,
        UnicodeDecodeError, struct.error, zlib.error, EOFError, OSError,
    )  # fmt: skip

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages in the order of their times; of a bag cut short, as they stand."""
        self._library = ros1.Reader(self.path)
        try:
            self._library.open()
        except ros1.ReaderError as error:
            if not any(word in str(error).lower() for word in ("index", "header")):
                raise
            yield from self._without_index()
        else:
            with closing(self._library):
                for one in self._library.connections:
                    self._connect(one)
                for connection, time, data in self._library.messages():
                    yield connection.id, time, bytes(data)

    def _connect(self, one: Connection) -> None:
        self.define(one.id, one.topic, "ros1", one.msgtype, ("ros1msg", one.msgdef.data.encode()))

    def _without_index(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages of a bag that lacks the index at its end, as far as it is whole."""
        none = True
        with self.path.open("rb") as file:
            file.seek(len(self.mark))
            for one in self._walked(file, self.path.stat().st_size):
                none = False
                yield one
            self.cut_at = file.tell()
        if none:
            what = f"the file was cut short at byte {self.cut_at}, before its first message"
            raise DataError(what, hint=AGAIN)

    def _walked(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
        """Go from record to record; ends where the first one begins that is not whole.

        A chunk without compression is gone into, whole or not. http://wiki.ros.org/Bags/Format/2.0
        """
        while True:
            start = file.tell()
            try:
                header = ros1.Header.read(file)
                length = ros1.read_uint32(file)
            except ros1.ReaderError as error:
                if file.tell() < size:
                    raise ValueError(f"the record at byte {start} cannot be read") from error
                break
            kind = header.get_uint8("op") if header else 0  # what was never written is zero
            packing = header.get_string("compression") if kind == ros1.RecordType.CHUNK else ""
            if packing == "none":
                continue
            if not kind or length > size - file.tell() or (packing and not length):
                break
            data = file.read(length)
            if packing:
                chunk = BytesIO(ros1.decompressors[packing](data))
                yield from self._walked(chunk, len(chunk.getbuffer()))
                if chunk.read(1):
                    raise ValueError(f"the chunk at byte {start} is damaged")
            elif kind == ros1.RecordType.MSGDATA:
                yield header.get_uint32("conn"), header.get_time("time"), data
            elif kind == ros1.RecordType.CONNECTION:
                file.seek(start)
                self._library.bio = file
                self._connect(self._library.read_connection())
        file.seek(start)
