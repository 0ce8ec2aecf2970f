"""MCAP: its records in file order, checksums and counts checked, and where the messages are.

Read front to back, so that a recording without summary, index or chunks reads to the same messages
as one that has them. A file without its mark at the end, zeros behind it aside, was cut short: what
is whole of it is read.
Records and fields that are not known are passed over. https://mcap.dev/spec

The library's own stream makes a tuple of each entry of a message index, which takes it longer than
all that is done here.
"""

from __future__ import annotations

import io
import sys
import zlib
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import BinaryIO, Final

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Schema, Statistics

from tdfscal.errors import DataError
from tdfscal.logs.log_file import AGAIN, LIBRARY_FAULTS, reason
from tdfscal.logs.messages.buffer import MESSAGE_HEAD, RECORD, Messages, gather
from tdfscal.logs.messages.recording import Recording
from tdfscal.records import IntArray

MAX_CHUNK: Final = 256 << 20
"""Largest chunk, in bytes when decompressed, that is read."""
_MAGIC: Final = b"\x89MCAP0\r\n"
_LOOSE_BYTES: Final = 4 << 20
_MAX_RECORD: Final = 1 << 30
_PIECE: Final = 1 << 20
_SECTOR: Final = 512  # bytes, the least that is laid out in advance
_READ: Final = frozenset(
    {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX}
    | {Opcode.STATISTICS, Opcode.DATA_END, Opcode.FOOTER}
)
_HINT: Final = "copy the recording again"

Define = Callable[[int, bytes], None]


class _CutShortError(Exception):
    """The file ends within the record at hand."""


class McapFile(Recording):
    """One MCAP file."""

    form, mark, kind = "mcap", _MAGIC, "MCAP file"
    _start = 0  # of the record at hand
    _crc = (0, 0)  # before the record at hand, and after it
    _covered = False  # by the checksum of the data
    _counted = False  # by statistics

    def stored(self) -> Iterator[Messages]:
        """Yield the messages chunk by chunk, in file order."""
        self.checked, self._loose = True, bytearray()
        with self.path.open("rb") as file:
            self._size = _written(file, self.path.stat().st_size)
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
                    what = f"the file was cut short at byte {self._size}, before its first message"
                    raise DataError(what, hint=AGAIN) from None
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
            else:
                self._take(opcode, content)
            if opcode != Opcode.MESSAGE or len(self._loose) >= _LOOSE_BYTES:
                yield from self._flushed()
            self.position = file.tell()
        self._start = file.tell()
        if self._start + len(_MAGIC) > self._size:
            raise _CutShortError
        if self._start + len(_MAGIC) < self._size:
            raise DataError(f"bytes follow the end of the recording at byte {self._start}")
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
            # What was never written is zero, however little of it there is.
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
        """Take in what is no message: definitions, counts, checksums of data and summary."""
        with self._placed("a record is damaged", self._start):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(opcode, content)
            elif opcode == Opcode.STATISTICS:
                self._counted = True
                stated = Statistics.read(_stream(content))
                by_channel = {c: n for c, n in stated.channel_message_counts.items() if n}
                there = self.counts.total()
                if there != stated.message_count or by_channel not in ({}, self.counts):
                    what = f"{there} messages are there where the statistics state "
                    raise ValueError(f"{what}{stated.message_count}")
            elif opcode == Opcode.DATA_END:
                crc = DataEnd.read(_stream(content)).data_section_crc
                self._covered = crc != 0
                if crc not in (0, self._crc[0]):
                    raise ValueError("the checksum of the data section does not match")
                self._crc = (0, 0)  # the summary's own begins
            elif opcode == Opcode.FOOTER:
                covered = RECORD.pack(opcode, len(content)) + content[:16]
                if Footer.read(_stream(content)).summary_crc not in (
                    0, zlib.crc32(covered, self._crc[0]),
                ):  # fmt: skip
                    raise ValueError("the checksum of the summary does not match")

    def _unpacked(self, start: int, content: bytes, index: list[bytes]) -> Iterator[Messages]:
        with self._placed("a chunk is damaged", start):
            chunk = Chunk.read(_stream(content))
            data = decompressed(chunk)
            self.checked &= chunk.uncompressed_crc != 0
            messages = messages_of(data, index_offsets(index), self._define)
        yield messages

    def _flushed(self) -> Iterator[Messages]:
        if self._loose:
            data = bytes(self._loose)
            self._loose.clear()
            with self._placed("a message before it is damaged", self._start):
                messages = messages_of(data, index_offsets(()), self._define)
            yield messages

    def _define(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel; one that comes again must say the same."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(content))
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise ValueError(f"schema {schema.id} is defined twice, differently")
        else:
            channel = Channel.read(_stream(content))
            if self.channels.setdefault(channel.id, channel) != channel:
                raise ValueError(f"channel {channel.id} is defined twice, differently")

    @contextmanager
    def _placed(self, what: str, start: int) -> Iterator[None]:
        """Turn what a damaged record raises into a DataError with its place."""
        try:
            yield
        except (McapError, *LIBRARY_FAULTS) as error:
            said = f"{what} ({reason(error)}) at byte {start}"
            raise DataError(said, hint=_HINT) from error


def _written(file: BinaryIO, size: int) -> int:
    """Return how many bytes of a file were written: one laid out in advance is zero from there on.

    The last record of a recorder that crashed is then as long as it says, and zero in its end.
    """
    end, step = size, _SECTOR
    while end:
        begin = max(end - step, 0)
        file.seek(begin)
        if written := file.read(end - begin).rstrip(b"\0"):
            return size if end == size else begin + len(written)
        end, step = begin, _PIECE
    return size


class _Exact(io.BytesIO):
    """Bytes that never come short."""

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size if size is None else min(size, sys.maxsize))
        if size is not None and len(data) < size:
            raise ValueError("a record is shorter than it states")
        return data


def _stream(content: bytes) -> ReadDataStream:
    """A record's content for the record classes of `mcap`."""
    return ReadDataStream(_Exact(content))


def decompressed(chunk: Chunk) -> bytes:
    """Return a chunk's records: never more bytes than it states, and its checksum checked.

    Raises ValueError where it is too large, damaged, or compressed in a way that is not known.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise ValueError(f"it states {size} bytes, more than {MAX_CHUNK >> 20} MiB")
    try:
        match chunk.compression:
            case "":
                data = chunk.data
            case "zstd":
                # The library allocates what the frame states: look before it does.
                stated = zstandard.get_frame_parameters(chunk.data).content_size
                if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                    raise ValueError("its sizes contradict each other")
                data = zstandard.ZstdDecompressor().decompress(chunk.data, size) if size else b""
            case "lz4":
                expander = lz4.frame.LZ4FrameDecompressor()
                data = bytes(expander.decompress(chunk.data, max_length=size + 1))
            case _:
                raise ValueError(f"its compression {chunk.compression!r} is not known")
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(f"its {chunk.compression} content cannot be expanded") from error
    if len(data) != size:
        raise ValueError(f"it states {size} bytes and holds {len(data)}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum does not match")
    return data


def index_offsets(records: Sequence[bytes]) -> IntArray:
    """Return the offsets that a chunk's message indexes give, ascending.

    A record is: channel u16, length u32 in bytes, then (time u64, offset u64) each.
    """
    parts = [np.empty(0, dtype=np.int64)]
    for content in records:
        length = int.from_bytes(content[2:6], "little")
        if length > len(content) - 6 or length % 16:
            raise ValueError("a message index does not add up")
        parts.append(np.frombuffer(content, dtype="<i8", offset=6, count=length // 8)[1::2])
    return np.sort(np.concatenate(parts), kind="stable")


def messages_of(data: bytes, indexed: IntArray, define: Define) -> Messages:
    """Find every message in a buffer of records.

    The index only saves walking: the records are walked unless the messages that it names tile the
    buffer, so that the same messages are found whether it is whole, partial or missing.

    indexed : offsets of messages, ascending. define : takes the schemas and channels met, as
    (opcode, content).

    Raises ValueError where the records do not tile the buffer.
    """
    offset = indexed if _tile(data, indexed) else _walked(data, define)
    length = gather(data, offset + 1, "<u8").astype(np.int64) - MESSAGE_HEAD
    if (length < 0).any():
        raise ValueError("a message is shorter than its head")
    channel = gather(data, offset + RECORD.size, "<u2").astype(np.int64)
    return Messages(data, offset, length, channel)


def _tile(data: bytes, offset: IntArray) -> bool:
    """Whether there are messages at these offsets, from the begin of the buffer to its end."""
    if not offset.size or offset[0] != 0 or offset[-1] > len(data) - RECORD.size:
        return False
    length = gather(data, offset + 1, "<u8")
    if int(length.max()) > len(data):
        return False
    ends = offset + RECORD.size + length.astype(np.int64)
    joined = ends[-1] == len(data) and (ends[:-1] == offset[1:]).all()
    return bool(joined and (gather(data, offset, "u1") == int(Opcode.MESSAGE)).all())


def _walked(data: bytes, define: Define) -> IntArray:
    """Go from record to record: where messages are; hand on schemas and channels."""
    unpack, head, message = RECORD.unpack_from, RECORD.size, int(Opcode.MESSAGE)
    start, stop, messages = 0, len(data), array("q")
    while start < stop:
        if start + head > stop:
            raise ValueError("a record is cut short")
        opcode, length = unpack(data, start)
        end = start + head + length
        if end > stop:
            raise ValueError("a record is cut short")
        if opcode == message:
            messages.append(start)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            define(opcode, data[start + head : end])
        start = end
    return np.array(messages, dtype=np.int64)
