"""Dates with times of day as a clock: ISO 8601, and the German order of day, month and year.

Days and months are not guessed apart: 11/12/2026 is refused. A time without a zone counts as UTC.
"""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
import pyarrow as pa

from tdfscal.files.arrow import as_numpy
from tdfscal.records import FloatArray

_TIME: Final = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,:](\d{1,9}))?)?\s*(Z|[+-]\d{2}:?\d{2}|UTC)?"
_ISO: Final = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})[T_ ]\s*" + _TIME)
_GERMAN: Final = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[T_ ,]\s*" + _TIME)
_EPOCH: Final = np.datetime64("1970-01-01T00:00:00", "s")


def is_date_time(cell: str) -> bool:
    """Tell whether a cell is a date with a time of day."""
    return _matched(cell) is not None


def seconds_of(cell: str) -> float | None:
    """Return s since 1970, UTC; None where the cell is no date and time."""
    if (parts := _matched(cell)) is None:
        return None
    year, month, day, hour, minute, second, fraction, zone = parts
    stamp = f"{year}-{int(month):02}-{int(day):02}T{int(hour):02}:{minute}:{second or '00'}"
    try:
        whole = int((np.datetime64(stamp, "s") - _EPOCH).astype(np.int64))
    except ValueError:
        return None
    if zone and zone[0] in "+-":
        offset = int(zone[1:3]) * 3600 + int(zone[-2:]) * 60
        whole -= offset if zone[0] == "+" else -offset
    return whole + int(fraction.ljust(9, "0")) * 1e-9 if fraction else float(whole)


def seconds_of_all(cells: Any) -> FloatArray | None:
    """Return (N,) s since 1970 of a column of texts; None where one is no date and time.

    ISO 8601 as most recorders write it is parsed all at once, anything else cell by cell.
    """
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", "UTC")):
        try:
            ticks = as_numpy(cells.cast(kind).cast(pa.int64()))
        except pa.ArrowInvalid:
            continue
        seconds, nanoseconds = np.divmod(ticks, 1_000_000_000)
        return np.asarray(seconds + nanoseconds * 1e-9)
    found = [seconds_of(str(cell)) for cell in cells.to_pylist()]
    return None if None in found else np.array(found, dtype=np.float64)


def _matched(cell: str) -> tuple[Any, ...] | None:
    text = cell.strip()
    if (iso := _ISO.fullmatch(text)) is not None:
        return iso.groups()
    if (german := _GERMAN.fullmatch(text)) is not None:
        day, month, year, *time = german.groups()
        return (year, month, day, *time)
    return None
