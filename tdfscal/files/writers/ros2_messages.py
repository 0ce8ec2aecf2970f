"""ROS 2 messages with a header as CDR, many at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.records import FloatArray, IntArray

WRENCH, POINT = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"


def definition(name: str) -> bytes:
    """Return a message type's definition with those that it refers to, as a bag stores it."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    return store.generate_msgdef(name, ros_version=2)[0].encode()


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
