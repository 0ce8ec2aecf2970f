"""Tables, text or Parquet: dates as a clock, the wanted columns as pieces, names of vectors.

A date with its time of day is ISO 8601, or 21.11.2026 14:03:05. Days and months are not guessed
apart: 11/12/2026 is refused. A time without a zone counts as UTC, so a column has zones in all
cells or in none.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa

from tdfscal.errors import DataError
from tdfscal.files.saving import as_arrow
from tdfscal.files.yaml import shorten
from tdfscal.frozen import record
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
    if mapping.rows == "timeseries" or mapping.time.field in present:
        wanted = {mapping.time.field: None} | wanted
    for name in wanted:
        if (times := present.count(name)) > 1:
            what = f"column {name} is there {times} times"
            raise DataError(what, hint="give each column its own name")
    if missing := [name for name in wanted if name not in present]:
        raise missing_fields(missing, present, kind="column")
    return {name: present.index(name) for name in wanted}


@record
class Wanted:
    """The wanted columns of a table.

    signals : of each the columns of x, y, z, and their factors to SI and tdfscal's sign.
    time : None where rows are counted. second : s in its unit. zoned : whether it is a date and
    time of day with a zone, or without; None where it is a number.
    sparse : streams take turns: a row holds the cells of some signals, those of others are empty.
    """

    signals: tuple[tuple[tuple[str, ...], tuple[float, float, float]], ...]
    time: str | None
    second: float
    zoned: bool | None
    sparse: bool

    def values(self, table: pa.Table, row: int = 0) -> tuple[FloatArray, FloatArray | None]:
        """The signals (signals, 3, N), SI, and the time (N,), s.

        NaN stands where a row of a sparse table leaves a signal out. row : rows before. Raises
        DataError where a cell holds no finite number, or no date and time.
        """
        vectors = np.empty((len(self.signals), 3, table.num_rows))
        for vector, (names, factors) in zip(vectors, self.signals, strict=True):
            columns = [table.column(name) for name in names]
            absent = np.zeros(table.num_rows, dtype=np.bool_)
            if self.sparse:
                absent = np.logical_and.reduce([holes(column) for column in columns])
            for axis, name, column, factor in zip(vector, names, columns, factors, strict=True):
                np.multiply(_numbers(column, name, row, absent), factor, out=axis)
            if self.sparse:
                vector[:, absent] = np.nan
        if self.time is None:
            return vectors, None
        return vectors, self._seconds(table.column(self.time), self.time, row)

    def _seconds(self, column: Any, name: str, row: int) -> FloatArray:
        """The time (N,), s. A column that is a time by its type has its own unit."""
        kind = column.type
        if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            return _numbers(column.cast(pa.int64()), name, row) / TICKS[kind.unit]
        if not pa.types.is_string(kind):
            return _numbers(column, name, row) * self.second
        if column.null_count:
            raise _fault("the cell is empty", name, row + int(np.argmax(holes(column))))
        if self.zoned is None:
            raise no_numbers(name, "string")
        seconds = seconds_of_all(column, zoned=self.zoned)
        if (none := np.isnan(seconds)).any():
            k = int(np.argmax(none))
            what = f"{shorten(column[k].as_py())!r} is no date and time as the first row has one"
            raise _fault(what, name, row + k, hint=DATES)
        return seconds


def _numbers(column: Any, name: str, row: int, absent: BoolArray | None = None) -> FloatArray:
    """Return a column as (N,) float64, each value present, but for those absent, and finite."""
    kind = column.type
    if not is_number(kind):
        raise no_numbers(name, str(kind))
    if column.null_count:
        empty = holes(column) if absent is None else holes(column) & ~absent
        if empty.all() and not row:
            raise _fault("no cell of the column holds a number", name, row, fields=(name,))
        if empty.any():
            raise _fault("the cell is empty", name, row + int(np.argmax(empty)))
        column = column.fill_null(0)
    numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64(), safe=False)
    values = as_numpy(numbers)
    if not (np.isfinite(values.sum()) or np.isfinite(values).all()):
        k = int(np.argmin(np.isfinite(values)))
        fields = (name,) if np.isnan(values).all() and not row else ()
        raise _fault(f"{values[k]} is not a finite number", name, row + k, fields=fields)
    return values


def _fault(
    what: str,
    name: str,
    row: int,
    *,
    hint: str = "correct that cell, or leave its row out",
    fields: Sequence[str] = (),
) -> DataError:
    """The error for a cell; fields : the column, where none of its cells is a number."""
    where = f"column {name}, row {row}"
    return DataError(what, where=where, hint=f"{hint}; rows count from 0", fields=fields)


def no_numbers(name: str, holds: str) -> DataError:
    """The error for a column that holds something else."""
    return DataError(
        f"column {name} holds {holds}, not numbers",
        hint="name a column of numbers in the log block of rig.yaml",
        fields=(name,) if holds == "null" else (),
    )


def table_piece(
    request: Request,
    vectors: FloatArray,
    time: FloatArray | None,
    row: int,
    *,
    sparse: bool,
) -> Piece:
    """The next rows of a table; vectors, time : as `Wanted` has them. row : of the first."""
    value = {number: vector.T for number, vector in enumerate(vectors)}
    if time is None:
        return (Block("row", np.arange(row, row + vectors.shape[2], dtype=np.float64), value),)
    clock = f"column {request.mapping.time.field}"
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


def as_numpy(column: Any) -> FloatArray:
    """A column of numbers, (N,), NaN where it is null; read-only, and copied only if in chunks."""
    if column.null_count:
        column = column.fill_null(np.nan)
    if isinstance(column, pa.ChunkedArray):
        column = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
    numbers: FloatArray = np.from_dlpack(column)  # type: ignore[assignment]
    return numbers


def holes(column: Any) -> BoolArray:
    """Where a column is empty, (N,)."""
    return np.asarray(as_numpy(column.is_null().cast(pa.int8())) != 0)


def is_number(kind: pa.DataType) -> bool:
    """Whether cells of this type are numbers; times and truths are none."""
    types = pa.types
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind))


_NUMBERED: Final = re.compile(r"(?P<prefix>.{1,200}?)[_.\[](?P<number>\d)\]?")


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


def named_axes(names: Sequence[str]) -> list[tuple[str, tuple[str, str, str]]]:
    """Find threes of columns that may be vectors: (what they share, the three).

    By letters; else the first three of 0, 1, 2, or of 0 to 5 as poses and wrenches have
    (`force[0]`, `actual_TCP_pose_0`).
    """
    found = axes_of(names)
    taken = {name for _, three in found for name in three}
    groups: dict[str, dict[int, str]] = {}
    for name in names:
        if name not in taken and (match := _NUMBERED.fullmatch(name)) is not None:
            groups.setdefault(match["prefix"], {})[int(match["number"])] = name
    whole = [own for own in groups.items() if sorted(own[1]) in ([0, 1, 2], [*range(6)])]
    return found + [(prefix, (own[0], own[1], own[2])) for prefix, own in whole]
