"""Contact wrenches as a growing table or recording: CSV, Parquet, MCAP; whole or not at all.

The recording is WrenchStamped in CDR, for Foxglove, PlotJuggler and bags.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files import WRENCH_WRITER
from tdfscal.files.outputs import check_suffix, replacing
from tdfscal.files.writers.logs import WRENCH, definition, recorder, stamped
from tdfscal.records import LCS_FRAME, FloatArray
from tdfscal.wrench.contact_wrench import COMPONENTS, Wrenches

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
_LAST = float(2**31)
Append = Callable[[Wrenches], None]


def write_wrenches(
    path: Path,
    pieces: Iterable[Wrenches],
    about: Mapping[str, str],
    frame: str = LCS_FRAME,
) -> int:
    """Write the pieces as they come and return the number of rows.

    about : what the values are, kept in the metadata of Parquet and MCAP. frame : of the messages
    in MCAP. A standard uncertainty that is not known is null (CSV: empty, MCAP: NaN).

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

    from tdfscal.files.arrow import as_arrow

    schema = pa.schema([(name, pa.float64()) for name in COLUMNS], metadata=dict(about))
    writer: Any
    if text:
        writer = csv.CSVWriter(beside, schema, write_options=csv.WriteOptions(quoting_style="none"))
    else:
        compact = {"compression": "zstd", "use_dictionary": False, "write_statistics": False}
        writer = parquet.ParquetWriter(beside, schema, write_page_checksum=True, **compact)

    def append(piece: Wrenches) -> None:
        arrays = [as_arrow(v, ~np.isfinite(v)) for v in columns_of(piece).values()]
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


def read_recording(path: Path) -> dict[str, FloatArray]:
    """Read columns by their names in a table from what `recording` wrote."""
    from mcap.reader import make_reader

    columns: dict[str, FloatArray] = {}
    messages: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            messages[channel.topic].append(message.data)
    for topic, prefix in TOPICS.items():
        size = len(messages[topic][0])
        layout: Any = {
            "names": ["sec", "nanosec", "wrench"],
            "formats": ["<i4", "<u4", "6<f8"],
            "offsets": [4, 8, size - 48],
            "itemsize": size,
        }
        rows: Any = np.frombuffer(b"".join(messages[topic]), np.dtype(layout))
        columns["time"] = rows["sec"] + rows["nanosec"] * 1e-9
        columns |= {f"{prefix}{c}": rows["wrench"][:, k] for k, c in enumerate(COMPONENTS)}
    return columns
