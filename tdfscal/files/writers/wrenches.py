"""Contact wrenches as a growing table or recording: CSV, Parquet, MCAP; whole or not at all.

The recording is WrenchStamped in CDR, for Foxglove, PlotJuggler and bags.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from tdfscal.errors import DataError, UsageError
from tdfscal.files.output_places import check_suffix
from tdfscal.files.outputs import replacing
from tdfscal.files.writers.ros2_messages import WRENCH, definition, stamped
from tdfscal.records import FloatArray
from tdfscal.wrench.contact_wrench import COMPONENTS
from tdfscal.wrench.stream import WrenchPiece

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

LIBRARY = "tdfscal contact wrench"
"""Names the writer in the file's first record; by it the file is known as a result."""
TOPICS = {
    "/contact_wrench": "",
    "/contact_wrench/std": "u_",
    "/contact_wrench/calibration_std": "u_cal_",
    "/contact_wrench/uncalibrated": "raw_",
}
"""Topic → prefix of the same columns in a table."""
_LAST = float(2**31)


def write_wrenches(
    path: Path,
    pieces: Iterable[WrenchPiece],
    about: Mapping[str, str],
    watch: Callable[[WrenchPiece], None] = lambda piece: None,
    frame: str = "lcs",
) -> int:
    """Write the pieces as they come and return the number of rows.

    about : what the values are, kept in the metadata of Parquet and MCAP. watch : sees each piece
    after it was written. frame : of the messages in MCAP. A standard
    uncertainty that is not known is null (CSV: empty, MCAP: NaN).

    Raises UsageError where the file cannot be written and DataError where a wrench is no number;
    what the pieces raise passes through. Then no file appears.
    """
    check_suffix(path, SUFFIXES)
    rows = 0
    with replacing(path) as beside:
        try:
            with _sink(path, beside, about, frame) as sink:
                for piece in numbers_only(pieces):
                    sink.write(piece)
                    rows += piece.time.size
                    watch(piece)
        except OSError as fault:
            raise UsageError(
                f"cannot be written: {fault.strerror or fault}",
                where=str(path),
                hint="check that there is room",
            ) from fault
    return rows


def numbers_only(pieces: Iterable[WrenchPiece]) -> Iterator[WrenchPiece]:
    """Pass pieces on. Raises DataError at the first wrench that is no number."""
    for piece in pieces:
        bad = ~np.isfinite(piece.wrench.value.sum(axis=1) + piece.wrench.raw.sum(axis=1))
        if bad.any():
            raise DataError(
                f"the contact wrench at {piece.time[int(np.argmax(bad))]:.9g} s is no number",
                where="log",
                hint="check the positions and forces there, and the units of the log block in "
                "rig.yaml",
            )
        yield piece


def columns_of(piece: WrenchPiece) -> dict[str, FloatArray]:
    """Return the columns of a piece by their names; an unknown uncertainty is NaN."""
    w = piece.wrench
    own, common = (np.where(np.isfinite(s), s, np.nan) for s in (w.std, w.calibration_std))
    values = [piece.time, *w.value.T, *own.T, *common.T, *w.raw.T]
    return dict(zip(COLUMNS, values, strict=True))


class _TableFile:
    """A CSV or Parquet file that grows piece by piece."""

    def __init__(self, beside: Path, about: Mapping[str, str], *, text: bool) -> None:
        import pyarrow as pa
        from pyarrow import csv, parquet

        self._schema = pa.schema([(name, pa.float64()) for name in COLUMNS], metadata=dict(about))
        self._writer: Any
        if text:
            plain = csv.WriteOptions(quoting_style="none")
            self._writer = csv.CSVWriter(beside, self._schema, write_options=plain)
        else:
            self._writer = parquet.ParquetWriter(
                beside,
                self._schema,
                compression="zstd",
                use_dictionary=False,
                write_statistics=False,
                write_page_checksum=True,
            )

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(self, *failure: object) -> None:
        self._writer.__exit__(*failure)

    def write(self, piece: WrenchPiece) -> None:
        """Append a piece."""
        import pyarrow as pa

        from tdfscal.files.arrow import as_arrow

        columns = columns_of(piece).values()
        arrays = [as_arrow(v, _unknown(v)) for v in columns]
        self._writer.write_table(pa.table(arrays, schema=self._schema))


class WrenchRecording:
    """An MCAP file that grows piece by piece; frame : frame_id of the messages."""

    def __init__(self, path: Path, about: Mapping[str, str], frame: str) -> None:
        from mcap.writer import CompressionType, Writer

        self._file = path.open("wb")
        self._frame, self._sequence = frame, 0
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=LIBRARY)
        schema = self._writer.register_schema(WRENCH, "ros2msg", definition(WRENCH))
        # rosbag2 asks for the profiles; empty stands for its defaults.
        qos = {"offered_qos_profiles": ""}
        self._channels = [
            self._writer.register_channel(topic, "cdr", schema, metadata=qos) for topic in TOPICS
        ]
        self._writer.add_metadata("tdfscal", dict(about))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        try:
            if kind is None:  # a file that failed goes away
                self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()

    def write(self, piece: WrenchPiece) -> None:
        """Append a piece. Raises DataError where a time has no place in a ROS stamp."""
        if not (piece.time[0] >= 0 and piece.time[-1] < _LAST):
            raise DataError(
                f"the times run from {piece.time[0]:.9g} s to {piece.time[-1]:.9g} s, and a "
                "recording's from 0 to 2038",
                where="log",
                hint="write .csv or .parquet instead, or correct the recorder's clock",
            )
        stamp = np.rint(piece.time * 1e9).astype(np.int64)
        w = piece.wrench
        streams = [
            stamped(stamp, self._frame, np.where(np.isfinite(v), v, np.nan))
            for v in (w.value, w.std, w.calibration_std, w.raw)
        ]
        for k, at in enumerate(stamp.tolist()):
            for channel, messages in zip(self._channels, streams, strict=True):
                self._writer.add_message(
                    channel, at, data=messages[k], publish_time=at, sequence=self._sequence
                )
            self._sequence += 1


def _sink(
    path: Path, beside: Path, about: Mapping[str, str], frame: str
) -> _TableFile | WrenchRecording:
    if path.suffix.lower() == ".mcap":
        return WrenchRecording(beside, about, frame)
    return _TableFile(beside, about, text=path.suffix.lower() == ".csv")


def _unknown(values: FloatArray) -> Any:
    finite = np.isfinite(values)
    return None if finite.all() else ~finite


def read_recording(path: Path) -> dict[str, FloatArray]:
    """Read columns by their names in a table from what `WrenchRecording` wrote."""
    from mcap.reader import make_reader

    columns: dict[str, FloatArray] = {}
    with path.open("rb") as file:
        messages: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}
        for _, channel, message in make_reader(file).iter_messages():
            messages[channel.topic].append(message.data)
    for topic, prefix in TOPICS.items():
        data = np.frombuffer(b"".join(messages[topic]), np.uint8).reshape(len(messages[topic]), -1)
        values = np.ascontiguousarray(data[:, -48:]).view("<f8")
        if not columns:
            stamp: Any = np.ascontiguousarray(data[:, 4:12]).view([("s", "<i4"), ("ns", "<u4")])
            columns["time"] = stamp["s"][:, 0] + stamp["ns"][:, 0] * 1e-9
        columns |= {f"{prefix}{name}": values[:, k] for k, name in enumerate(COMPONENTS)}
    return columns
