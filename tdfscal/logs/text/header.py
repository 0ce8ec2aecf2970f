"""Where a text log's table begins: its separator, its header line, its columns and units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError
from tdfscal.logs.common import units
from tdfscal.logs.common.damage import placed
from tdfscal.logs.common.request import Request, Signal, columns_of, takes_turns
from tdfscal.logs.text.cells import (
    fits_header,
    header_cells,
    row_cells,
    split_cells,
    split_label,
)
from tdfscal.logs.text.date_times import has_zone, is_date_time
from tdfscal.logs.text.numbers import is_number, is_number_of_either
from tdfscal.logs.text.scope import ScopeTable, scope_table

SEPARATORS = (",", ";", "\t", " ")
"""What may stand between cells; a space stands for any run of spaces."""
_SEARCHED_LINES = 64
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


@dataclass(frozen=True, slots=True)
class Candidate:
    """A line that may be the header; named: how many of the wanted names it holds."""

    line: int
    separator: str
    cells: tuple[str, ...]
    named: int = 0


def find_header(lines: Sequence[str], request: Request) -> Header:
    """Find the header line among the file's first, and resolve the wanted fields to columns.

    The line that holds most of the wanted names is the header, whatever comes before it. Columns
    of a table without one are named by their numbers, from 1.

    Raises DataError where columns are missing or repeated, or a unit contradicts the mapping.
    """
    names = [name for signal in request.signals for name in signal.components]
    wanted = {request.mapping.time_field, *names}
    scope, best = _head(lines, names, wanted, request.mapping.decimal)
    with placed(f"line {max(best.line, 0) + 1}"):
        labels = [split_label(cell, wanted) for cell in best.cells]
        column_of = columns_of(request, [name for name, _ in labels])
        if scope is not None:
            row_units, above = scope.units, scope.lines
        else:
            row_units = _units_row(lines, best, list(column_of.values()))
            above = best.line + 1 + (1 if row_units else 0)
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
        ends=scope is not None,
        sparse=time is not None and _takes_turns(lines[above:], best.separator, components),
    )


def _head(
    lines: Sequence[str], names: Sequence[str], wanted: set[str], decimal: str
) -> tuple[ScopeTable | None, Candidate]:
    """The line of the columns' names; and the shape of a TwinCAT Scope export, if it is one."""
    scope = scope_table(lines[:_SEARCHED_LINES])
    if scope is not None:
        return scope, Candidate(scope.line, scope.separator, scope.names)
    best = _best_line(lines[:_SEARCHED_LINES], wanted, decimal)
    if best is None:
        raise DataError("the file is empty", hint="record the log again")
    if all(name.isdecimal() for name in names):
        best = numbered_columns(lines, decimal) or best
    elif best.named == 0 and all(is_number_of_either(c) for c in best.cells):
        raise DataError(
            "there is no header line; the first line holds numbers",
            where=f"line {best.line + 1}",
            hint="put the columns' names in the first line, or name the fields of the log block "
            "by their numbers: 1, 2, …",
        )
    return None, best


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


def numbered_columns(lines: Sequence[str], decimal: str) -> Candidate | None:
    """The table of a file without a header, its columns named from 1; None where there is none.

    It begins with the first line whose cells are all numbers, but for a date and time.
    """
    for number, line in enumerate(lines[:_SEARCHED_LINES]):
        for separator in SEPARATORS:
            cells = split_cells(line, separator)
            numbers = sum(is_number(c, decimal) for c in cells)
            if (
                separator != decimal
                and len(cells) > 1
                and numbers >= len(cells) - 1 > 0
                and all(is_number(c, decimal) or is_date_time(c) for c in cells)
            ):
                names = tuple(str(k + 1) for k in range(len(cells)))
                return Candidate(number - 1, separator, names)
    return None


def _best_line(lines: Sequence[str], wanted: set[str], decimal: str) -> Candidate | None:
    found = []
    for number, line in enumerate(lines):
        for separator in SEPARATORS if line.strip() else ():
            if separator != decimal:
                cells = header_cells(line, separator)
                named = len(wanted & {split_label(cell, wanted)[0] for cell in cells})
                found.append(Candidate(number, separator, tuple(cells), named))

    # Where no line holds a wanted name, it is the first, at the separator that parts it most.
    return max(
        found, key=lambda c: (c.named, -c.line, 0 if c.named else len(c.cells)), default=None
    )


def _units_row(lines: Sequence[str], header: Candidate, columns: Sequence[int]) -> dict[int, str]:
    """Return the units by column where the line below the header is a row of units."""
    if header.line + 1 >= len(lines):
        return {}
    cells = [c.strip("[]() ") for c in split_cells(lines[header.line + 1], header.separator)]
    if not fits_header(cells, header.cells) or not columns:
        return {}
    stated = {c: cells[c] for c in columns if cells[c]}
    if not stated or not all(units.is_unit(unit) for unit in stated.values()):
        return {}
    return stated


def _unit(
    quantity: units.Quantity, declared: str, stated: str | None, request: Request, cell: str
) -> float:
    """Return the factor to SI of a column whose header states a unit, or states none."""
    if stated is None or units.canonical(stated) == units.canonical(declared):
        return units.factor(quantity, declared)
    known = units.measures(quantity, stated)
    if request.declared or not known:
        raise DataError(
            f"column {cell!r} is in {stated}, the mapping says {declared}",
            hint=f"state the unit of the {quantity} in the log block of rig.yaml"
            if known
            else f"record the {quantity} in one of {', '.join(units.known_units(quantity))}",
            fields=(cell, split_label(cell)[0]),
        )
    return units.factor(quantity, stated)
