"""Chunks of an MCAP file: decompression within stated bounds, and where the messages are.

What follows the fields that are known here is ignored: later versions may add fields to any record.
"""

from __future__ import annotations

import io
import struct
import sys
import zlib
from array import array
from collections.abc import Callable, Sequence
from typing import Final

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk

from tdfscal.logs.messages.buffer import MESSAGE_HEAD, RECORD, Messages, gather
from tdfscal.records import IntArray

MAX_CHUNK: Final = 256 << 20
"""Largest chunk, in bytes when decompressed, that is read."""

Define = Callable[[int, bytes], None]


def decompressed(chunk: Chunk) -> bytes:
    """Return a chunk's records: never more bytes than it states, and its checksum checked.

    Raises ValueError where it is too large, damaged, or compressed in a way that is not known.
    """
    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise ValueError(f"it states {size} bytes, more than {MAX_CHUNK >> 20} MiB")
    data = _decompress(chunk.compression, chunk.data, size)
    if len(data) != size:
        raise ValueError(f"it states {size} bytes and holds {len(data)}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("its checksum does not match")
    return data


def _decompress(compression: str, data: bytes, size: int) -> bytes:
    try:
        if compression == "":
            return data
        if compression == "zstd":
            # The library allocates what the frame states: look before it does.
            stated = zstandard.get_frame_parameters(data).content_size
            if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise ValueError("its sizes contradict each other")
            return zstandard.ZstdDecompressor().decompress(data, size) if size else b""
        if compression == "lz4":
            found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
            return bytes(found)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(f"its {compression} content cannot be expanded") from error
    raise ValueError(f"its compression {compression!r} is not known")


def index_offsets(records: Sequence[bytes]) -> IntArray | None:
    """Return the offsets that a chunk's message indexes give, ascending; None without any.

    A record is: channel u16, length u32 in bytes, then (time u64, offset u64) each.
    """
    parts: list[IntArray] = []
    for content in records:
        _, length = struct.unpack_from("<HI", content)
        if length > len(content) - 6 or length % 16:
            raise ValueError("a message index does not add up")
        pairs = np.frombuffer(content, dtype="<u8", offset=6, count=length // 8).reshape(-1, 2)
        if pairs.size and int(pairs[:, 1].max()) > MAX_CHUNK:
            raise ValueError("a message index points outside its chunk")
        parts.append(pairs[:, 1].astype(np.int64))
    if not parts:
        return None
    return np.sort(np.concatenate(parts), kind="stable")


def messages_of(data: bytes, indexed: IntArray | None, define: Define) -> Messages:
    """Find every message in a buffer of records.

    The index only saves walking: the stretches between the messages that it names are walked,
    so that the messages found tile the buffer whether the index is whole, partial or missing.

    indexed : offsets of messages, ascending, or None. define : takes the schemas and channels met,
    as (opcode, content).

    Raises ValueError where the records do not tile the buffer.
    """
    walked = array("q")
    if indexed is None or indexed.size == 0:
        _walk(data, 0, len(data), walked, define)
        offset = np.array(walked, dtype=np.int64)
    else:
        if not (gather(data, indexed, "u1") == int(Opcode.MESSAGE)).all():
            raise ValueError("a message index points to no message")
        ends = indexed + RECORD.size + _lengths(data, indexed)
        starts = np.concatenate((indexed, [len(data)]))
        before = np.concatenate(([0], ends))
        if (starts < before).any():
            raise ValueError("messages overlap by the message index")
        for k in np.flatnonzero(starts > before):
            _walk(data, int(before[k]), int(starts[k]), walked, define)
        offset = np.sort(np.concatenate((indexed, np.array(walked, dtype=np.int64))))
    length = _lengths(data, offset) - MESSAGE_HEAD
    if (length < 0).any():
        raise ValueError("a message is shorter than its head")
    channel = gather(data, offset + RECORD.size, "<u2").astype(np.int64)
    return Messages(data, offset, length, channel)


def _lengths(data: bytes, offset: IntArray) -> IntArray:
    length = gather(data, offset + 1, "<u8")
    if length.size and int(length.max()) > len(data):
        raise ValueError("a message is longer than its chunk")
    return length.astype(np.int64)


def _walk(data: bytes, start: int, stop: int, messages: array[int], define: Define) -> None:
    """Go from record to record, note messages, hand on schemas and channels."""
    unpack, head, message = RECORD.unpack_from, RECORD.size, int(Opcode.MESSAGE)
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


class _Exact(io.BytesIO):
    """Bytes that never come short."""

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size if size is None else min(size, sys.maxsize))
        if size is not None and len(data) < size:
            raise ValueError("a record is shorter than it states")
        return data


def record_stream(content: bytes) -> ReadDataStream:
    """Wrap a record's content for the record classes of `mcap`."""
    return ReadDataStream(_Exact(content))
