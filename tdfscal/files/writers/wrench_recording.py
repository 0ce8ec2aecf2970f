"""Contact wrenches as a ROS 2 recording: WrenchStamped in CDR, for Foxglove, PlotJuggler, bags."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.writers.ros2_messages import WRENCH, definition, stamped
from tdfscal.records import FloatArray
from tdfscal.wrench.contact_wrench import COMPONENTS
from tdfscal.wrench.stream import WrenchPiece

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
