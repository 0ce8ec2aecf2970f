"""ROS 1 bags, read by rosbags; their messages are decoded by our own reader."""

from __future__ import annotations

import bz2
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any, Final

import lz4.frame
from rosbags.rosbag1 import Reader, ReaderError

from tdfscal.errors import DataError
from tdfscal.logs.bag.packing import Stored
from tdfscal.logs.mcap.chunk import MAX_CHUNK
from tdfscal.logs.messages.buffer import Messages

_OPENING: Final = b"#ROSBAG V2.0\n"
_DAMAGE: Final = (
    ReaderError, AssertionError, KeyError, IndexError, TypeError, RuntimeError, UnicodeDecodeError,
    struct.error, zlib.error, EOFError, OSError,
)  # fmt: skip


class Ros1Recording(Stored):
    """A `.bag` file while it is read."""

    def messages(self) -> Iterator[Messages]:
        """Yield the messages in the order of their times."""
        with self.path.open("rb") as file:
            if file.read(len(_OPENING)) != _OPENING:
                raise DataError("the file is no ROS 1 bag", where=str(self.path),
                                hint="copy the recording again")  # fmt: skip
        try:
            reader = Reader(self.path)
            reader.open()
            with closing(reader):
                # rosbags expands a chunk whole, to whatever it expands to.
                for at, chunk in reader.chunks.items():
                    bounded = chunk._replace(decompressor=_bounded(chunk.decompressor))
                    reader.chunks[at] = bounded
                for one in reader.connections:
                    text = one.msgdef.data.encode()
                    self.define(one.id, one.topic, "ros1", one.msgtype, ("ros1msg", text))
                rows = reader.messages()
                yield from self.packed((one.id, time, bytes(data)) for one, time, data in rows)
        except _DAMAGE as error:
            if "index" in str(error).lower() and not self.counts:
                raise DataError(
                    f"the bag was not closed ({error})",
                    where=str(self.path),
                    hint="write its index with `rosbag reindex`",
                ) from error
            if not self.salvage or not self.counts:
                raise ValueError(str(error) or type(error).__name__) from error
            self.lost.append(f"the file is damaged ({error}); what follows is lost")


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
            raise ReaderError(f"a chunk {what}")
        return whole

    return expand
