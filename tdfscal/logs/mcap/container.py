"""The MCAP container: its records in file order, checksums and counts checked.

Read front to back, so that a recording without summary, index or chunks reads to the same
messages as one that has them. A file without its mark at the end was cut short: what is whole of
it is read. Records and fields that are not known are passed over. https://mcap.dev/spec
"""

from __future__ import annotations

import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import BinaryIO, ClassVar, Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, DataEnd, Schema, Statistics

from tdfscal.errors import DataError
from tdfscal.logs.common.contents import Format
from tdfscal.logs.common.damage import LIBRARY_FAULTS, reason
from tdfscal.logs.mcap.chunk import decompressed, index_offsets, messages_of, record_stream
from tdfscal.logs.messages.buffer import RECORD, Messages, Recording

_MAGIC: Final = b"\x89MCAP0\r\n"
_LOOSE_BYTES: Final = 4 << 20
_MAX_RECORD: Final = 1 << 30
_PIECE: Final = 1 << 20
_READ: Final = frozenset(
    {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX}
    | {Opcode.STATISTICS, Opcode.DATA_END, Opcode.FOOTER}
)
_COMPRESSED: Final = {b"\x1f\x8b": "gzip", b"\x28\xb5\x2f\xfd": "zstd"}
_HINT: Final = "copy the recording again"


class _CutShortError(Exception):
    """The file ends within the record at hand."""


@dataclass(slots=True)
class Container(Recording):
    """One MCAP file while it is read."""

    form: ClassVar[Format] = "mcap"
    checked: bool = True
    _size: int = 0
    _start: int = 0
    _crc: tuple[int, int] = (0, 0)  # before the record at hand, and after it
    _loose: bytearray = field(default_factory=bytearray)
    _covered: bool = False  # by the checksum of the data
    _counted: bool = False  # by statistics

    def announced(self) -> frozenset[str] | None:
        """Return the topics of the summary, where it is whole; what is wrong the reading says."""
        try:
            with self.path.open("rb") as file:
                summary = make_reader(file).get_summary()
        except (OSError, McapError, *LIBRARY_FAULTS):
            return None
        stated = summary.statistics.channel_count if summary and summary.statistics else 0
        if summary is None or len(summary.channels) != stated:
            return None
        return frozenset(channel.topic for channel in summary.channels.values()) or None

    def messages(self) -> Generator[Messages, None, None]:
        """Yield the messages chunk by chunk, in file order."""
        self._size = self.path.stat().st_size
        with self.path.open("rb") as file:
            self._check_opening(file)
            file.seek(max(self._size - len(_MAGIC), 0))
            ended = file.read() == _MAGIC
            file.seek(len(_MAGIC))
            self._crc = (0, zlib.crc32(_MAGIC))
            try:
                yield from self._in_order(file)
            except _CutShortError:
                yield from self._flushed()
                if ended:
                    what = f"the record at byte {self._start} runs beyond the file's end"
                    raise DataError(what, hint=_HINT) from None
                if not self.counts:
                    what = f"the file ends at byte {self._size}, before its first message"
                    raise DataError(what, hint=_HINT) from None
                self.cut_at = self._start

    def _in_order(self, file: BinaryIO) -> Iterator[Messages]:
        chunk: tuple[int, bytes] | None = None
        index: list[bytes] = []
        opcode = 0
        while opcode != Opcode.FOOTER:
            try:
                opcode, content = self._record(file)
            except _CutShortError:
                if chunk is not None:
                    yield from self._unpacked(*chunk, index)
                raise
            if opcode == Opcode.MESSAGE_INDEX:
                index.append(content)
                continue
            if chunk is not None:
                yield from self._unpacked(*chunk, index)
                chunk = None
            if opcode == Opcode.CHUNK:
                chunk, index = (self._start, content), []
            if opcode == Opcode.MESSAGE:
                self._loose += RECORD.pack(opcode, len(content)) + content
                self.checked = False
            elif opcode != Opcode.FOOTER:
                self._take(opcode, content)
            if opcode != Opcode.MESSAGE or len(self._loose) >= _LOOSE_BYTES:
                yield from self._flushed()
            self.reached = file.tell()
        if file.tell() + len(_MAGIC) != self._size:
            raise DataError(f"bytes follow the end of the recording at byte {file.tell()}")
        self.checked = self._covered or (self.checked and self._counted)

    def _record(self, file: BinaryIO) -> tuple[int, bytes]:
        """Return the next record that is read here; raises _CutShortError where there is none."""
        while True:
            self._start = file.tell()
            before = self._crc[1]
            head = file.read(RECORD.size)
            if len(head) < RECORD.size:
                raise _CutShortError
            opcode, length = RECORD.unpack(head)
            # A file whose end was never written is zero from there on.
            if not opcode or length > self._size - file.tell():
                raise _CutShortError
            crc = zlib.crc32(head, before)
            if opcode in _READ:
                if length > _MAX_RECORD:
                    what = f"the record at byte {self._start} has {length} bytes"
                    raise DataError(what, hint="record in chunks")
                content = file.read(length)
                self._crc = before, zlib.crc32(content, crc)
                return opcode, content
            while length:
                piece = file.read(min(length, _PIECE))
                crc, length = zlib.crc32(piece, crc), length - len(piece)
            self._crc = before, crc

    def _take(self, opcode: int, content: bytes) -> None:
        """Take in what is no message: definitions, counts, the checksum of the data."""
        with self._placed("a record is damaged"):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content)
            elif opcode == Opcode.STATISTICS:
                self._check_counts(Statistics.read(record_stream(content)))
            elif opcode == Opcode.DATA_END:
                stated = DataEnd.read(record_stream(content)).data_section_crc
                self._covered = stated != 0
                if stated not in (0, self._crc[0]):
                    raise ValueError("the checksum of the data section does not match")

    def _unpacked(self, start: int, content: bytes, index: list[bytes]) -> Iterator[Messages]:
        self._start, here = start, self._start
        with self._placed("a chunk is damaged"):
            chunk = Chunk.read(record_stream(content))
            data = decompressed(chunk)
            self.checked &= chunk.uncompressed_crc != 0
            messages = messages_of(data, index_offsets(index), self._define)
            self._start = here
        yield self._noted(messages)

    def _flushed(self) -> Iterator[Messages]:
        if self._loose:
            data = bytes(self._loose)
            self._loose.clear()
            with self._placed("a message before it is damaged"):
                messages = messages_of(data, None, self._define)
            yield self._noted(messages)

    def _noted(self, messages: Messages) -> Messages:
        present = messages.counts()
        if not present.keys() <= self.channels.keys():
            raise DataError("messages belong to a channel that is not defined", hint=_HINT)
        for channel, count in present.items():
            self.counts[channel] = self.counts.get(channel, 0) + count
        return messages

    def _define(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel; one that comes again must say the same."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(record_stream(content))
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise ValueError(f"schema {schema.id} is defined twice, differently")
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(record_stream(content))
            if self.channels.setdefault(channel.id, channel) != channel:
                raise ValueError(f"channel {channel.id} is defined twice, differently")

    def _check_counts(self, statistics: Statistics) -> None:
        self._counted = True
        by_channel = {c: n for c, n in statistics.channel_message_counts.items() if n}
        found, stated = sum(self.counts.values()), statistics.message_count
        if found != stated or by_channel not in ({}, self.counts):
            raise ValueError(f"{found} messages are there where the statistics state {stated}")

    def _check_opening(self, file: BinaryIO) -> None:
        head = file.read(len(_MAGIC))
        for magic, kind in _COMPRESSED.items():
            if head.startswith(magic):
                raise DataError(
                    f"the file is compressed with {kind}: MCAP is read as it was recorded",
                    hint="decompress it first, with `gunzip` or `zstd -d`",
                )
        if head != _MAGIC:
            raise DataError("the file lacks its mark at its start: this is no MCAP file")

    @contextmanager
    def _placed(self, what: str) -> Iterator[None]:
        """Turn what a damaged record raises into a DataError with its place."""
        try:
            yield
        except (McapError, *LIBRARY_FAULTS) as error:
            said = f"{what} ({reason(error)}) at byte {self._start}"
            raise DataError(said, hint=_HINT) from error
