"""Recordings of messages by topic: in one buffer, as the records of an MCAP file have them."""

from __future__ import annotations

import struct
from typing import Any, Final

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import BoolArray, IntArray

RECORD: Final = struct.Struct("<BQ")
"""Kind of a record, and bytes that follow."""
MESSAGE_HEAD: Final = 22
"""Channel, sequence, log time and publish time, in bytes."""
DATA: Final = RECORD.size + MESSAGE_HEAD
"""From the start of a message's record to its data, in bytes."""


@record
class Messages:
    """Messages within a buffer of records, in file order.

    data : the buffer. offset : (N,), where each message's record starts.
    length : (N,), bytes of message data. channel : (N,).
    """

    data: bytes
    offset: IntArray
    length: IntArray
    channel: IntArray

    def of(self, channel: int) -> Messages:
        """Return the messages of one channel."""
        return self.at(self.channel == channel)

    def at(self, k: int | slice | BoolArray) -> Messages:
        """Return message k alone, or those of a slice or mask."""
        some = slice(k, k + 1) if isinstance(k, int) else k
        return Messages(self.data, self.offset[some], self.length[some], self.channel[some])

    def log_time(self) -> IntArray:
        """(N,), ns."""
        return gather(self.data, self.offset + 15, "<u8").astype(np.int64)

    def publish_time(self) -> IntArray:
        """(N,), ns."""
        return gather(self.data, self.offset + 23, "<u8").astype(np.int64)

    def bytes_of(self, k: int) -> bytes:
        """Return the data of message k."""
        start = int(self.offset[k]) + DATA
        return self.data[start : start + int(self.length[k])]

    def counts(self) -> dict[int, int]:
        """Messages by channel."""
        found = np.bincount(self.channel)
        return {int(c): int(found[c]) for c in np.flatnonzero(found)}


def gather(data: bytes, offset: IntArray, dtype: str) -> np.ndarray[Any, Any]:
    """Read one value of `dtype` at each byte offset, aligned or not.

    Raises ValueError for an offset outside the buffer.
    """
    kind = np.dtype(dtype)
    places = len(data) - kind.itemsize + 1
    if offset.size == 0:
        return np.empty(0, dtype=kind)
    if places <= 0 or int(offset.min()) < 0 or int(offset.max()) >= places:
        raise ValueError("an offset lies outside its chunk")
    return np.ndarray((places,), kind, data, 0, (1,))[offset]
