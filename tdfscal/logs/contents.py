"""What a file says of itself, whatever its format: fields with samples of their values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa

from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.frozen import record
from tdfscal.logs.table import TICKS, is_number, with_times
from tdfscal.records import FloatArray

_OPENING: Final = 4096
SAMPLES: Final = 512
"""Rows or messages sampled of each block that is read."""
_NUMBERED: Final = re.compile(r"(?P<prefix>.{1,200}?)(?P<mark>[_.\[]?)(?P<number>\d{1,4})\]?")
_CHANNELS: Final = 9

Format = Literal["csv", "parquet", "mcap", "bag"]


@record
class Field:
    """One field of a stream.

    kind : its type in the format's own words. unit : as the file names it; None where it does not.
    low, high : of the values sampled; None where it holds no numbers.
    """

    name: str
    kind: str
    unit: str | None = None
    low: float | None = None
    high: float | None = None


@record
class Stream:
    """Fields that come together: a table, or a topic.

    kind : message type, empty for a table. count : rows or messages.
    start, end : s, by the file's own clock; None where it has none (a table's is a column).
    """

    name: str
    kind: str
    count: int
    fields: tuple[Field, ...]
    start: float | None = None
    end: float | None = None

    @property
    def stamped(self) -> bool:
        """Whether its messages have a header with a time."""
        return any(field.name == "header.stamp.sec" for field in self.fields)


@record
class Vector:
    """Three numbers that may be a position or a force.

    fields : their names, or the one field that has x, y, z. label : name without the axis letter.
    kind : type of message or member, for what it says of the meaning. unit : as the file names it.
    time : (N,), s, or rows where the file has no clock of its own. value : (N, 3), as recorded.
    """

    fields: tuple[str, ...]
    label: str
    kind: str
    unit: str | None
    time: FloatArray
    value: FloatArray


@record
class Column:
    """A column of numbers that may be the time: value (N,) sampled; step, the median interval."""

    name: str
    unit: str | None
    value: FloatArray
    step: float


@record
class Contents:
    """One file. columns : those that could be the time. decimal : of CSV."""

    path: Path
    format: Format
    bytes: int
    streams: tuple[Stream, ...]
    vectors: tuple[Vector, ...]
    columns: tuple[Column, ...] = ()
    decimal: Literal[".", ","] = "."
    problems: tuple[str, ...] = ()

    @property
    def repeated(self) -> list[str]:
        """Columns that are there more than once: which of them is meant is not known."""
        names = [field.name for stream in self.streams for field in stream.fields]
        return [] if self.by_topic else _repeated(names)

    @property
    def by_topic(self) -> bool:
        """Whether it holds messages by topic, not rows of a table."""
        return self.format in ("mcap", "bag")


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


def extremes(value: FloatArray) -> tuple[float | None, float | None]:
    """Smallest and largest finite value; None where there is none."""
    finite = value[np.isfinite(value)]
    if not finite.size:
        return None, None
    return float(finite.min()), float(finite.max())


DATED: Final = "date and time"
"""What a column of texts holds that are dates with times of day."""


class TableLook:
    """Some rows of a table, the same of all columns, taken while it is looked through.

    most : rows of each part.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._rows: dict[int, FloatArray] = {}
        self._values: dict[str, list[FloatArray]] = {}
        self._steps: dict[str, float] = {}
        self._kinds: dict[str, str] = {}

    def add(self, begin: int, table: pa.Table) -> None:
        """Take in a part of the table, or of its columns, from row `begin` on."""
        chosen = np.linspace(0, table.num_rows - 1, min(self._most, table.num_rows))
        chosen = chosen.astype(np.int64)
        self._rows[begin] = begin + chosen.astype(np.float64)
        for name, cells in zip(table.column_names, table.columns, strict=True):
            column = with_times(cells)
            numbers = _numbers(column.take(as_arrow(chosen)))
            if numbers is None or self._kinds.get(name) == "text":
                self._kinds[name] = "text"
                continue
            self._values.setdefault(name, []).append(numbers)
            if name not in self._kinds:
                first = _numbers(column.drop_null().slice(0, _OPENING))
                steps = np.diff(first if first is not None else [])
                self._steps[name] = float(np.median(steps)) if steps.size else 0.0
                self._kinds[name] = DATED if pa.types.is_string(cells.type) else "number"

    def kind(self, key: str) -> str:
        """What a column holds: numbers, dates or texts; or it is empty."""
        return self._kinds.get(key, "empty")

    def contents(
        self,
        path: Path,
        form: Literal["csv", "parquet"],
        rows: int,
        columns: Sequence[tuple[str, str, str, str | None]],
        decimal: Literal[".", ","] = ".",
    ) -> Contents:
        """Put together what the table holds.

        columns : as it was added under, name, kind and stated unit of each.
        """
        row = np.concatenate([np.empty(0), *self._rows.values()])
        twice = _repeated([name for _, name, _, _ in columns])
        fields, times = [], []
        numbers: dict[str, FloatArray] = {}
        for key, name, kind, unit in columns:
            value = np.concatenate([np.empty(0), *self._values.get(key, ())])
            if self.kind(key) in ("text", "empty") or name in twice:
                fields.append(Field(name, kind, unit))
                continue
            numbers[name] = value
            fields.append(Field(name, kind, unit, *extremes(value)))
            filled, step = value[~np.isnan(value)], self._steps[key]
            if filled.size > 1 and step > 0 and (np.diff(filled) >= 0).all():
                times.append(Column(name, unit, filled, step))
        units = {name: unit for _, name, _, unit in columns}
        vectors = []
        for label, three in named_axes(list(numbers), units):
            values = np.column_stack([numbers[name] for name in three])
            there = ~np.isnan(values).any(axis=1)
            vectors.append(Vector(three, label, "", units[three[0]], row[there], values[there]))
        stream = Stream("table", "", rows, tuple(fields))
        size = path.stat().st_size
        return Contents(path, form, size, (stream,), tuple(vectors), tuple(times), decimal)


def _numbers(column: Any) -> FloatArray | None:
    """A column as float64 seconds or numbers; None where it holds neither."""
    kind, types = column.type, pa.types
    if types.is_timestamp(kind) or types.is_duration(kind):
        return as_numpy(column.cast(pa.int64()).cast(pa.float64(), safe=False)) / TICKS[kind.unit]
    if is_number(kind) or types.is_null(kind):
        return as_numpy(column.cast(pa.float64(), safe=False))
    return None


def _repeated(names: Sequence[str]) -> list[str]:
    """Names that are there more than once."""
    return sorted(name for name, times in Counter(names).items() if times > 1)
