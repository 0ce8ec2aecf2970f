"""Tables, text or Parquet: dates as a clock, the wanted columns as pieces, names of vectors.

A date with its time of day is ISO 8601, or 21.11.2026 14:03:05. Days and months are not guessed
apart: 11/12/2026 is refused. A time without a zone counts as UTC, so a column has zones in all
cells or in none.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa

from tdfscal.errors import DataError
from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.logs.log_file import Block, Piece, Request, missing_fields
from tdfscal.records import BoolArray, FloatArray, IntArray

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


TICKS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Ticks per second of the times that Arrow knows."""
_FEW_ROWS: Final = 16
_OFTEN: Final = 0.1
"""Share of the first rows that a slow stream leaves empty at least; a hole is rarer."""


def columns_of(request: Request, present: Sequence[str]) -> dict[str, int]:
    """Where each wanted column of a table is; without the time where postures have none.

    Raises DataError where one is missing or there twice.
    """
    wanted = dict.fromkeys(name for signal in request.signals for name in signal.components)
    mapping = request.mapping
    if mapping.rows == "timeseries" or mapping.time_field in present:
        wanted = {mapping.time_field: None} | wanted
    for name in wanted:
        if (times := present.count(name)) > 1:
            what = f"column {name} is there {times} times"
            raise DataError(what, hint="give each column its own name", fields=[name])
    if missing := [name for name in wanted if name not in present]:
        raise missing_fields(missing, present, kind="column")
    return {name: present.index(name) for name in wanted}


def table_piece(
    request: Request,
    vectors: FloatArray,
    time: FloatArray | None,
    row: int,
    *,
    sparse: bool,
) -> Piece:
    """The next rows of a table.

    vectors : (signals, 3, N), SI. time : (N,), s; None where rows are counted, from `row` on.
    sparse : streams have times of their own, and NaN stands where a signal has no values.
    """
    value = {number: vector.T for number, vector in enumerate(vectors)}
    if time is None:
        return (Block("row", np.arange(row, row + vectors.shape[2], dtype=np.float64), value),)
    clock = f"column {request.mapping.time_field}"
    if not sparse:
        return (Block(clock, time, value),)
    parts = []
    for number, vector in value.items():
        there = ~np.isnan(vector[:, 0])
        signal = request.signals[number]
        name = f"{clock} for the {signal.quantity} of {signal.support}"
        parts.append(Block(name, time[there], {number: vector[there]}))
    return tuple(parts)


def takes_turns(filled: IntArray) -> bool:
    """Whether a table is of streams with times of their own, by the cells of its first rows.

    filled : (signals, rows), how many of x, y, z are there. Two signals stand in for each other,
    or one is absent from many rows. A signal that is absent now and then is a hole.
    """
    there, absent = filled == 3, filled == 0
    alone = (there.astype(int) @ absent.T.astype(int)) > 0
    often = filled.shape[1] >= _FEW_ROWS and bool(absent.mean(axis=1).max() >= _OFTEN)
    return bool(np.any(alone & alone.T)) or often


def holes(column: Any) -> BoolArray:
    """Where a column is empty, (N,)."""
    return np.asarray(as_numpy(column.is_null().cast(pa.int8())) != 0)


def is_number(kind: pa.DataType) -> bool:
    """Whether cells of this type are numbers; times and truths are none."""
    types = pa.types
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind))


_NUMBERED: Final = re.compile(r"(?P<prefix>.{1,200}?)(?P<mark>[_.\[]?)(?P<number>\d{1,4})\]?")
_CHANNELS: Final = 9


def axes_of(names: Sequence[str]) -> list[tuple[str, tuple[str, str, str]]]:
    """Find names that differ only in x, y, z: (name with * for the axis, the three names).

    Each name goes to one vector; of several letters that would do, the last one is the axis.
    """
    there = set(names)
    taken: set[str] = set()
    found = []
    for name in names:
        if name not in there:
            continue
        for place in reversed([k for k, letter in enumerate(name) if letter in "xyzXYZ"]):
            before, after = name[:place], name[place + 1 :]
            axes = "XYZ" if name[place].isupper() else "xyz"
            x, y, z = (before + axis + after for axis in axes)
            if there >= {x, y, z} and not taken & {x, y, z}:
                taken |= {x, y, z}
                found.append((f"{before}*{after}", (x, y, z)))
    return found


def named_axes(
    names: Sequence[str], units: Mapping[str, str | None]
) -> list[tuple[str, tuple[str, str, str]]]:
    """Find threes of columns that may be vectors, by letters, else by numbers."""
    found = axes_of(names)
    taken = {name for _, three in found for name in three}
    return found + _numbered([name for name in names if name not in taken], units)


def _numbered(
    names: Sequence[str], units: Mapping[str, str | None]
) -> list[tuple[str, tuple[str, str, str]]]:
    """Find threes by numbers: (name without the number, the three).

    The first three of 0, 1, 2, or of 0 to 5 as poses and wrenches have (`force[0]`,
    `actual_TCP_pose_0`); nine or more channels of one unit in sequence, three by three (`AI1 [kN]`
    to `AI12 [kN]` of a measuring amplifier).
    """
    groups: dict[tuple[str, str, str | None], dict[int, str]] = {}
    for name in names:
        if (match := _NUMBERED.fullmatch(name)) is not None:
            key = match["prefix"], match["mark"], units.get(name)
            groups.setdefault(key, {})[int(match["number"])] = name
    found: list[tuple[str, tuple[str, str, str]]] = []
    for (prefix, mark, unit), own in groups.items():
        numbers, each = list(own), list(own.values())
        if mark and sorted(own) in (list(range(3)), list(range(6))):
            found.append((prefix, (own[0], own[1], own[2])))
        elif (
            unit is not None
            and len(own) >= _CHANNELS
            and len(own) % 3 == 0
            and numbers == [*range(numbers[0], numbers[0] + len(own))]
        ):
            threes = zip(each[::3], each[1::3], each[2::3], strict=True)
            found += [(f"{prefix}{mark}* {k}", three) for k, three in enumerate(threes, 1)]
    return found
