"""A log as a ROS 2 recording: WrenchStamped and PointStamped in CDR, zstd chunks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.writers.ros2_messages import POINT, TEMPERATURE, WRENCH, definition, stamped
from tdfscal.files.writers.table_log import rows_of
from tdfscal.records import Log, Series

EPOCH = 1_750_000_000
"""Header stamp of time 0, s: a recording carries dates, but bytes must follow from the seed."""
LATENCY_NS = 400_000
"""From a message's stamp to its arrival at the recorder."""


def mcap_block(log: Log) -> dict[str, Any]:
    """The rig file's `log` block that reads what `write_mcap` writes."""
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


def write_mcap(path: Path, log: Log) -> None:
    """Topics `/ncpN/position` (m), `/tdfsN/wrench` (N), N from 1, and `/hall/temperature` (°C).

    Messages come in order of time.
    """
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="tdfscal")
        schema = {
            name: writer.register_schema(name, "ros2msg", definition(name))
            for name in (WRENCH, POINT, *([TEMPERATURE] if log.temperature else []))
        }
        channels: list[int] = []
        streams: list[tuple[np.ndarray[Any, Any], list[bytes]]] = []
        for i, (position, force) in enumerate(zip(log.position, log.force, strict=True), 1):
            for topic, frame, name, series in (
                (f"/tdfs{i}/wrench", f"tdfs{i}", WRENCH, force),
                (f"/ncp{i}/position", "bcs", POINT, position),
            ):
                channels.append(writer.register_channel(topic, "cdr", schema[name]))
                streams.append(_serialise(series, frame, 6 if name == WRENCH else 3))
        for series in log.temperature:
            channels.append(
                writer.register_channel("/hall/temperature", "cdr", schema[TEMPERATURE])
            )
            streams.append(_serialise(Series(series.time, series.value[:, :1]), "hall", 2))
        stamp = np.concatenate([stamps for stamps, _ in streams])
        source = np.repeat(np.arange(len(streams)), [len(s) for s, _ in streams])
        sequence = np.concatenate([np.arange(len(s)) for s, _ in streams])
        order = np.lexsort((source, stamp))
        for at, s, q in zip(
            stamp[order].tolist(), source[order].tolist(), sequence[order].tolist(), strict=True
        ):
            writer.add_message(
                channels[s],
                log_time=at + LATENCY_NS,
                publish_time=at,
                data=streams[s][1][q],
                sequence=q,
            )
        writer.finish()  # type: ignore[no-untyped-call]


def _serialise(
    series: Series, frame: str, doubles: int
) -> tuple[np.ndarray[Any, Any], list[bytes]]:
    """Stamps in ns and CDR messages: the values, then zeros up to `doubles` doubles."""
    stamp = EPOCH * 1_000_000_000 + np.rint(series.time * 1e9).astype(np.int64)
    value = np.zeros((len(stamp), doubles))
    value[:, : series.value.shape[1]] = series.value
    return stamp, stamped(stamp, frame, value)
