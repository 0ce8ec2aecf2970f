"""rosbag2's storage in SQLite: one file of messages as they were recorded."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from typing import Final
from urllib.parse import quote

from tdfscal.errors import DataError
from tdfscal.logs.bag.stored import Stored

_ROWS: Final = 1024
_MOST_TOPICS: Final = 1 << 16


class SqliteRecording(Stored):
    """A `.db3` file while it is read."""

    opening = (b"SQLite format 3\0", "SQLite database")
    damage = (sqlite3.Error, TypeError)

    def is_cut_short(self) -> bool:
        """By the size and number of pages in its header."""
        with self.path.open("rb") as file:
            head = file.read(32)
        (size,), (pages,) = struct.unpack_from(">H", head, 16), struct.unpack_from(">I", head, 28)
        return bool(self.path.stat().st_size < max(size, 1 << 16 if size == 1 else 0) * pages)

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages in the order of recording."""
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
        texts: dict[str, tuple[str, bytes]] = {}
        # A view may never end; only tables have pages of their own.
        stored = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
        tables = {name for (name,) in database.execute(stored)}
        if not {"topics", "messages"} <= tables:
            raise ValueError("it holds no tables of topics and messages")
        if "message_definitions" in tables:
            for kind, encoding, text in database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ):
                texts[str(kind)] = str(encoding), str(text).encode()
        chosen = "SELECT id, name, type, serialization_format FROM topics"
        for number, (identity, name, kind, encoding) in enumerate(database.execute(chosen)):
            if not isinstance(identity, int) or not 0 <= identity < _MOST_TOPICS:
                raise ValueError(f"topic {number} has the id {identity!r}")
            # Recorders before ROS 2 Iron store no definitions: those of the standard messages.
            self.define(
                identity, str(name), str(encoding), str(kind), texts.get(str(kind), ("ros2", b""))
            )
