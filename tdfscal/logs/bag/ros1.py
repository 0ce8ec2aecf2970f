"""ROS 1 bags, read by rosbags; their messages are decoded by our own reader."""

from __future__ import annotations

import bz2
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import lz4.frame
from rosbags.rosbag1 import Reader, ReaderError

from tdfscal.errors import DataError
from tdfscal.logs.bag.stored import Stored
from tdfscal.logs.mcap.chunk import MAX_CHUNK


class Ros1Recording(Stored):
    """A `.bag` file while it is read."""

    opening = (b"#ROSBAG V2.0\n", "ROS 1 bag")
    damage = (
        ReaderError, AssertionError, KeyError, IndexError, TypeError, RuntimeError,
        UnicodeDecodeError, struct.error, zlib.error, EOFError, OSError,
    )  # fmt: skip

    def rows(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the messages in the order of their times."""
        try:
            reader = Reader(self.path)
            reader.open()
        except self.damage as error:
            if "index" not in str(error).lower():
                raise
            raise DataError(
                f"the bag was not closed ({error})", hint="write its index with `rosbag reindex`"
            ) from error
        with closing(reader):
            # rosbags expands a chunk whole, to whatever it expands to.
            for at, chunk in reader.chunks.items():
                reader.chunks[at] = chunk._replace(decompressor=_bounded(chunk.decompressor))
            for one in reader.connections:
                text = one.msgdef.data.encode()
                self.define(one.id, one.topic, "ros1", one.msgtype, ("ros1msg", text))
            for connection, time, data in reader.messages():
                yield connection.id, time, bytes(data)


def _bounded(decompress: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    """The same decompressor, which refuses what expands to more than a chunk may hold."""
    makers: dict[object, Callable[[], Any]] = {
        bz2.decompress: bz2.BZ2Decompressor,
        lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor,
    }
    make = makers.get(decompress)
    if make is None:
        return decompress

    def expand(data: bytes) -> bytes:
        stream = make()
        whole: bytes = stream.decompress(data, max_length=MAX_CHUNK)
        if not stream.eof:
            more = stream.decompress(b"", max_length=1)
            what = f"expands to more than {MAX_CHUNK >> 20} MiB" if more else "is cut short"
            raise ValueError(f"a chunk {what}")
        return whole

    return expand
