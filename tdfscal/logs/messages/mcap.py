"""MCAP: its records in file order, checksums and counts checked, and where the messages are.

Read front to back, so that a recording without summary, index or chunks reads to the same messages
as one that has them. A file without its mark at the end, zeros behind it aside, was cut short: what
is whole of it is read. Records and fields that are not known are passed over. https://mcap.dev/spec

The library's own stream makes objects of each message and of each entry of a message index, which
takes it longer than all that is done here.
"""

from __future__ import annotations

import io
import sys
import zlib
from array import array
from collections.abc import Callable, Iterator
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

MAX_CHUNK: Final = 256 << 20
"""Largest chunk, in bytes when decompressed, that is read."""
_MAGIC: Final = b"\x89MCAP0\r\n"
_LOOSE_BYTES: Final = 4 << 20
_PIECE: Final = 1 << 20
_SECTOR: Final = 512  # bytes, the least that is laid out in advance
_READ: Final = frozenset(
    {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK}
    | {Opcode.STATISTICS, Opcode.DATA_END, Opcode.FOOTER}
)
_HINT: Final = "copy the recording again"


class McapFile(Recording):
    """One MCAP file."""

    form, mark, kind = "mcap", _MAGIC, "MCAP file"
    _start = 0  # of the record at hand
    _before = 0  # checksum of the section before that record
    _covered = False  # by the checksum of the data
    _counted = False  # by statistics

    def stored(self) -> Iterator[Messages]:
        """Yield the messages chunk by chunk, in file order."""
        self.checked, loose = True, bytearray()
        with self.path.open("rb") as file:
            size = _written(file, self.path.stat().st_size)
            file.seek(max(size - len(_MAGIC), 0))
            ended = file.read() == _MAGIC
            file.seek(len(_MAGIC))
            try:
                for opcode, content in self._records(file, size):
                    if opcode == Opcode.MESSAGE:
                        loose += RECORD.pack(opcode, len(content)) + content
                        self.checked = False
                    if loose and (opcode != Opcode.MESSAGE or len(loose) >= _LOOSE_BYTES):
                        yield self._found(loose)
                        loose = bytearray()
                    if opcode == Opcode.CHUNK:
                        with self._placed("a chunk is damaged"):
                            messages = self._unpacked(content)
                        yield messages
                    elif opcode != Opcode.MESSAGE:
                        with self._placed("a record is damaged"):
                            self._take(opcode, content)
            except EOFError:
                if loose:
                    yield self._found(loose)
                if ended:
                    what = f"the record at byte {self._start} runs beyond the file's end"
                    raise DataError(what, hint=_HINT) from None
                if not self.counts:
                    what = f"the file was cut short at byte {size}, before its first message"
                    raise DataError(what, hint=AGAIN) from None
                self.cut_at = self._start

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
        """Yield the records that are read here, to the footer.

        size : bytes of the file that were written. Raises EOFError where a record is not whole,
        DataError for bytes behind the end.
        """
        opcode, crc = 0, zlib.crc32(_MAGIC)
        while opcode != Opcode.FOOTER:
            self._start, self._before = file.tell(), crc
            head = file.read(RECORD.size)
            opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
            # What was never written is zero, however little of it there is.
            if not opcode or length > size - file.tell():
                raise EOFError
            content = file.read(length) if opcode in _READ else b""
            crc, left = zlib.crc32(content, zlib.crc32(head, crc)), length - len(content)
            while left:
                piece = file.read(min(left, _PIECE))
                crc, left = zlib.crc32(piece, crc), left - len(piece)
            if opcode in _READ:
                yield opcode, content
            if opcode == Opcode.DATA_END:
                crc = 0  # the summary's own begins
        self._start = file.tell()
        if self._start + len(_MAGIC) > size:
            raise EOFError
        if self._start + len(_MAGIC) < size:
            raise DataError(f"bytes follow the end of the recording at byte {self._start}")
        self.checked = self._covered or (self.checked and self._counted)

    def _take(self, opcode: int, content: bytes) -> None:
        """Take in what is no message: definitions, counts, checksums of data and summary."""
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
            if crc not in (0, self._before):
                raise ValueError("the checksum of the data section does not match")
        elif opcode == Opcode.FOOTER:
            covered = RECORD.pack(opcode, len(content)) + content[:16]
            crc = Footer.read(_stream(content)).summary_crc
            if crc not in (0, zlib.crc32(covered, self._before)):
                raise ValueError("the checksum of the summary does not match")

    def _unpacked(self, content: bytes) -> Messages:
        chunk = Chunk.read(_stream(content))
        self.checked &= chunk.uncompressed_crc != 0
        return messages_of(decompressed(chunk), self._define)

    def _found(self, loose: bytearray) -> Messages:
        with self._placed("a message before it is damaged"):
            return messages_of(bytes(loose), self._define)

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
    def _placed(self, what: str) -> Iterator[None]:
        """Turn what a damaged record raises into a DataError with its place."""
        try:
            yield
        except (McapError, *LIBRARY_FAULTS) as error:
            said = f"{what} ({reason(error)}) at byte {self._start}"
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


def messages_of(data: bytes, define: Callable[[int, bytes], None]) -> Messages:
    """Find every message in a buffer of records, going from one to the next.

    define : takes the schemas and channels met, as (opcode, content).

    Raises ValueError where the records do not fill the buffer.
    """
    unpack, head, message = RECORD.unpack_from, RECORD.size, int(Opcode.MESSAGE)
    start, last, found = 0, len(data) - RECORD.size, array("q")
    while start <= last:
        opcode, length = unpack(data, start)
        if opcode == message:
            found.append(start)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            define(opcode, data[start + head : start + head + length])
        start += head + length
    if start != len(data):
        raise ValueError("a record is cut short")
    offset = np.array(found, dtype=np.int64)
    length = gather(data, offset + 1, "<u8").astype(np.int64) - MESSAGE_HEAD
    if (length < 0).any():
        raise ValueError("a message is shorter than its head")
    channel = gather(data, offset + head, "<u2").astype(np.int64)
    return Messages(data, offset, length, channel)
