"""ROS 2 recordings: messages with a header as CDR, many at once, in zstd chunks; a log as one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.files.writers.table_log import rows_of
from tdfscal.records import FloatArray, IntArray, Log, Series

if TYPE_CHECKING:
    from mcap.writer import Writer

WRENCH, POINT = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"


EPOCH = 1_750_000_000
"""Header stamp of time 0, s: a recording carries dates, but bytes must follow from the seed."""
LATENCY_NS = 400_000
"""From a message's stamp to its arrival at the recorder."""


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


def write_mcap(path: Path, log: Log) -> dict[str, Any]:
    """Topics `/ncpN/position` (m), `/tdfsN/wrench` (N), N from 1, and `/hall/temperature` (°C).

    Messages come in order of time. Returns the rig file's `log` block that reads them.
    """
    topics: list[tuple[str, str, str, int, Series]] = []
    for i, (position, force) in enumerate(zip(log.position, log.force, strict=True), 1):
        topics.append((f"/tdfs{i}/wrench", f"tdfs{i}", WRENCH, 6, force))
        topics.append((f"/ncp{i}/position", "bcs", POINT, 3, position))
    for series in log.temperature:
        warmth = Series(series.time, series.value[:, :1])
        topics.append(("/hall/temperature", "hall", TEMPERATURE, 2, warmth))
    with recorder(path, "tdfscal") as writer:
        kinds = dict.fromkeys(kind for _, _, kind, _, _ in topics)
        schema = {kind: writer.register_schema(kind, "ros2msg", definition(kind)) for kind in kinds}
        channels = [writer.register_channel(t, "cdr", schema[kind]) for t, _, kind, _, _ in topics]
        streams = [_serialise(series, frame, size) for _, frame, _, size, series in topics]
        stamp = np.concatenate([stamps for stamps, _ in streams])
        source = np.repeat(np.arange(len(streams)), [len(s) for s, _ in streams])
        sequence = np.concatenate([np.arange(len(s)) for s, _ in streams])
        order = np.lexsort((source, stamp))
        columns = (column[order].tolist() for column in (stamp, source, sequence))
        for at, s, q in zip(*columns, strict=True):
            data = streams[s][1][q]
            writer.add_message(channels[s], at + LATENCY_NS, data, publish_time=at, sequence=q)
    return {
        **rows_of(log),
        "time": {"source": "header"},
        "length_unit": "m",
        "force_unit": "N",
        "force_on": "terminal",
        **({"temperature": "/hall/temperature.temperature"} if log.temperature else {}),
        "supports": {
            name: {
                "position": f"/ncp{i}/position.point",
                "force": f"/tdfs{i}/wrench.wrench.force",
            }
            for i, name in enumerate(log.supports, 1)
        },
    }


def _serialise(
    series: Series, frame: str, doubles: int
) -> tuple[np.ndarray[Any, Any], list[bytes]]:
    """Stamps in ns and CDR messages: the values, then zeros up to `doubles` doubles."""
    stamp = EPOCH * 1_000_000_000 + np.rint(series.time * 1e9).astype(np.int64)
    value = np.zeros((len(stamp), doubles))
    value[:, : series.value.shape[1]] = series.value
    return stamp, stamped(stamp, frame, value)
