"""Tables, text or Parquet: the wanted columns as pieces, and samples of all columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa

from tdfscal.errors import DataError, RigError
from tdfscal.files.arrow import as_arrow, as_numpy
from tdfscal.logs.contents import Column, Contents, Field, Stream, Vector, extremes, named_axes
from tdfscal.logs.dates import with_times
from tdfscal.logs.request import Block, Piece, Request, Signal, missing_fields
from tdfscal.records import BoolArray, FloatArray, IntArray

TICKS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Ticks per second of the times that Arrow knows."""
_OPENING: Final = 4096
_FEW_ROWS: Final = 16
_OFTEN: Final = 0.1
"""Share of the first rows that a slow stream leaves empty at least; a hole is rarer."""


def columns_of(request: Request, present: Sequence[str]) -> dict[str, int]:
    """Where each wanted column of a table is; without the time where postures have none.

    Raises DataError where one is missing or there twice, RigError where the mapping names a field
    twice: two sensors would read the same numbers.
    """
    seen: dict[str, Signal] = {}
    for signal in request.signals:
        for name in signal.own:
            other = seen.setdefault(name, signal)
            if other is not signal and {other.quantity, signal.quantity} != {"temperature"}:
                raise RigError(
                    f"field {name} is named twice, for the {other.quantity} of {other.support} "
                    f"and for the {signal.quantity} of {signal.support}",
                    where="log.supports",
                )
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
    factors: Sequence[tuple[float, float, float]],
    time: FloatArray | None,
    row: int,
    *,
    sparse: bool,
) -> Piece:
    """The next rows of a table.

    vectors : (signals, 3, N), as recorded; scaled in place. factors : of each signal, to SI.
    time : (N,), s; None where rows are counted, from `row` on. sparse : streams have times of their
    own, and NaN stands where a signal has no values.
    """
    vectors *= np.array(factors)[:, :, None]
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
        twice = repeated([name for _, name, _, _ in columns])
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
