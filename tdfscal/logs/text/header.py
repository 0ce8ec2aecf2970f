"""The wanted columns of a text log: which they are, and in which units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError
from tdfscal.logs.date_times import has_zone, is_date_time
from tdfscal.logs.log_file import AGAIN, placed
from tdfscal.logs.request import UNITS, Quantity, Request, Signal, canonical, is_unit, unit_factor
from tdfscal.logs.table import columns_of, takes_turns
from tdfscal.logs.text.cells import (
    fits_header,
    is_number_of_either,
    row_cells,
    split_cells,
    split_label,
)
from tdfscal.logs.text.head import Head, best_line, numbered_columns, scope_head

_SEARCHED_ROWS = 256


@dataclass(frozen=True, slots=True)
class Header:
    """How to read the table.

    lines : how many lines of the file come before the first row.
    columns : how many cells a row has: as many as names, but for a separator at the end of one of
    the two; a cell without a name is empty in every row.
    time : column of the time; None where rows are postures and the file has no time.
    zoned : whether the time is written as date and time of day with a zone, or without; None where
        it is a number.
    components : per signal, the columns of x, y, z.
    factors : per signal, of x, y, z, to SI and tdfscal's sign.
    time_factor : to s.
    sparse : streams take turns: a row holds the cells of some signals, those of others are empty.
    ends : the last line may say EOF.
    """

    separator: str
    lines: int
    columns: int
    names: tuple[str, ...]
    time: int | None
    zoned: bool | None
    components: tuple[tuple[int, int, int], ...]
    factors: tuple[tuple[float, float, float], ...]
    time_factor: float
    sparse: bool = False
    ends: bool = False

    @property
    def wanted(self) -> tuple[int, ...]:
        """Columns to read: x, y, z of each signal in turn, then the time."""
        time = () if self.time is None else (self.time,)
        return (*(column for three in self.components for column in three), *time)


def find_header(lines: Sequence[str], request: Request) -> Header:
    """Find the header line among the file's first, and resolve the wanted fields to columns.

    The line that holds most of the wanted names is the header, whatever comes before it. Columns
    of a table without one are named by their numbers, from 1.

    Raises DataError where columns are missing or repeated, or a unit contradicts the mapping.
    """
    names = [name for signal in request.signals for name in signal.components]
    wanted = {request.mapping.time_field, *names}
    best = _head(lines, names, wanted, request.mapping.decimal)
    with placed(f"line {max(best.line, 0) + 1}"):
        labels = [split_label(cell, wanted) for cell in best.cells]
        column_of = columns_of(request, [name for name, _ in labels])
        row_units, above = best.units, best.lines
        if not best.scope:
            row_units = _units_row(lines, best, list(column_of.values()))
            above = best.line + 1 + bool(row_units)
        stated = [unit or row_units.get(c) for c, (_, unit) in enumerate(labels)]
        time = column_of.get(request.mapping.time_field)
        first = next((line for line in lines[above:] if line.strip()), "")
        opening = split_cells(first, best.separator)
        dated = time is not None and time < len(opening) and is_date_time(opening[time])
        components = []
        factors = []
        for signal in request.signals:
            x, y, z = (column_of[name] for name in signal.components)
            components.append((x, y, z))
            named = [(stated[c], best.cells[c]) for c in (x, y, z)]
            factors.append(_factors(signal, named, request))
        time_factor = 1.0
        if time is not None and not dated:
            unit = request.mapping.time_unit
            time_factor = _unit("time", unit, stated[time], request, best.cells[time])
    return Header(
        separator=best.separator,
        lines=above,
        columns=row_cells(lines[above:], best.separator, best.cells),
        names=best.cells,
        time=time,
        zoned=has_zone(opening[time]) if time is not None and dated else None,
        components=tuple(components),
        factors=tuple(factors),
        time_factor=time_factor,
        ends=best.scope,
        sparse=time is not None and _takes_turns(lines[above:], best.separator, components),
    )


def _head(lines: Sequence[str], names: Sequence[str], wanted: set[str], decimal: str) -> Head:
    """The line of the columns' names."""
    best = scope_head(lines) or best_line(lines, wanted, decimal)
    if best is None:
        raise DataError("it begins with nothing but blank lines", hint=AGAIN)
    if best.scope:
        return best
    if all(name.isdecimal() for name in names):
        return numbered_columns(lines, decimal) or best
    if best.named == 0 and all(is_number_of_either(c) for c in best.cells):
        raise DataError(
            "there is no header line; the first line holds numbers",
            where=f"line {best.line + 1}",
            hint="put the columns' names in the first line, or name the fields of the log block "
            "by their numbers: 1, 2, …",
        )
    return best


def _takes_turns(
    rows: Sequence[str], separator: str, components: Sequence[tuple[int, int, int]]
) -> bool:
    """Whether a table is of streams with times of their own; see `request.takes_turns`."""
    if separator == " ":
        return False
    cells = [split_cells(line, separator) for line in rows[:_SEARCHED_ROWS] if line.strip()]
    filled = [
        [sum(c < len(r) and r[c] != "" for c in three) for r in cells] for three in components
    ]
    return bool(cells) and takes_turns(np.array(filled))


def _factors(
    signal: Signal, columns: Sequence[tuple[str | None, str]], request: Request
) -> tuple[float, float, float]:
    """Factors of a signal's x, y, z; columns : the unit that the header states, and its cell."""
    if signal.unit is None or signal.quantity == "temperature":
        return signal.factors
    one = {_unit(signal.quantity, signal.unit, unit, request, cell) for unit, cell in columns}
    if len(one) > 1:
        raise DataError(
            f"the {signal.quantity} of {signal.support} is in different units",
            hint="record x, y and z in one unit",
        )
    factor = math.copysign(one.pop(), signal.factors[0])
    return factor, factor, factor


def _units_row(lines: Sequence[str], header: Head, columns: Sequence[int]) -> dict[int, str]:
    """Return the units by column where the line below the header is a row of units."""
    if header.line + 1 >= len(lines):
        return {}
    cells = [c.strip("[]() ") for c in split_cells(lines[header.line + 1], header.separator)]
    if not fits_header(cells, header.cells) or not columns:
        return {}
    stated = {c: cells[c] for c in columns if cells[c]}
    if not stated or not all(is_unit(unit) for unit in stated.values()):
        return {}
    return stated


def _unit(
    quantity: Quantity, declared: str, stated: str | None, request: Request, cell: str
) -> float:
    """Return the factor to SI of a column whose header states a unit, or states none."""
    if stated is None or canonical(stated) == canonical(declared):
        return UNITS[quantity][canonical(declared)]
    factor = unit_factor(quantity, stated)
    if request.declared or factor is None:
        raise DataError(
            f"column {cell!r} is in {stated}, the mapping says {declared}",
            hint=f"state the unit of the {quantity} in the log block of rig.yaml"
            if factor is not None
            else f"record the {quantity} in one of {', '.join(UNITS[quantity])}",
            fields=(cell, split_label(cell)[0]),
        )
    return factor
