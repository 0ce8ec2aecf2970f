"""A log as a file: CSV as a machine's recorder writes it, Parquet, and a ROS 2 recording.

Messages are CDR with a header, made many at once, in zstd chunks.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tdfscal.errors import DataError, UsageError
from tdfscal.files import WRENCH_WRITER
from tdfscal.files.outputs import check_suffix, replacing
from tdfscal.files.saving import as_arrow
from tdfscal.records import BCS_FRAME, LCS_FRAME, FloatArray, IntArray, Log, Series, sensor_frame
from tdfscal.wrench.contact_wrench import COMPONENTS, Wrenches

if TYPE_CHECKING:
    from mcap.writer import Writer


WRENCH, POINT = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PointStamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"
EPOCH = 1_750_000_000
"""Header stamp of time 0, s: a recording carries dates, but bytes must follow from the seed."""
LATENCY_NS = 400_000
"""From a message's stamp to its arrival at the recorder."""
LogFormat = Literal["csv", "parquet", "mcap"]
#: Names of the fields of position, force and temperature; i counts the supports from 1.
_NAMES: dict[LogFormat, tuple[str, str, str]] = {
    "csv": ("NCP{i}_ActPos{A}", "TDFS{i}_F{a}", "T_hall_degC"),
    "parquet": ("{name}.{a}", "{name}.f{a}", "temperature"),
    "mcap": (
        "/ncp{i}/position.point",
        "/tdfs{i}/wrench.wrench.force",
        "/hall/temperature.temperature",
    ),
}


def write_log(path: Path, log: Log, form: LogFormat) -> dict[str, Any]:
    """Write a log; return the rig file's `log` block that reads it, but for what defaults say.

    CSV: positions in mm, forces in N, time in s; shortest decimals that read back as they are.
    Parquet: SI units and default names (`time`, `<name>.x` … `<name>.fz`), page checksums on.
    MCAP: topics `/ncpN/position` (m), `/tdfsN/wrench` (N), N from 1, and `/hall/temperature` (°C).

    Raises UsageError where the signals of a table do not share one clock.
    """
    position, force, warm = _NAMES[form]
    supports = {
        name: {"position": _each(position, i, name), "force": _each(force, i, name)}
        for i, name in enumerate(log.supports, 1)
    }
    text, stamps = form == "csv", {"field": "t_s", "unit": "s"}
    if form == "mcap":
        _write_messages(path, log)
        stamps = {"source": "header"}
    else:
        fields = (f for s in supports.values() for three in s.values() for f in three)
        names = ["t_s" if text else "time", *fields, *[warm] * len(log.temperature)]
        _write_table(path, names, _columns(log, 1e3 if text else 1.0), text=text)
    block: dict[str, Any] = {"rows": "postures"} if log.rows == "postures" else {}
    temperature = {"temperature": warm} if log.temperature else {}
    if form == "parquet":
        return block | temperature
    units = {"length_unit": "mm" if text else "m", "force_unit": "N", "force_on": "terminal"}
    return {**block, "time": stamps, **units, **temperature, "supports": supports}


def _each(pattern: str, number: int, name: str) -> list[str] | str:
    """Fields of x, y, z by the pattern of their names; one, where that is for all three."""
    three = [pattern.format(i=number, name=name, a=a, A=a.upper()) for a in "xyz"]
    return three if "{a}" in pattern.lower() else three[0]


def _write_table(
    path: Path, names: Sequence[str], columns: Sequence[FloatArray], *, text: bool
) -> None:
    if text:
        with path.open("w", encoding="ascii", newline="\n") as file:
            file.write(",".join(names) + "\n")
            rows = np.column_stack(columns).tolist()
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
        return
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(dict(zip(names, map(as_arrow, columns), strict=True)))
    pq.write_table(table, path, compression="zstd", write_page_checksum=True)


def _write_messages(path: Path, log: Log) -> None:
    """Write a recording whose messages come in order of time, in the frames of the exports."""
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
        streams = list[tuple[IntArray, list[bytes]]]()
        for _, frame, _, size, series in topics:  # the values, then zeros up to so many doubles
            stamps = EPOCH * 1_000_000_000 + np.rint(series.time * 1e9).astype(np.int64)
            value = np.zeros((len(stamps), size))
            value[:, : series.value.shape[1]] = series.value
            streams.append((stamps, stamped(stamps, frame, value)))
        stamp = np.concatenate([stamps for stamps, _ in streams])
        source = np.repeat(np.arange(len(streams)), [len(s) for s, _ in streams])
        sequence = np.concatenate([np.arange(len(s)) for s, _ in streams])
        order = np.lexsort((source, stamp))
        columns = (column[order].tolist() for column in (stamp, source, sequence))
        for at, s, q in zip(*columns, strict=True):
            data = streams[s][1][q]
            writer.add_message(channels[s], at + LATENCY_NS, data, publish_time=at, sequence=q)


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


def _columns(log: Log, length: float) -> list[FloatArray]:
    """Time, position times a scale and force of each support, and temperatures, (N,) each."""
    time = log.position[0].time
    for series in (*log.position, *log.force, *log.temperature):
        if not np.array_equal(series.time, time):
            raise UsageError(
                "signals of different rates do not fit into one table",
                hint="write MCAP, or simulate with one rate",
            )
    pairs = zip(log.position, log.force, strict=True)
    signals = [part for x, f in pairs for part in (length * x.value.T, f.value.T)]
    return [time, *np.vstack(signals), *(series.value[:, 0] for series in log.temperature)]


SUFFIXES = (".csv", ".parquet", ".mcap")
COLUMNS = (
    "time",
    *COMPONENTS,
    *(f"u_{name}" for name in COMPONENTS),
    *(f"u_cal_{name}" for name in COMPONENTS),
    *(f"raw_{name}" for name in COMPONENTS),
)
"""time in s; the contact wrench, its standard uncertainties with the sample's noise and by the
calibration alone, the uncalibrated wrench; N, N·m."""

TOPICS = {
    "/contact_wrench": "",
    "/contact_wrench/std": "u_",
    "/contact_wrench/calibration_std": "u_cal_",
    "/contact_wrench/uncalibrated": "raw_",
}
"""Topic → prefix of the same columns in a table."""
STATUS = "calibration_status"
"""Key of the gate's verdict on the calibration."""
_LAST = float(2**31)
Append = Callable[[Wrenches], None]


def write_wrenches(
    path: Path, pieces: Iterable[Wrenches], about: Mapping[str, str], frame: str = LCS_FRAME
) -> int:
    """Write the pieces as they come and return the number of rows.

    about : what the values are, kept in the metadata of Parquet and MCAP; CSV has a column
    `calibration_status` where that is not `accepted`. frame : of the messages in MCAP. A standard
    uncertainty that is not known is null (CSV: empty, MCAP: NaN).

    Raises UsageError where the file cannot be written and DataError where a wrench is no number;
    what the pieces raise passes through. Then no file appears.
    """
    check_suffix(path, SUFFIXES)
    rows = 0
    text, mcap = path.suffix.lower() == ".csv", path.suffix.lower() == ".mcap"
    with replacing(path) as beside:
        sink = recording(beside, about, frame) if mcap else _table(beside, about, text=text)
        with sink as append:
            for piece in numbers_only(pieces):
                append(piece)
                rows += piece.time.size
    return rows


def numbers_only(pieces: Iterable[Wrenches]) -> Iterator[Wrenches]:
    """Pass pieces on. Raises DataError at the first wrench that is no number."""
    for piece in pieces:
        bad = ~np.isfinite(piece.value.sum(axis=1) + piece.raw.sum(axis=1))
        if bad.any():
            raise DataError(
                f"the contact wrench at {piece.time[int(np.argmax(bad))]:.9g} s is no number",
                where="log",
                hint="check the positions and forces there, and the units of the log block in "
                "rig.yaml",
            )
        yield piece


def columns_of(piece: Wrenches) -> dict[str, FloatArray]:
    """Return the columns of a piece by their names; an unknown uncertainty is NaN."""
    stds = piece.std, piece.calibration_std
    own, common = (np.where(np.isfinite(std), std, np.nan) for std in stds)
    values = [piece.time, *piece.value.T, *own.T, *common.T, *piece.raw.T]
    return dict(zip(COLUMNS, values, strict=True))


@contextmanager
def _table(beside: Path, about: Mapping[str, str], *, text: bool) -> Iterator[Append]:
    """A CSV or Parquet file that grows piece by piece."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    fields, told = [(name, pa.float64()) for name in COLUMNS], dict[str, str]()
    if text and (status := about.get(STATUS, "accepted")) != "accepted":
        told, fields = {STATUS: status}, [*fields, (STATUS, pa.string())]
    schema = pa.schema(fields, metadata=dict(about))
    writer: Any
    if text:
        writer = csv.CSVWriter(beside, schema, write_options=csv.WriteOptions(quoting_style="none"))
    else:
        compact = {"compression": "zstd", "use_dictionary": False, "write_statistics": False}
        writer = parquet.ParquetWriter(beside, schema, write_page_checksum=True, **compact)

    def append(piece: Wrenches) -> None:
        arrays = [as_arrow(v, ~np.isfinite(v)) for v in columns_of(piece).values()]
        arrays += [pa.array([said] * len(piece.time)) for said in told.values()]
        writer.write_table(pa.table(arrays, schema=schema))

    with writer:
        yield append


@contextmanager
def recording(path: Path, about: Mapping[str, str], frame: str) -> Iterator[Append]:
    """An MCAP file that grows piece by piece; frame : frame_id of the messages.

    A piece of which a time has no place in a ROS stamp raises DataError.
    """
    with recorder(path, WRENCH_WRITER) as writer:
        schema = writer.register_schema(WRENCH, "ros2msg", definition(WRENCH))
        # rosbag2 asks for the profiles; empty stands for its defaults.
        qos = {"offered_qos_profiles": ""}
        channels = [writer.register_channel(t, "cdr", schema, metadata=qos) for t in TOPICS]
        writer.add_metadata("tdfscal", dict(about))
        sequence = itertools.count()

        def append(piece: Wrenches) -> None:
            if not (piece.time[0] >= 0 and piece.time[-1] < _LAST):
                raise DataError(
                    f"the times run from {piece.time[0]:.9g} s to {piece.time[-1]:.9g} s, and a "
                    "recording's from 0 to 2038",
                    where="log",
                    hint="write .csv or .parquet instead, or correct the recorder's clock",
                )
            stamp = np.rint(piece.time * 1e9).astype(np.int64)
            streams = [
                stamped(stamp, frame, np.where(np.isfinite(v), v, np.nan))
                for v in (piece.value, piece.std, piece.calibration_std, piece.raw)
            ]
            for at, k, *messages in zip(stamp.tolist(), sequence, *streams, strict=False):
                for channel, data in zip(channels, messages, strict=True):
                    writer.add_message(channel, at, data=data, publish_time=at, sequence=k)

        yield append
