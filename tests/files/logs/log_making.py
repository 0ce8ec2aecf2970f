"""Campaigns of random numbers, written in every format by libraries other than tdfscal's reader."""

import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from tdfscal.files.rig.recorders import LogBlock
from tdfscal.records import FloatArray, Log

SUPPORTS = ("ncp1", "ncp2", "ncp3")
STORE = get_typestore(Stores.ROS2_HUMBLE)


def topics(force: str, **stated: Any) -> LogBlock:
    """Each support's position and force in topics of its own; force : the path in its message."""
    paths = {s: {"position": f"/{s}/position.point", "force": f"/{s}/{force}"} for s in SUPPORTS}
    return LogBlock.model_validate({"supports": paths} | stated)


LOG_TIME = topics("wrench.wrench.force")
MAPPING = topics("wrench.wrench.force", time={"source": "header"})
JSON_MAPPING = topics("wrench.force")


@dataclass(frozen=True)
class Truth:
    """Positions at one rate and forces at four times that, m and N."""

    time: FloatArray
    position: FloatArray
    force_time: FloatArray
    force: FloatArray


def make_truth(
    samples: int = 60, seed: int = 1, start_ns: int = 1_750_000_000_000_000_000
) -> Truth:
    rng = np.random.default_rng(seed)
    stamps = start_ns + np.arange(samples) * 20_000_000
    force_stamps = start_ns + np.arange(4 * samples) * 5_000_000
    return Truth(
        stamps / 1e9,
        rng.normal(size=(len(SUPPORTS), samples, 3)),
        force_stamps / 1e9,
        rng.normal(size=(len(SUPPORTS), 4 * samples, 3)) * 1e3,
    )


def table(truth: Truth) -> pd.DataFrame:
    """One rate, default names."""
    columns: dict[str, Any] = {"time": truth.time}
    for i, name in enumerate(SUPPORTS):
        for axis, letter in enumerate("xyz"):
            columns[f"{name}.{letter}"] = truth.position[i][:, axis]
        for axis, letter in enumerate("xyz"):
            columns[f"{name}.f{letter}"] = truth.force[i][::4, axis]
    return pd.DataFrame(columns)


def _stamp(seconds: float) -> Any:
    sec = int(seconds)
    return STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=round((seconds - sec) * 1e9))


def _header(seconds: float, frame: str) -> Any:
    return STORE.types["std_msgs/msg/Header"](stamp=_stamp(seconds), frame_id=frame)


def point_stamped(seconds: float, xyz: Sequence[float], frame: str = "base") -> bytes:
    point = STORE.types["geometry_msgs/msg/Point"](x=xyz[0], y=xyz[1], z=xyz[2])
    kind = "geometry_msgs/msg/PointStamped"
    return bytes(STORE.serialize_cdr(STORE.types[kind](_header(seconds, frame), point), kind))


def wrench_stamped(
    seconds: float, xyz: Sequence[float], frame: str = "tdfs", *, little_endian: bool = True
) -> bytes:
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    wrench = STORE.types["geometry_msgs/msg/Wrench"](vector(*xyz), vector(7.0, 8.0, 9.0))
    kind = "geometry_msgs/msg/WrenchStamped"
    message = STORE.types[kind](_header(seconds, frame), wrench)
    return bytes(STORE.serialize_cdr(message, kind, little_endian=little_endian))


def definition(kind: str) -> bytes:
    text, _ = STORE.generate_msgdef(kind, ros_version=2)
    return text.encode()


def mcap_bytes(
    truth: Truth,
    *,
    encoding: str = "cdr",
    frames: Sequence[str] = ("tdfs",),
    summary: bool = True,
    **how: Any,
) -> bytes:
    """All streams by log time; frames: the forces' frame_id, in turn; how: of mcap's writer."""
    target = io.BytesIO()
    parts = ("use_statistics", "use_summary_offsets", "repeat_channels", "repeat_schemas")
    usual: dict[str, Any] = {"chunk_size": 4096, "compression": CompressionType.ZSTD}
    writer = Writer(target, **(usual | dict.fromkeys(parts, summary) | how))
    writer.start(profile="ros2", library="tests")
    writer.add_attachment(1, 2, "photo", "application/octet-stream", b"\1\2\3")
    writer.add_metadata("notes", {"key": "value"})
    channels: dict[str, int] = {}
    for k, (seconds, topic, kind, cdr) in enumerate(events(truth, frames)):
        if topic not in channels:
            schema = ("ros2msg", definition(kind)) if encoding == "cdr" else ("jsonschema", b"{}")
            channels[topic] = writer.register_channel(
                topic, encoding, writer.register_schema(kind, *schema)
            )
        data = cdr
        if encoding == "json":
            message: Any = STORE.deserialize_cdr(cdr, kind)
            point = "Point" in kind
            three = message.point if point else message.wrench.force
            numbers = {axis: getattr(three, axis) for axis in "xyz"}
            data = json.dumps({"point" if point else "force": numbers, "k": k}).encode()
        ns = round(seconds * 1e6) * 1000
        writer.add_message(channels[topic], ns, data, ns, k)
    writer.finish()  # type: ignore[no-untyped-call]
    return target.getvalue()


def small_mcap(
    channels: dict[str, tuple[str, str, bytes]], messages: list[tuple[str, int, bytes]]
) -> bytes:
    """Topic → (encoding, type, schema); messages as (topic, ns, data), published 5 ns earlier."""
    target = io.BytesIO()
    writer = Writer(target)
    writer.start()
    ids = {}
    for topic, (encoding, kind, schema) in channels.items():
        schema_encoding = "jsonschema" if encoding == "json" else "ros2msg"
        ids[topic] = writer.register_channel(
            topic, encoding, writer.register_schema(kind, schema_encoding, schema)
        )
    for topic, ns, data in messages:
        writer.add_message(ids[topic], ns, data, ns - 5)
    writer.finish()  # type: ignore[no-untyped-call]
    return target.getvalue()


def ros(kind: str) -> tuple[str, str, bytes]:
    return "cdr", kind, definition(kind)


#: Topics of a position and of a force.
STAMPED = {
    "/p": ros("geometry_msgs/msg/PointStamped"),
    "/f": ros("geometry_msgs/msg/WrenchStamped"),
}


def events(
    truth: Truth, frames: Sequence[str] = ("tdfs", "sensor", "s")
) -> Iterator[tuple[float, str, str, bytes]]:
    """Time, topic, type and CDR of each message; strings move what follows them."""
    point, wrench = "geometry_msgs/msg/PointStamped", "geometry_msgs/msg/WrenchStamped"
    found = []
    for i, name in enumerate(SUPPORTS):
        for t, xyz in zip(truth.time, truth.position[i], strict=True):
            found.append((t, f"/{name}/position", point, point_stamped(t, xyz)))
        for k, (t, xyz) in enumerate(zip(truth.force_time, truth.force[i], strict=True)):
            data = wrench_stamped(t, xyz, frames[k % len(frames)])
            found.append((t, f"/{name}/wrench", wrench, data))
    yield from sorted(found, key=lambda event: event[0])


def rosbag2(
    folder: Path,
    truth: Truth,
    storage: StoragePlugin,
    version: Literal[8, 9] = 9,
    *,
    compressed: bool = False,
) -> Path:
    """A recording by rosbags."""
    bag = BagWriter(folder, version=version, storage_plugin=storage)
    if compressed:
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with bag:
        known: dict[str, Any] = {}
        for t, topic, kind, data in events(truth):
            if topic not in known:
                known[topic] = bag.add_connection(topic, kind, typestore=STORE)
            bag.write(known[topic], round(t * 1e6) * 1000, data)
    return folder


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def same_numbers(log: Log, other: Log) -> bool:
    """Equal to the bit, in every stream."""
    return all(
        np.array_equal(a.time, b.time) and np.array_equal(a.value, b.value)
        for a, b in zip((*log.position, *log.force), (*other.position, *other.force), strict=True)
    )


def assert_holds(log: Log, truth: Truth) -> None:
    """The log holds the truth's numbers to the bit, the times to a float64's resolution."""
    for i in range(len(SUPPORTS)):
        np.testing.assert_array_equal(log.position[i].value, truth.position[i])
        np.testing.assert_array_equal(log.force[i].value, truth.force[i])
        np.testing.assert_allclose(log.position[i].time, truth.time, rtol=3e-16, atol=0)
        np.testing.assert_allclose(log.force[i].time, truth.force_time, rtol=3e-16, atol=0)
