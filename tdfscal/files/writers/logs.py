"""A log as a file: CSV as a machine's recorder writes it, Parquet, and a ROS 2 recording.

Messages are CDR with a header, made many at once, in zstd chunks.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import BCS_FRAME, FloatArray, IntArray, Log, Series, sensor_frame

if TYPE_CHECKING:
    from mcap.writer import Writer

WRENCH, POINT = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"
EPOCH = 1_750_000_000
"""Header stamp of time 0, s: a recording carries dates, but bytes must follow from the seed."""
LATENCY_NS = 400_000
"""From a message's stamp to its arrival at the recorder."""
_MM = 1000.0


def write_csv(path: Path, log: Log) -> dict[str, Any]:
    """Positions in mm, forces in N, time in s; shortest decimals that read back as they are.

    Returns the rig file's `log` block. Raises UsageError where the signals do not share one clock.
    """
    supports = {
        name: {
            "position": [f"NCP{i}_ActPos{a}" for a in "XYZ"],
            "force": [f"TDFS{i}_F{a}" for a in "xyz"],
        }
        for i, name in enumerate(log.supports, 1)
    }
    names = [field for fields in supports.values() for three in fields.values() for field in three]
    columns = _columns(log, np.tile([_MM] * 3 + [1.0] * 3, len(log.supports)))
    names = ["t_s", *names, *["T_hall_degC"] * len(log.temperature)]
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(",".join(names) + "\n")
        rows = np.column_stack(columns).tolist()
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
    units = {"length_unit": "mm", "force_unit": "N", "force_on": "terminal"}
    time = {"time": {"field": "t_s", "unit": "s"}}
    return {**_rows(log), **time, **units, **_warm(log, "T_hall_degC"), "supports": supports}


def write_parquet(path: Path, log: Log) -> dict[str, Any]:
    """SI units and default names (`time`, `<name>.x` … `<name>.fz`), page checksums on.

    Returns the rig file's `log` block: empty where the defaults say it all. Raises UsageError
    where the signals do not share one clock.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    from tdfscal.files.arrow import as_arrow

    members = ("x", "y", "z", "fx", "fy", "fz")
    names = ["time", *(f"{support}.{member}" for support in log.supports for member in members)]
    names += ["temperature"] * len(log.temperature)
    table = pa.table(dict(zip(names, map(as_arrow, _columns(log)), strict=True)))
    pq.write_table(table, path, compression="zstd", write_page_checksum=True)
    return {**_rows(log), **_warm(log, "temperature")}


def write_mcap(path: Path, log: Log) -> dict[str, Any]:
    """Topics `/ncpN/position` (m), `/tdfsN/wrench` (N), N from 1, and `/hall/temperature` (°C).

    Messages come in order of time, in the frames of the exports. Returns the rig file's `log`
    block that reads them.
    """
    topics: list[tuple[str, str, str, int, Series]] = []
    signals = zip(log.supports, log.position, log.force, strict=True)
    for i, (name, position, force) in enumerate(signals, 1):
        topics.append((f"/tdfs{i}/wrench", sensor_frame(name), WRENCH, 6, force))
        topics.append((f"/ncp{i}/position", BCS_FRAME, POINT, 3, position))
    for series in log.temperature:
        warmth = Series(series.time, series.value[:, :1])
        topics.append(("/hall/temperature", "hall", TEMPERATURE, 2, warmth))
    with recorder(path, "tdfscal") as writer:
        kinds = dict.fromkeys(kind for _, _, kind, _, _ in topics)
        schema = {kind: writer.register_schema(kind, "ros2msg", definition(kind)) for kind in kinds}
        channels = [writer.register_channel(t, "cdr", schema[kind]) for t, _, kind, _, _ in topics]
        streams = [_messages(series, frame, size) for _, frame, _, size, series in topics]
        stamp = np.concatenate([stamps for stamps, _ in streams])
        source = np.repeat(np.arange(len(streams)), [len(s) for s, _ in streams])
        sequence = np.concatenate([np.arange(len(s)) for s, _ in streams])
        order = np.lexsort((source, stamp))
        columns = (column[order].tolist() for column in (stamp, source, sequence))
        for at, s, q in zip(*columns, strict=True):
            data = streams[s][1][q]
            writer.add_message(channels[s], at + LATENCY_NS, data, publish_time=at, sequence=q)
    supports = {
        name: {"position": f"/ncp{i}/position.point", "force": f"/tdfs{i}/wrench.wrench.force"}
        for i, name in enumerate(log.supports, 1)
    }
    units = {"length_unit": "m", "force_unit": "N", "force_on": "terminal"}
    warm = _warm(log, "/hall/temperature.temperature")
    return {**_rows(log), "time": {"source": "header"}, **units, **warm, "supports": supports}


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


def _messages(series: Series, frame: str, doubles: int) -> tuple[IntArray, list[bytes]]:
    """Stamps in ns and CDR messages: the values, then zeros up to `doubles` doubles."""
    stamp = EPOCH * 1_000_000_000 + np.rint(series.time * 1e9).astype(np.int64)
    value = np.zeros((len(stamp), doubles))
    value[:, : series.value.shape[1]] = series.value
    return stamp, stamped(stamp, frame, value)


def _columns(log: Log, scale: FloatArray | float = 1.0) -> list[FloatArray]:
    """Time, the signals of each support times a scale, and temperatures, (N,) each."""
    time = log.position[0].time
    for series in (*log.position, *log.force, *log.temperature):
        if not np.array_equal(series.time, time):
            raise UsageError(
                "signals of different rates do not fit into one table",
                hint="write MCAP, or simulate with one rate",
            )
    pairs = zip(log.position, log.force, strict=True)
    signals = np.hstack([series.value for pair in pairs for series in pair]) * scale
    return [time, *signals.T, *(series.value[:, 0] for series in log.temperature)]


def _rows(log: Log) -> dict[str, str]:
    return {"rows": "postures"} if log.rows == "postures" else {}


def _warm(log: Log, field: str) -> dict[str, str]:
    return {"temperature": field} if log.temperature else {}
