"""A log as one table: CSV as a machine's recorder writes it, and Parquet with default names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Log

MM = 1000.0
AXES = ("x", "y", "z")
_HALL = "T_hall_degC"


def rows_of(log: Log) -> dict[str, Any]:
    """What a `log` block says of its rows where these are postures."""
    return {"rows": "postures"} if log.rows == "postures" else {}


def write_csv(path: Path, log: Log) -> dict[str, Any]:
    """Positions in mm, forces in N, time in s; shortest decimals that read back as they are.

    Returns the rig file's `log` block. Raises UsageError where the signals do not share one clock.
    """
    supports = {
        name: {
            "position": [f"NCP{i}_ActPos{a.upper()}" for a in AXES],
            "force": [f"TDFS{i}_F{a}" for a in AXES],
        }
        for i, name in enumerate(log.supports, 1)
    }
    names = ["t_s"]
    for fields in supports.values():
        names += [*fields["position"], *fields["force"]]
    names += [_HALL] * len(log.temperature)
    scale = np.tile([MM] * 3 + [1.0] * 3, len(log.supports))
    warmth = [series.value[:, 0] for series in log.temperature]
    table = np.column_stack([_clock(log), _signals(log) * scale, *warmth])
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(",".join(names) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
    return {
        **rows_of(log),
        "time": {"field": "t_s", "unit": "s"},
        "length_unit": "mm",
        "force_unit": "N",
        "force_on": "terminal",
        **({"temperature": _HALL} if log.temperature else {}),
        "supports": supports,
    }


def write_parquet(path: Path, log: Log) -> dict[str, Any]:
    """SI units and default names (`time`, `<name>.x` … `<name>.fz`), page checksums on.

    Returns the rig file's `log` block: empty where the defaults say it all. Raises UsageError
    where the signals do not share one clock.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    from tdfscal.files.arrow import as_arrow

    members = (*AXES, *(f"f{a}" for a in AXES))
    names = [f"{support}.{member}" for support in log.supports for member in members]
    columns = [_clock(log), *_signals(log).T, *(s.value[:, 0] for s in log.temperature)]
    names += ["temperature"] * len(log.temperature)
    table = pa.table(dict(zip(["time", *names], map(as_arrow, columns), strict=True)))
    pq.write_table(table, path, compression="zstd", write_page_checksum=True)
    return {**rows_of(log), **({"temperature": "temperature"} if log.temperature else {})}


def _clock(log: Log) -> FloatArray:
    time = log.position[0].time
    for series in (*log.position, *log.force, *log.temperature):
        if not np.array_equal(series.time, time):
            raise UsageError(
                "signals of different rates do not fit into one table",
                hint="write MCAP, or simulate with one rate",
            )
    return time


def _signals(log: Log) -> FloatArray:
    pairs = zip(log.position, log.force, strict=True)
    return np.hstack([series.value for pair in pairs for series in pair])
