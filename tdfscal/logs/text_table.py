"""Where the table of a text begins, what parts its cells, and its wanted columns with their units.

The header is the line above the widest rows of numbers, whatever stands before it; where wanted
names are known, the one that holds most of them. Columns without a header are named 1, 2, ….
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Sequence
from itertools import takewhile
from typing import Final

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import UNITS, Dimension, by_scale, canonical, is_unit, unit_factor
from tdfscal.frozen import record
from tdfscal.logs.log_file import Request, Signal, placed
from tdfscal.logs.table import Wanted, columns_of, has_zone, is_date_time, takes_turns

SEARCHED: Final = 64
"""Lines among which a header is looked for."""
_SEARCHED_ROWS: Final = 256
_SEPARATORS: Final = (",", ";", "\t", "|", " ")
"""What may part cells; a space stands for any run of spaces."""
_REMARK: Final = "#%/"
"""With what a line of remarks begins, and the header's in what numpy and MATLAB write."""
_NO_CELLS: Final = frozenset({"", "Comment"})
"""Names at the header's end that rows may leave without a cell; the second is LabVIEW's."""
_BRACKETS = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")
_EITHER = re.compile(r"(?i)\s*[+-]?((\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?|nan|inf)\s*")


@record
class Table:
    """A table of a text.

    lines : before its first row. names : of the columns, as they stand in the header, or numbers.
    below : cells of a row of units, none without one. width : cells of a row, as many as names, but
    for a separator at the end of one of the two.
    """

    separator: str
    lines: int
    names: tuple[str, ...]
    below: tuple[str, ...]
    width: int

    def labels(self, wanted: Collection[str] = ()) -> list[tuple[str, str | None]]:
        """Name and stated unit of each column; wanted : names that may have brackets themselves."""
        below = (*self.below, *[""] * len(self.names))
        labels = (split_label(cell, wanted) for cell in self.names)
        return [
            (name, unit or row or None) for (name, unit), row in zip(labels, below, strict=False)
        ]


def find_table(lines: Sequence[str], wanted: Collection[str] = ()) -> Table:
    """Find the table among the first lines of a text; wanted : names of columns, where known.

    Raises DataError where there is none, or its rows have other cells than its header.
    """
    headed: list[tuple[tuple[int, ...], Table]] = []
    fault: DataError | None = None
    for separator in _SEPARATORS:
        if separator == " " and headed:
            continue  # spaces stand within names, too
        found, ragged_at = _headed(lines[:SEARCHED], separator, wanted)
        headed += found
        fault = fault or ragged_at
    bare = table_of_numbers(lines)
    if bare is not None and sum(name.isdecimal() for name in wanted) >= max(len(wanted) - 1, 1):
        return bare
    rank, best = max(headed, key=lambda one: one[0], default=((0,), None))
    if best is not None and (bare is None or rank[0] or len(best.names) >= bare.width):
        return best
    if fault is not None or bare is None:
        hint = "export the recording as a table, with the columns' names in the first line"
        raise fault or DataError("there is no table of numbers", hint=hint)
    return bare


def table_of_numbers(lines: Sequence[str]) -> Table | None:
    """The widest table without a header; it begins where all cells are numbers, but for a date."""
    found = []
    for separator in _SEPARATORS:
        for number, line in enumerate(lines[:SEARCHED]):
            cells = split_cells(line, separator)
            others = [cell for cell in cells if not is_number(cell)]
            if len(cells) > 1 and len(others) < 2 and all(map(is_date_time, others)):
                names = tuple(str(k + 1) for k in range(len(cells)))
                found.append(Table(separator, number, names, (), len(cells)))
                break
    return max(found, key=lambda table: table.width, default=None)


def _headed(
    lines: Sequence[str], separator: str, wanted: Collection[str]
) -> tuple[list[tuple[tuple[int, ...], Table]], DataError | None]:
    """Lines of names above rows of numbers, each with its rank; the first whose rows are ragged."""
    found: list[tuple[tuple[int, ...], Table]] = []
    fault: DataError | None = None
    there = [(k, split_cells(line, separator)) for k, line in enumerate(lines) if line.strip()]
    for place, (number, cells) in enumerate(there):
        names, begin, rows = header_cells(lines[number], separator), number + 1, there[place + 1 :]
        held = len({split_label(cell, wanted)[0] for cell in names} & set(wanted))
        if len(cells) < 2 or any(map(is_number, names)):
            continue
        below = _units(rows[0][1], names) if rows else ()
        if below:
            begin, rows = rows[0][0] + 1, rows[1:]
        width = len(names)
        if rows and fits_header(rows[0][1], names):
            width = len(rows[0][1])
        elif rows and not held:
            if abs(len(rows[0][1]) - width) == 1 and any(map(is_number, rows[0][1])):
                where = f"line {rows[0][0] + 1}"
                fault = fault or ragged(len(rows[0][1]), width).restated(where=where)
            continue
        numbers = list(takewhile(lambda row: any(map(is_number, row[1])), rows))
        if rows and not numbers and not held:
            continue
        # What comes first where wanted names are there: no row below it may be passed over.
        size = (-number,) if held else (len(names), len(numbers), -number)
        table = Table(separator, begin, tuple(names), below, width)
        found.append(((held, min(len(rows), 1), *size), table))
    return found, fault


def _units(cells: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """The cells of a row of units; none of any other."""
    stated = tuple(cell.strip("[]() ") for cell in cells)
    is_row = fits_header(cells, names) and not any(map(is_number, cells))
    return stated if is_row and any(map(is_unit, stated)) else ()


def split_cells(line: str, separator: str) -> list[str]:
    """Split one line into its cells, without quotes and outer spaces."""
    if '"' not in line:
        return line.split() if separator == " " else [c.strip() for c in line.split(separator)]
    try:
        cells = next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return [line]
    return [cell.strip() for cell in cells]


def header_cells(line: str, separator: str) -> list[str]:
    """Split a header: without the mark of a remark before it, units with their names."""
    cells = split_cells(line, separator)
    if cells and cells[0][:1] in _REMARK:
        cells[0] = cells[0].lstrip(_REMARK).strip()
        if not cells[0] and len(cells) > 1 and separator == " ":
            del cells[0]
    if separator != " ":
        return cells
    joined: list[str] = []
    for cell in cells:
        if joined and cell[:1] in "[(" and cell[-1:] in "])":
            joined[-1] += f" {cell}"
        else:
            joined.append(cell)
    return joined


def split_label(cell: str, wanted: Collection[str] = ()) -> tuple[str, str | None]:
    """Split `Fx1 [N]` into name and unit; a name may itself be given with its brackets."""
    match = _BRACKETS.fullmatch(cell)
    unit = None if match is None else (match["square"] or match["round"] or "")
    if match is None or unit is None or not is_unit(unit):
        return cell, None
    return cell if cell in wanted else match["name"].strip().strip('"'), unit.strip()


def fits_header(cells: Sequence[str], header: Sequence[str]) -> bool:
    """Tell whether a row is as wide as the header, but for a separator at the end of one of them.

    Recorders write such separators in the rows only, or above them only.
    """
    match len(cells) - len(header):
        case 0:
            return True
        case 1:
            return not cells[-1]
        case -1:
            return header[-1] in _NO_CELLS
    return False


def is_number(cell: str) -> bool:
    """Tell whether a cell is a number, with whichever decimal, be it none that a log may hold."""
    return bool(_EITHER.fullmatch(cell))


def ragged(cells: int, expected: int, above: str = "the header") -> DataError:
    """Build the error for a line with another number of cells than what is above it."""
    return DataError(
        f"the line has {cells} cells, {above} {expected}",
        hint="the file may be cut short or damaged there; record or export it again",
    )


def find_columns(lines: Sequence[str], request: Request) -> tuple[Table, Wanted]:
    """Find the table among the file's first lines, and in it the wanted fields, by their places.

    Raises DataError where columns are missing or repeated, or a unit contradicts the mapping.
    """
    mapping = request.mapping
    names = {name for signal in request.signals for name in signal.components}
    table = find_table(lines, names | {mapping.time.field})
    rows = [line for line in lines[table.lines :] if line.strip()][:_SEARCHED_ROWS]
    cells = [split_cells(row, table.separator) for row in rows]
    zoned, second, signals = None, 1.0, list[tuple[tuple[str, ...], tuple[float, float, float]]]()
    with placed(f"line {max(table.lines - bool(table.below), 1)}"):
        labels = table.labels(names | {mapping.time.field})
        column_of = columns_of(request, [name for name, _ in labels])
        for signal in request.signals:
            three = [column_of[name] for name in signal.components]
            factors = _factors(signal, [(labels[c][1], table.names[c]) for c in three], request)
            signals.append((tuple(map(str, three)), factors))
        time = column_of.get(mapping.time.field)
        if time is not None:
            first = cells[0][time] if cells and time < len(cells[0]) else ""
            dated = is_date_time(first)
            zoned, stated = (has_zone(first), None) if dated else (None, labels[time][1])
            unit = _unit("time", mapping.time.unit, stated, request, table.names[time])
            second = 1.0 if dated else unit
    turns = False
    if time is not None and table.separator != " " and cells:
        wanted = [int(c) for three, _ in signals for c in three]
        there = [[c < len(row) and row[c] != "" for c in wanted] for row in cells]
        turns = takes_turns(np.array(there).reshape(len(cells), -1, 3).sum(axis=2).T)
    name = None if time is None else str(time)
    return table, Wanted(tuple(signals), name, second, zoned, turns)


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


def _unit(
    quantity: Dimension, declared: str, stated: str | None, request: Request, cell: str
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
            else by_scale(quantity, stated)
            or f"record the {quantity} in one of {', '.join(UNITS[quantity])}",
        )
    return factor
