"""Where a text log's table begins: its separator, its header line, its columns and units."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from tdfscal.errors import DataError
from tdfscal.logs.common import units
from tdfscal.logs.common.request import Request, check_fields_differ, missing_fields

SEPARATORS = (",", ";", "\t")
_SEARCHED_LINES = 64
_NUMBER = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*")
_BRACKETS = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")


@dataclass(frozen=True, slots=True)
class Header:
    """How to read the table.

    lines : how many lines of the file come before the first row.
    columns : how many cells a row has: as many as names, but for a separator at the end of one of
    the two; a cell without a name is empty in every row.
    time : column of the time; None where rows are postures and the file has no time.
    components : per signal, the columns of x, y, z.
    factors : per signal, to SI and tdfscal's sign. time_factor : to s.
    """

    separator: str
    lines: int
    columns: int
    names: tuple[str, ...]
    time: int | None
    components: tuple[tuple[int, int, int], ...]
    factors: tuple[float, ...]
    time_factor: float

    @property
    def wanted(self) -> tuple[int, ...]:
        """Columns to read: x, y, z of each signal in turn, then the time."""
        time = () if self.time is None else (self.time,)
        return (*(column for three in self.components for column in three), *time)


@dataclass(frozen=True, slots=True)
class _Candidate:
    line: int
    separator: str
    cells: tuple[str, ...]
    found: int


def find_header(text: str, request: Request, *, where: str) -> Header:
    """Find the header line and resolve the wanted fields to columns.

    The line that holds most of the wanted names is the header, whatever comes before it.

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
    best = _best_line(lines[:_SEARCHED_LINES], wanted, request.decimal)
    if best is None:
        raise DataError("the file is empty", where=where, hint="record the log again")
    if best.found == 0 and all(_NUMBER.fullmatch(c) for c in best.cells):
        raise DataError(
            "there is no header line; the first line holds numbers",
            where=f"{where}, line {best.line + 1}",
            hint="put the columns' names in the first line",
        )
    here = f"{where}, line {best.line + 1}"
    labels = [split_label(cell, wanted) for cell in best.cells]
    by_name: dict[str, list[int]] = {}
    for column, (name, _) in enumerate(labels):
        by_name.setdefault(name, []).append(column)
    optional = {request.time_field} if request.rows == "postures" else set()
    missing = [n for n in dict.fromkeys([request.time_field, *names]) if n not in by_name]
    missing = [n for n in missing if n not in optional]
    if missing:
        raise missing_fields(missing, (cut(n) for n, _ in labels if n), where=here, kind="column")
    for name in wanted & by_name.keys():
        if len(by_name[name]) > 1:
            raise DataError(
                f"column {name} is there {len(by_name[name])} times",
                where=here,
                hint="give each column its own name",
            )
    column_of = {name: columns[0] for name, columns in by_name.items()}
    row_units = _units_row(lines, best, [column_of[n] for n in wanted & by_name.keys()])
    stated = [unit if unit is not None else row_units.get(c) for c, (_, unit) in enumerate(labels)]
    time = column_of.get(request.time_field)
    components = []
    factors = []
    for signal in request.signals:
        x, y, z = (column_of[name] for name in signal.components)
        components.append((x, y, z))
        if signal.quantity == "temperature":
            factors.append(1.0)
            continue
        one = {_unit(signal.quantity, signal.unit, stated[c], request, best.cells[c], here)
               for c in (x, y, z)}  # fmt: skip
        if len(one) > 1:
            raise DataError(
                f"the {signal.quantity} of {signal.support} is in different units",
                where=here,
                hint="record x, y and z in one unit",
            )
        sign = -1.0 if signal.factor < 0.0 else 1.0
        factors.append(sign * one.pop())
    above = best.line + 1 + (1 if row_units else 0)
    return Header(
        separator=best.separator,
        lines=above,
        columns=row_cells(lines[above:], best.separator, best.cells),
        names=best.cells,
        time=time,
        components=tuple(components),
        factors=tuple(factors),
        time_factor=1.0
        if time is None
        else _unit("time", request.time_unit, stated[time], request, best.cells[time], here),
    )


def _best_line(lines: Sequence[str], wanted: set[str], decimal: str) -> _Candidate | None:
    best: _Candidate | None = None
    for number, line in enumerate(lines):
        if not line.strip():
            continue
        for separator in SEPARATORS:
            if separator == decimal:
                continue
            cells = split_cells(line, separator)
            found = len(wanted & {split_label(cell, wanted)[0] for cell in cells})
            candidate = _Candidate(number, separator, tuple(cells), found)
            if (
                best is None
                or found > best.found
                or (best.found == 0 and number == best.line and len(cells) > len(best.cells))
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
            return not header[-1]
    return False


def cut(text: str, limit: int = 40) -> str:
    """Shorten what is quoted of a file."""
    return text if len(text) <= limit else text[: limit - 1] + "…"


def split_cells(line: str, separator: str) -> list[str]:
    """Split one line into its cells, without quotes and outer spaces."""
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return [line]
    return [cell.strip() for cell in cells]


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
