"""The MCAP container: its records in file order, every length and checksum checked.

Read front to back, so that a recording without summary, index or chunks reads to the same
messages as one that has them. https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import ClassVar, Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Schema, Statistics

from tdfscal.errors import DataError
from tdfscal.logs.common.contents import Format
from tdfscal.logs.common.damage import one_line
from tdfscal.logs.mcap.chunk import (
    decompressed,
    exact,
    index_offsets,
    messages_of,
)
from tdfscal.logs.mcap.record_stream import (
    HEAD,
    HINT,
    IN_SUMMARY,
    RecordStream,
    Summary,
    TruncatedError,
    read_summary,
    summary_crc,
)
from tdfscal.logs.messages.buffer import Messages, Recording

_ALWAYS: Final = 1 << 30
_MAX_EXPANSION: Final = 1000  # beyond that
_LOOSE_BYTES: Final = 4 << 20
_IN_DATA: Final = frozenset(
    {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX}
    | {Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END}
)
_DAMAGE: Final = (ValueError, McapError, struct.error)


@dataclass(slots=True)
class Container(Recording):
    """One MCAP file while it is read."""

    form: ClassVar[Format] = "mcap"
    checked: bool = True
    _chunks: list[tuple[int, int]] = field(default_factory=list)
    _expanded: int = 0
    _summary: Summary | None = None
    _loose: bool = False

    def announced(self) -> frozenset[str] | None:
        """Return the topics of the summary, where it is whole."""
        summary = read_summary(self.path)
        topics = frozenset(channel.topic for channel in summary.channels.values())
        return topics if summary.complete else None

    def messages(self) -> Generator[Messages, None, None]:
        """Yield the messages chunk by chunk, in file order."""
        with self.path.open("rb") as file:
            stream = RecordStream(file, self.path)
            stream.opening()
            try:
                stream.record(frozenset({Opcode.HEADER}))
                data_crc = yield from self._data_section(stream)
                with self._noting("the summary is damaged", stream.position):
                    self._summary_section(stream, data_crc)
            except TruncatedError as error:
                if not self.salvage:
                    raise
                self.lost.append(f"{error.what}; what follows is lost")

    def _data_section(self, stream: RecordStream) -> Generator[Messages, None, int]:
        loose = bytearray()
        pending: tuple[int, bytes] | None = None
        offsets: list[bytes] = []
        while True:
            self.reached = stream.position
            try:
                opcode, content = stream.record(_IN_DATA)
            except TruncatedError:
                # What is already read is sound and comes before what is not.
                if pending is not None:
                    yield from self._chunk(*pending, offsets)
                yield from self._flush(loose)
                raise
            start = stream.start
            if opcode == Opcode.MESSAGE_INDEX:
                if pending is None:
                    self._fault("a message index follows no chunk", start)
                offsets.append(content)
                continue
            if pending is not None:
                yield from self._chunk(*pending, offsets)
                pending, offsets = None, []
            if opcode == Opcode.MESSAGE:
                self._loose = True
                loose += HEAD.pack(opcode, len(content)) + content
                if len(loose) >= _LOOSE_BYTES:
                    yield from self._flush(loose)
                continue
            yield from self._flush(loose)
            if opcode == Opcode.CHUNK:
                self._chunks.append((start, stream.position - start))
                pending = (start, content)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                with self._noting("a schema or channel is damaged", start):
                    self._define(opcode, content)
            elif opcode == Opcode.DATA_END:
                stated = 0
                with self._noting("the end of the data section is damaged", start):
                    stated = DataEnd.read(exact(content)).data_section_crc
                if stated not in (0, stream.crc_before):
                    self._fault("the checksum of the data section does not match", start)
                return int(stated)

    def _chunk(self, start: int, content: bytes, index: list[bytes]) -> Iterator[Messages]:
        with self._noting("a chunk is damaged", start):
            chunk = Chunk.read(exact(content))
            data = decompressed(chunk)
            self._expanded += len(data)
            if self._expanded > _ALWAYS + _MAX_EXPANSION * (start + len(content)):
                raise ValueError(f"the chunks so far hold {self._expanded} bytes, too many")
            if chunk.uncompressed_crc == 0:
                self.checked = False
            messages = messages_of(data, index_offsets(index), self._define, stored=len(content))
            yield self._counted(messages)

    def _flush(self, loose: bytearray) -> Iterator[Messages]:
        if loose:
            data = bytes(loose)
            loose.clear()
            with self._noting("a message is damaged"):
                yield self._counted(messages_of(data, None, self._define))

    def _counted(self, messages: Messages) -> Messages:
        present = messages.counts()
        if self.salvage:
            self._recall(present)
        if not present.keys() <= self.channels.keys():
            self._fault("messages belong to a channel that is not defined")
        for channel, count in present.items():
            self.counts[channel] = self.counts.get(channel, 0) + count
        return messages

    def _recall(self, present: Iterable[int]) -> None:
        """Take from the summary what defines these channels and is lost in its place."""
        lacking = [number for number in present if not self._defined(number)]
        if not lacking:
            return
        if self._summary is None:
            self._summary = read_summary(self.path)
        schemas, channels, _, sound = self._summary
        if not sound:
            return
        recalled: list[str] = []
        for number in (n for n in lacking if n in channels):
            channel = self.channels.setdefault(number, channels[number])
            if channel.schema_id in schemas:
                self.schemas.setdefault(channel.schema_id, schemas[channel.schema_id])
            if self._defined(number):
                recalled.append(channel.topic)
        if recalled:
            topics = ", ".join(sorted(recalled))
            self.lost.append(f"the definition of {topics} is taken from the summary")

    def _defined(self, number: int) -> bool:
        channel = self.channels.get(number)
        return channel is not None and channel.schema_id in (0, *self.schemas)

    def _define(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel; one that comes again must say the same."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(exact(content))
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise ValueError(f"schema {schema.id} is defined twice, differently")
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(exact(content))
            if self.channels.setdefault(channel.id, channel) != channel:
                raise ValueError(f"channel {channel.id} is defined twice, differently")

    def _summary_section(self, stream: RecordStream, data_crc: int) -> None:
        start = stream.position
        stream.crc = 0
        statistics: Statistics | None = None
        indexed: list[tuple[int, int]] = []
        offsets_start = 0
        while True:
            opcode, content = stream.record(IN_SUMMARY)
            here = stream.start
            if opcode == Opcode.FOOTER:
                break
            if opcode == Opcode.STATISTICS:
                statistics = Statistics.read(exact(content))
            elif opcode == Opcode.CHUNK_INDEX:
                index = ChunkIndex.read(exact(content))
                indexed.append((index.chunk_start_offset, index.chunk_length))
            elif opcode == Opcode.SUMMARY_OFFSET:
                offsets_start = offsets_start or here
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content)
        footer = Footer.read(exact(content))
        self._check_footer(footer, start, here, offsets_start, stream.crc_before, content)
        stream.closing()
        if not stream.at_end():
            self._fault("bytes follow the end of the recording", stream.position)
        if indexed and sorted(indexed) != self._chunks:
            self._fault("the chunk index does not match the chunks", start)
        if statistics is not None:
            self._check_counts(statistics)
        if data_crc:
            self.checked = True
        elif self._loose or statistics is None:
            self.checked = False

    def _check_footer(
        self, footer: Footer, start: int, end: int, offsets: int, crc: int, content: bytes
    ) -> None:
        # Without a summary its place is zero, though offsets may follow.
        stated = footer.summary_start if footer.summary_start else offsets or end
        if stated != start or footer.summary_offset_start not in (0, offsets, end):
            self._fault("the footer points to the wrong place", end)
        if footer.summary_crc not in (0, summary_crc(crc, content)):
            self._fault("the checksum of the summary does not match", end)

    def _check_counts(self, statistics: Statistics) -> None:
        by_channel = {c: n for c, n in statistics.channel_message_counts.items() if n}
        found, stated = sum(self.counts.values()), statistics.message_count
        if found != stated or by_channel not in ({}, self.counts):
            self._fault(f"{found} messages are there where the statistics state {stated}")

    @contextmanager
    def _noting(self, what: str, position: int | None = None) -> Iterator[None]:
        """Turn what a damaged record raises into a fault."""
        try:
            yield
        except _DAMAGE as error:
            self._fault(f"{what} ({one_line(error)})", position)

    def _fault(self, what: str, position: int | None = None) -> None:
        said = what if position is None else f"{what} at byte {position}"
        if not self.salvage:
            raise DataError(said, hint=HINT)
        if said not in self.lost:
            self.lost.append(said)
