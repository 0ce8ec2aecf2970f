"""What a file says of itself, whatever its format: fields with samples of their values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import FloatArray

SAMPLES: Final = 512
"""Rows or messages sampled of each block that is read."""
_INDEXED: Final = re.compile(
    r"(?P<prefix>.{1,200}?)(?:(?P<mark>[_.])(?P<plain>\d)|\[(?P<inner>\d)\])"
)

_NUMBERED: Final = re.compile(r"(?P<prefix>.{1,200}?)(?P<number>\d{1,4})")
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
    stamped : its messages have a header with a time; unusable : why that cannot be used, if so.
    """

    name: str
    kind: str
    count: int
    fields: tuple[Field, ...]
    start: float | None = None
    end: float | None = None
    stamped: bool = False
    unusable: str | None = None


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
        names = Counter(f.name for stream in self.streams for f in stream.fields)
        return [] if self.by_topic else sorted(name for name, times in names.items() if times > 1)

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


def indexed_axes(names: Sequence[str]) -> list[tuple[str, tuple[str, str, str]]]:
    """Find names that end in 0, 1, 2, or in 0 to 5 as poses and wrenches do: (prefix, first three).

    `actual_TCP_pose_0`, `force[0]`, `position.0`.
    """
    groups: dict[tuple[str, str], dict[int, str]] = {}
    for name in names:
        if (match := _INDEXED.fullmatch(name)) is not None:
            style = "[" if match["inner"] else match["mark"]
            index = int(match["inner"] or match["plain"])
            groups.setdefault((match["prefix"], style), {})[index] = name
    return [
        (prefix, (own[0], own[1], own[2]))
        for (prefix, _), own in groups.items()
        if sorted(own) in (list(range(3)), list(range(6)))
    ]


def numbered_axes(
    names: Sequence[str], units: Mapping[str, str | None]
) -> list[tuple[str, tuple[str, str, str]]]:
    """Find nine or more channels of one unit that are numbered from 1 on, three by three.

    `AI1 [kN]` to `AI12 [kN]` of a measuring amplifier: (name with the number of three, the three).
    """
    runs: dict[tuple[str, str], list[str]] = {}
    for name in names:
        match, unit = _NUMBERED.fullmatch(name), units.get(name)
        if match is not None and unit is not None:
            runs.setdefault((match["prefix"], unit), []).append(name)
    found = []
    for (prefix, _), own in runs.items():
        numbers = [int(name.removeprefix(prefix)) for name in own]
        if (
            len(own) >= _CHANNELS
            and len(own) % 3 == 0
            and numbers == [*range(numbers[0], numbers[0] + len(own))]
        ):
            found += [(f"{prefix}* {k // 3 + 1}", (own[k], own[k + 1], own[k + 2]))
                      for k in range(0, len(own), 3)]  # fmt: skip
    return found


def named_axes(
    names: Sequence[str], units: Mapping[str, str | None]
) -> list[tuple[str, tuple[str, str, str]]]:
    """Find threes of columns that may be vectors, by letters, by indices, else by numbers."""
    found = axes_of(names)
    for more in (indexed_axes, lambda left: numbered_axes(left, units)):
        taken = {name for _, three in found for name in three}
        found += more([name for name in names if name not in taken])
    return found


def extremes(value: FloatArray) -> tuple[float | None, float | None]:
    """Smallest and largest finite value; None where there is none."""
    finite = value[np.isfinite(value)]
    if not finite.size:
        return None, None
    return float(finite.min()), float(finite.max())
