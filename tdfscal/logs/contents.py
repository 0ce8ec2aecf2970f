"""What a file says of itself: fields with samples, and the units in which these can be.

Units by plausibility: what hinges' distances, weights and sample intervals can be.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa

from tdfscal.files.rig.recorders import UNITS, canonical, unit_factor
from tdfscal.files.saving import as_arrow
from tdfscal.frozen import record
from tdfscal.logs.table import TICKS, as_numpy, is_number, named_axes, with_times
from tdfscal.records import FloatArray, Rig

_OPENING: Final = 4096
SAMPLES: Final = 512
"""Rows or messages sampled of each block that is read."""

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


def extremes(value: FloatArray) -> tuple[float | None, float | None]:
    """Smallest and largest finite value; None where there is none."""
    finite = value[np.isfinite(value)]
    if not finite.size:
        return None, None
    return float(finite.min()), float(finite.max())


DATED: Final = "date and time"
"""What a column of texts holds that are dates with times of day."""


def table_contents(
    path: Path,
    form: Literal["csv", "parquet"],
    rows: int,
    parts: Sequence[tuple[int, pa.Table]],
    columns: Sequence[tuple[str, str, str | None, str | None]],
    decimal: Literal[".", ","] = ".",
) -> Contents:
    """What a table of so many rows holds, by samples of some parts of it.

    parts : with the number of their first row. columns : of each what the parts call it, its name,
    its kind in the format's words, if it has any, and its stated unit.
    """
    chosen = [np.linspace(0, len(t) - 1, min(SAMPLES, len(t))).astype(np.int64) for _, t in parts]
    at = [begin + own for (begin, _), own in zip(parts, chosen, strict=True)]
    row = np.concatenate([np.empty(0), *at])
    twice = _repeated([name for _, name, _, _ in columns])
    fields, times = [], []
    numbers: dict[str, FloatArray] = {}
    for key, name, kind, unit in columns:
        tables = [] if name in twice else [t for _, t in parts if key in t.column_names]
        cells = [with_times(table[key]) for table in tables]
        values = [_numbers(own.take(as_arrow(k))) for own, k in zip(cells, chosen, strict=False)]
        told = [own for own in values if own is not None]
        if not told or len(told) < len(values):
            fields.append(Field(name, kind or "text", unit))
            continue
        value = numbers[name] = np.concatenate(told)
        dated = pa.types.is_string(parts[0][1][key].type)
        fields.append(Field(name, DATED if dated else kind or "number", unit, *extremes(value)))
        opening = _numbers(cells[0].drop_null().slice(0, _OPENING))
        steps = np.diff(opening if opening is not None else [])
        step = float(np.median(steps)) if steps.size else 0.0
        filled = value[~np.isnan(value)]
        if filled.size > 1 and step > 0 and (np.diff(filled) >= 0).all():
            times.append(Column(name, unit, filled, step))
    units = {name: unit for _, name, _, unit in columns}
    vectors = []
    for label, three in named_axes(list(numbers)):
        both = np.column_stack([numbers[name] for name in three])
        there = ~np.isnan(both).any(axis=1)
        vectors.append(Vector(three, label, "", units[three[0]], row[there], both[there]))
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


_LONGEST: Final = 20.0  # m; hinges further apart are in a smaller unit
_LIGHT: Final = 100.0  # of a terminal's weight in the log's unit; less is kN
_PLAUSIBLE: Final = {"position": (0.01, 100.0, "m"), "force": (1.0, 1e6, "N")}
"""Between what hinges of any rig are apart, and any terminal weighs."""
_INTERVAL: Final = (2e-5, 1.0)  # s, between which recorders take samples
_WHOLE: Final = 0.1  # s; whole numbers that step by more are no seconds
_PATIENCE: Final = 2.0  # s; an interval that is longer is not that of a recording
_SHORTEST: Final = 5.0  # s; no campaign is shorter


@record
class Proposal:
    """A unit to propose. note : why. problem : why what the file itself says cannot be."""

    unit: str
    note: str = ""
    problem: str = ""


def resampled(vectors: Sequence[Vector]) -> FloatArray:
    """(n, N, 3) at common times."""
    start = max(float(v.time[0]) for v in vectors)
    end = min(float(v.time[-1]) for v in vectors)
    t = np.linspace(start, end, 400)
    return np.stack(
        [np.column_stack([np.interp(t, v.time, v.value[:, j]) for j in range(3)]) for v in vectors]
    )


def length_unit(positions: Sequence[Vector], rig: Rig | None) -> Proposal:
    """The unit in which the NCPs are as far apart as the rig's hinges, or as hinges can be."""
    far = _middle(_distances(resampled(positions)))
    known = 0.0
    if rig is not None and rig.n == len(positions):
        known = _middle(_distances(rig.hinge[:, None, :]))
    fitting = next((u for u in ("m", "mm") if far * UNITS["position"][u] <= _LONGEST), "um")
    hinges = f" and the rig's hinges {known:.4g} m" if known else ""
    said = "the NCPs are {} apart" + hinges
    return _proposed("position", (far, known), fitting, positions[0].unit, said)


def force_unit(forces: Sequence[Vector], rig: Rig | None) -> Proposal:
    """The unit in which the forces add up to the terminal's weight, or to what can be one."""
    total = _middle(np.linalg.norm(resampled(forces).sum(axis=0), axis=1))
    weight = 0.0
    if rig is not None and np.isfinite(rig.mass.std):
        weight = float(rig.mass.value) * rig.gravity
    weighs = f" and the terminal weighs {weight:.4g} N" if weight else ""
    check = "" if weight or forces[0].unit else "; check it against the weight"
    said = "the forces add up to {}" + weighs + check
    light = "kN" if total < _LIGHT else "N"
    return _proposed("force", (total, weight), light, forces[0].unit, said)


def _proposed(
    quantity: Literal["position", "force"],
    sizes: tuple[float, float],
    likely: str,
    stated: str | None,
    said: str,
) -> Proposal:
    """The unit of a quantity.

    sizes : in the log's unit, and what it is in SI, 0 where the rig file does not say. likely : the
    unit then. stated : by the file itself. said : what the size is, with a place for the number.
    """
    size, known = sizes
    units, (low, high, si) = UNITS[quantity], _PLAUSIBLE[quantity]
    if known > 0.0:
        likely = min(units, key=lambda unit: abs(np.log(max(size, 1e-9) * units[unit] / known)))
    if stated is None:
        key = {"position": "length_unit", "force": "force_unit"}[quantity]
        return Proposal(likely, f"{key}: {likely}, as {said.format(f'{size:.4g} {likely}')}")
    unit = canonical(stated)
    value = size * units[unit]
    if size <= 0.0 or (unit == likely if known else low <= value <= high):
        return Proposal(unit)
    return _contradicted(unit, f"{unit}, {said.format(f'{value:.4g} {si}')}", likely)


def time_unit(column: Column, suffix: str) -> Proposal:
    """The unit in which the samples' interval is a recorder's; suffix: the name's last word."""
    fitting = fitting_time_unit(column)
    stated = column.unit is not None and unit_factor("time", column.unit) is not None
    named = canonical(column.unit if column.unit is not None and stated else suffix)
    step = f"the step of {column.name} is {column.step:.4g}"
    doubt = ""
    if named in UNITS["time"]:
        if fitting is None or recordable(column, named):
            return Proposal(named)
        if stated:
            what = f"{step} {named}, which is no recorder's interval"
            return _contradicted(named, what, fitting)
        doubt = f", though its name says {named}"
    if fitting is None:
        return Proposal("s", f"the unit of {column.name} is unclear; s is taken")
    return Proposal(fitting, f"time unit: {fitting}, as {step} {fitting}{doubt}")


def fitting_time_unit(column: Column) -> str | None:
    """The first of s, ms, us, ns in which the column can be a recording's time, if any."""
    whole = bool((column.value == np.rint(column.value)).all())
    span = float(column.value[-1] - column.value[0])
    for unit, factor in UNITS["time"].items():
        longest = _WHOLE if whole and unit == "s" else _INTERVAL[1]
        long_enough = unit == "s" or span * factor >= _SHORTEST
        if long_enough and _INTERVAL[0] <= column.step * factor <= longest:
            return unit
    return None


def _contradicted(unit: str, what: str, fitting: str) -> Proposal:
    """The header's unit, and why it cannot be."""
    problem = f"by the header's unit, {what}; {fitting} would fit: check the header"
    return Proposal(unit, problem=problem)


def recordable(column: Column, unit: str) -> bool:
    """Can a log be recorded at the column's step in this unit?"""
    return _INTERVAL[0] <= column.step * UNITS["time"][canonical(unit)] <= _PATIENCE


def _distances(points: FloatArray) -> FloatArray:
    """Distances (N, pairs) of points (n, N, 3)."""
    i, j = np.triu_indices(len(points), 1)
    return np.asarray(np.linalg.norm(points[i] - points[j], axis=2).T)


def _middle(value: FloatArray) -> float:
    """Median of what is finite; 0 where nothing is."""
    finite = value[np.isfinite(value)]
    return float(np.median(finite)) if finite.size else 0.0
