"""Dates with times of day as a clock: ISO 8601, and 21.11.2026 14:03:05.

Days and months are not guessed apart: 11/12/2026 is refused. A time without a zone counts as UTC,
so a column has zones in all cells or in none.
"""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
import pyarrow as pa

from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.records import FloatArray

DATES: Final = (
    "write 2026-11-21T14:03:05.123+01:00, or 21.11.2026 14:03:05; all rows with a zone, or none"
)
_ZONE: Final = r"(Z|UTC|[+-](?:0\d|1[0-4]):?[0-5]\d)?"
_TIME: Final = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,:](\d{1,9}))?)?\s*" + _ZONE
_ISO: Final = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})[T_ ]\s*" + _TIME)
_BASIC: Final = re.compile(
    r"(\d{4})(\d{2})(\d{2})T(\d{2})(\d{2})(?:(\d{2})(?:[.,](\d{1,9}))?)?" + _ZONE
)
_GERMAN: Final = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[T_ ,]\s*" + _TIME)
_EPOCH: Final = np.datetime64("1970-01-01T00:00:00", "s")


def is_date_time(cell: str) -> bool:
    """Tell whether a cell is a date with a time of day."""
    return _matched(cell) is not None


def has_zone(cell: str) -> bool:
    """Tell whether a cell is a date and time with a zone."""
    parts = _matched(cell)
    return parts is not None and bool(parts[-1])


def seconds_of(cell: str, *, zoned: bool | None = None) -> float | None:
    """Return s since 1970, UTC; None where the cell is no date and time.

    zoned : whether it has to have a zone; None takes either.
    """
    if (parts := _matched(cell)) is None:
        return None
    year, month, day, hour, minute, second, fraction, zone = parts
    if int(year) == 0 or zoned not in (None, bool(zone)):
        return None
    stamp = f"{year}-{int(month):02}-{int(day):02}T{int(hour):02}:{minute}:{second or '00'}"
    try:
        whole = int((np.datetime64(stamp, "s") - _EPOCH).astype(np.int64))
    except ValueError:
        return None
    if zone and zone[0] in "+-":
        offset = int(zone[1:3]) * 3600 + int(zone[-2:]) * 60
        whole -= offset if zone[0] == "+" else -offset
    return whole + int(fraction.ljust(9, "0")) * 1e-9 if fraction else float(whole)


def seconds_of_all(cells: Any, *, zoned: bool) -> FloatArray:
    """Return (N,) s since 1970 of a column of texts; NaN where one is empty, or no date and time.

    zoned : whether all have zones, or none has.

    ISO 8601 as most recorders write it is parsed all at once, anything else cell by cell.
    """
    try:
        ticks = cells.cast(pa.timestamp("ns", "UTC" if zoned else None)).cast(pa.int64())
    except pa.ArrowInvalid:
        found = [seconds_of(cell or "", zoned=zoned) for cell in cells.to_pylist()]
        return np.array(found, dtype=np.float64)
    seconds, nanoseconds = np.divmod(as_numpy(ticks.fill_null(0)), 1_000_000_000)
    empty = as_numpy(cells.is_null().cast(pa.int8())) != 0
    return np.where(empty, np.nan, seconds + nanoseconds * 1e-9)


def first_date(column: Any) -> str | None:
    """The first cell of a column of texts where that is a date and time; None of another."""
    texts = pa.types.is_string(column.type) and len(column)
    cell = (column[0].as_py() or "") if texts else ""
    return cell if is_date_time(cell) else None


def with_times(column: Any) -> Any:
    """A column of texts that are dates and times as times of Arrow; any other as it is."""
    if (first := first_date(column)) is None:
        return column
    seconds = seconds_of_all(column, zoned=has_zone(first))
    ticks = np.rint(np.nan_to_num(seconds) * 1e9).astype(np.int64)
    return as_arrow(ticks, np.isnan(seconds)).cast(pa.timestamp("ns"))


def _matched(cell: str) -> tuple[Any, ...] | None:
    text = cell.strip()
    if (iso := _ISO.fullmatch(text) or _BASIC.fullmatch(text)) is not None:
        return iso.groups()
    if (german := _GERMAN.fullmatch(text)) is not None:
        day, month, year, *time = german.groups()
        return (year, month, day, *time)
    return None
