"""ROS 2 messages with a header as CDR, many at once, and the recording that they stand in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.records import FloatArray, IntArray

if TYPE_CHECKING:
    from mcap.writer import Writer

WRENCH, POINT = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"


def definition(name: str) -> bytes:
    """Return a message type's definition with those that it refers to, as a bag stores it."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    return store.generate_msgdef(name, ros_version=2)[0].encode()


@contextmanager
def recorder(path: Path, library: str) -> Iterator[Writer]:
    """A recording to be written; library : names the writer in its first record."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library=library)
        yield writer
        writer.finish()  # type: ignore[no-untyped-call]


def stamped(stamp: IntArray, frame: str, value: FloatArray) -> list[bytes]:
    """Serialise (N,) stamps in ns, a frame, and (N, k) doubles: k is 2, 3 or 6."""
    text = frame.encode() + b"\0"
    fill = -(12 + len(text)) % 8  # doubles lie at multiples of 8 behind the encapsulation
    layout = np.dtype(
        [
            ("encapsulation", "S4"),
            ("sec", "<i4"),
            ("nanosec", "<u4"),
            ("length", "<u4"),
            ("frame", f"S{len(text) + fill}"),
            ("value", "<f8", (value.shape[1],)),
        ]
    )
    records: np.ndarray[Any, Any] = np.zeros(len(stamp), layout)
    records["encapsulation"] = b"\x00\x01\x00\x00"  # CDR, little endian
    records["sec"] = stamp // 1_000_000_000
    records["nanosec"] = stamp % 1_000_000_000
    records["length"] = len(text)
    records["frame"] = text
    records["value"] = value
    whole, step = records.tobytes(), layout.itemsize
    return [whole[i : i + step] for i in range(0, len(whole), step)]
