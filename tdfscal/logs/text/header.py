"""Where a text log's table begins: its separator, its header line, its columns and units."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from tdfscal.errors import DataError
from tdfscal.logs.common import units
from tdfscal.logs.common.request import Request, Signal, check_fields_differ, missing_fields
from tdfscal.logs.text.date_times import is_date_time
from tdfscal.logs.text.numbers import is_number, is_number_of_either
from tdfscal.logs.text.scope import scope_table

SEPARATORS = (",", ";", "\t", " ")
"""What may stand between cells; a space stands for any run of spaces."""
_SEARCHED_LINES = 64
_SEARCHED_ROWS = 256
_BRACKETS = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")
_REMARK = "#%/"
"""With what a line of remarks begins, and the header's in what numpy and MATLAB write."""
_NO_CELLS = frozenset({"", "Comment"})
"""Names at the header's end that rows may leave without a cell; the second is LabVIEW's."""


@dataclass(frozen=True, slots=True)
class Header:
    """How to read the table.

    lines : how many lines of the file come before the first row.
    columns : how many cells a row has: as many as names, but for a separator at the end of one of
    the two; a cell without a name is empty in every row.
    time : column of the time; None where rows are postures and the file has no time.
    dated : the time is written as date and time of day.
    components : per signal, the columns of x, y, z.
    factors : per signal, to SI and tdfscal's sign; 1 where the mapping states a scale.
    time_factor : to s.
    sparse : streams take turns: a row holds the cells of some signals, those of others are empty.
    ends : the last line may say EOF.
    """

    separator: str
    lines: int
    columns: int
    names: tuple[str, ...]
    time: int | None
    dated: bool
    components: tuple[tuple[int, int, int], ...]
    factors: tuple[float, ...]
    time_factor: float
    sparse: bool = False
    ends: bool = False

    @property
    def wanted(self) -> tuple[int, ...]:
        """Columns to read: x, y, z of each signal in turn, then the time."""
        time = () if self.time is None else (self.time,)
        return (*(column for three in self.components for column in three), *time)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A line that may be the header; named: how many of the wanted names it holds."""

    line: int
    separator: str
    cells: tuple[str, ...]
    named: int


def find_header(text: str, request: Request, *, where: str) -> Header:
    """Find the header line and resolve the wanted fields to columns.

    The line that holds most of the wanted names is the header, whatever comes before it. Columns
    of a table without one are named by their numbers, from 1.

    Parameters
    ----------
    text : the file's first lines.

    Raises
    ------
    DataError : no header, missing or duplicate columns, a unit that contradicts the mapping.
    """
    check_fields_differ(request, where=where)
    lines = text.splitlines()
    names = [name for signal in request.signals for name in signal.components]
    wanted = {request.time_field, *names}
    scope = scope_table(lines[:_SEARCHED_LINES], where)
    best = _best_line(lines[:_SEARCHED_LINES], wanted, request.decimal)
    if scope is not None:
        named = len(wanted & set(scope.names))
        best = _Candidate(scope.line, scope.separator, scope.names, named)
    if best is None:
        raise DataError("the file is empty", where=where, hint="record the log again")
    if scope is None and all(name.isdecimal() for name in names):
        best = numbered_columns(lines, request.decimal) or best
    elif best.named == 0 and all(is_number_of_either(c) for c in best.cells):
        raise DataError(
            "there is no header line; the first line holds numbers",
            where=f"{where}, line {best.line + 1}",
            hint="put the columns' names in the first line, or name the fields of the log block "
            "by their numbers: 1, 2, …",
        )
    here = f"{where}, line {max(best.line, 0) + 1}"
    labels = [split_label(cell, wanted) for cell in best.cells]
    column_of = _columns(labels, names, request, here)
    if scope is not None:
        row_units, above = scope.units, scope.lines
    else:
        row_units = _units_row(lines, best, [column_of[n] for n in wanted & column_of.keys()])
        above = best.line + 1 + (1 if row_units else 0)
    stated = [unit if unit is not None else row_units.get(c) for c, (_, unit) in enumerate(labels)]
    time = column_of.get(request.time_field)
    first = next((line for line in lines[above:] if line.strip()), "")
    opening = split_cells(first, best.separator)
    dated = time is not None and time < len(opening) and is_date_time(opening[time])
    components = [
        (column_of[x], column_of[y], column_of[z])
        for x, y, z in (signal.components for signal in request.signals)
    ]
    return Header(
        separator=best.separator,
        lines=above,
        columns=row_cells(lines[above:], best.separator, best.cells),
        names=best.cells,
        time=time,
        dated=dated,
        components=tuple(components),
        factors=tuple(
            _factor(signal, [stated[c] for c in three], [best.cells[c] for c in three],
                    request, here)
            for signal, three in zip(request.signals, components, strict=True)
        ),
        time_factor=1.0
        if time is None or dated
        else _unit("time", request.time_unit, stated[time], request, best.cells[time], here),
        ends=scope is not None,
        sparse=time is not None and _takes_turns(lines[above:], best.separator, components),
    )  # fmt: skip


def _takes_turns(
    rows: Sequence[str], separator: str, components: Sequence[tuple[int, int, int]]
) -> bool:
    """Whether one of the first rows has all cells of some signals and none of another.

    So a table is written of streams with times of their own. A table of whole rows has no holes.
    """
    if separator == " ":
        return False
    for line in rows[:_SEARCHED_ROWS]:
        cells = split_cells(line, separator)
        filled = {sum(c < len(cells) and cells[c] != "" for c in three) for three in components}
        if filled == {0, 3}:
            return True
    return False


def _columns(
    labels: Sequence[tuple[str, str | None]], names: Sequence[str], request: Request, where: str
) -> dict[str, int]:
    """Column of each wanted name; raises DataError where one is missing, or is there twice."""
    by_name: dict[str, list[int]] = {}
    for column, (name, _) in enumerate(labels):
        by_name.setdefault(name, []).append(column)
    optional = {request.time_field} if request.rows == "postures" else set()
    wanted = dict.fromkeys([request.time_field, *names])
    missing = [n for n in wanted if n not in by_name and n not in optional]
    if missing:
        raise missing_fields(missing, (cut(n) for n, _ in labels if n), where=where, kind="column")
    for name in wanted:
        if len(by_name.get(name, ())) > 1:
            raise DataError(
                f"column {name} is there {len(by_name[name])} times",
                where=where,
                hint="give each column its own name",
            )
    return {name: columns[0] for name, columns in by_name.items()}


def _factor(
    signal: Signal, stated: Sequence[str | None], cells: Sequence[str], request: Request, where: str
) -> float:
    """Return the factor of x, y, z of a signal to SI and tdfscal's sign."""
    if signal.quantity == "temperature" or signal.scale is not None:
        return 1.0
    one = {
        _unit(signal.quantity, signal.unit, unit, request, cell, where)
        for unit, cell in zip(stated, cells, strict=True)
    }
    if len(one) > 1:
        raise DataError(
            f"the {signal.quantity} of {signal.support} is in different units",
            where=where,
            hint="record x, y and z in one unit",
        )
    return one.pop() * (-1.0 if signal.factor < 0.0 else 1.0)


def numbered_columns(lines: Sequence[str], decimal: str) -> _Candidate | None:
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
                return _Candidate(number - 1, separator, names, 0)
    return None


def _best_line(lines: Sequence[str], wanted: set[str], decimal: str) -> _Candidate | None:
    best: _Candidate | None = None
    for number, line in enumerate(lines):
        if not line.strip():
            continue
        for separator in SEPARATORS:
            if separator == decimal:
                continue
            cells = header_cells(line, separator)
            named = len(wanted & {split_label(cell, wanted)[0] for cell in cells})
            candidate = _Candidate(number, separator, tuple(cells), named)
            if (
                best is None
                or named > best.named
                or (best.named == 0 and number == best.line and len(cells) > len(best.cells))
            ):
                best = candidate
    return best


def row_cells(rows: Sequence[str], separator: str, header: Sequence[str]) -> int:
    """How many cells the rows below a header have, going by the first of them."""
    for line in rows:
        if line.strip():
            cells = split_cells(line, separator)
            return len(cells) if fits_header(cells, header) else len(header)
    return len(header)


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


def cut(text: str, limit: int = 40) -> str:
    """Shorten what is quoted of a file."""
    return text if len(text) <= limit else text[: limit - 1] + "…"


def split_cells(line: str, separator: str) -> list[str]:
    """Split one line into its cells, without quotes and outer spaces."""
    if separator == " " and '"' not in line:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
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
    if match is None:
        return cell, None
    unit = match["square"] if match["square"] is not None else match["round"]
    is_unit = units.is_unit(unit)
    name = cell if cell in wanted or not is_unit else match["name"].strip().strip('"')
    return name, unit.strip() if is_unit else None


def _units_row(lines: Sequence[str], header: _Candidate, columns: Sequence[int]) -> dict[int, str]:
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
    quantity: units.Quantity,
    declared: str,
    stated: str | None,
    request: Request,
    cell: str,
    where: str,
) -> float:
    """Return the factor to SI of a column whose header states a unit, or states none."""
    factor = units.factor(quantity, declared)
    if factor is None:
        raise ValueError(declared)
    if stated is None or units.canonical(stated) == units.canonical(declared):
        return factor
    own = units.factor(quantity, stated)
    if own is None or request.declared:
        raise DataError(
            f"column {cell!r} is in {stated}, the mapping says {declared}",
            where=where,
            hint=f"state the unit of the {quantity} in the log block of rig.yaml"
            if own is not None
            else f"record the {quantity} in one of {', '.join(units.known_units(quantity))}",
        )
    return own
