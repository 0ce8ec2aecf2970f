"""What a table holds, be it text or Parquet: its columns, with samples of their numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import pyarrow as pa

from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.logs.common.contents import (
    Column,
    Contents,
    Field,
    Stream,
    Vector,
    axes_of,
    extremes,
    indexed_axes,
    numbered_axes,
)
from tdfscal.records import BoolArray, FloatArray

TICKS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Ticks per second of the times that Arrow knows."""
_OPENING: Final = 4096


class Sampled(NamedTuple):
    """Some numbers of a column, (N,), in which rows they are, and its first ones without a hole."""

    row: FloatArray
    value: FloatArray
    first: FloatArray


def sampled(parts: Sequence[tuple[int, Any]], most: int) -> Sampled | None:
    """Take up to so many numbers of each part of a column; None where it does not hold numbers.

    parts : the row with which each begins, and the cells.
    """
    rows, values = [], []
    for begin, column in parts:
        filled = np.flatnonzero(~holes(column))
        chosen = np.linspace(0, len(filled) - 1, min(most, len(filled))).astype(np.int64)
        numbers = _numbers(column.take(as_arrow(filled[chosen])))
        if numbers is None:
            return None
        rows.append(begin + filled[chosen].astype(np.float64))
        values.append(numbers)
    if not parts:
        return None
    opening = _numbers(parts[0][1].drop_null().slice(0, _OPENING))
    return Sampled(np.concatenate(rows), np.concatenate(values), np.asarray(opening))


def holes(column: Any) -> BoolArray:
    """Where a column is empty, (N,)."""
    return np.asarray(as_numpy(column.is_null().cast(pa.int8())) != 0)


def is_number(kind: pa.DataType) -> bool:
    """Whether cells of this type are numbers; times and truths are none."""
    types = pa.types
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind))


def _numbers(column: Any) -> FloatArray | None:
    """A column as float64 seconds or numbers; None where it holds neither."""
    kind, types = column.type, pa.types
    if types.is_timestamp(kind) or types.is_duration(kind):
        return as_numpy(column.cast(pa.int64()).cast(pa.float64(), safe=False)) / TICKS[kind.unit]
    if is_number(kind) or types.is_null(kind):
        return as_numpy(column.cast(pa.float64(), safe=False))
    return None


def repeated(names: Sequence[str]) -> list[str]:
    """Names that are there more than once."""
    return sorted(name for name, times in Counter(names).items() if times > 1)


def table_contents(
    path: Path,
    form: Literal["csv", "parquet"],
    rows: int,
    columns: Sequence[tuple[str, str, str | None]],
    numbers: Mapping[str, Sampled],
    *,
    decimal: Literal[".", ","] = ".",
    problems: Sequence[str] = (),
) -> Contents:
    """Put together what a table holds.

    columns : name, kind and stated unit of each. numbers : of those that hold numbers and whose
    name is there once.
    """
    fields, times = [], []
    for name, kind, unit in columns:
        found = numbers.get(name)
        fields.append(Field(name, kind, unit, *(extremes(found.value) if found else (None, None))))
        step = float(np.median(np.diff(found.first))) if found and found.first.size > 1 else 0.0
        if found and found.value.size > 1 and (np.diff(found.value) >= 0).all() and step > 0:
            times.append(Column(name, unit, found.value, step))
    stated = {name: unit for name, _, unit in columns}
    vectors = []
    by_letter = axes_of(list(numbers))
    taken = {name for _, three in by_letter for name in three}
    by_index = indexed_axes([name for name in numbers if name not in taken])
    taken |= {name for _, three in by_index for name in three}
    by_number = numbered_axes([name for name in numbers if name not in taken], stated)
    for label, three in (*by_letter, *by_index, *by_number):
        axes = [numbers[name] for name in three]
        there = axes[0].row
        for axis in axes[1:]:
            there = np.intersect1d(there, axis.row)
        values = [axis.value[np.searchsorted(axis.row, there)] for axis in axes]
        vectors.append(Vector(three, label, "", stated[three[0]], there, np.column_stack(values)))
    if twice := repeated([name for name, _, _ in columns]):
        problems = (*problems, f"columns are there more than once: {', '.join(twice)}")
    return Contents(
        path,
        form,
        path.stat().st_size,
        (Stream("table", "", rows, tuple(fields)),),
        tuple(vectors),
        tuple(times),
        decimal=decimal,
        problems=tuple(problems),
    )
