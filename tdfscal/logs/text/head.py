"""Cells of a line of a text log, and where its table begins: separator, names, first row.

TwinCAT Scope's exports have a shape of their own: a column `Name` is the time in ms of the channels
behind it; below the names stand rows of metadata, each with its own name in the columns of time,
then a blank line, then the samples. Channels sampled alike share one column of time or repeat it.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final, Literal

from tdfscal.errors import DataError
from tdfscal.files.units import is_unit
from tdfscal.frozen import field, record
from tdfscal.logs.table import is_date_time

_BRACKETS = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")
_REMARK = "#%/"
"""With what a line of remarks begins, and the header's in what numpy and MATLAB write."""
_NO_CELLS = frozenset({"", "Comment"})
"""Names at the header's end that rows may leave without a cell; the second is LabVIEW's."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_EITHER = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*")
_SWAPPED = str.maketrans(".,", ",.")

Decimal = Literal[".", ","]


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
    known = is_unit(unit)
    name = cell if cell in wanted or not known else match["name"].strip().strip('"')
    return name, unit.strip() if known else None


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


def decimal_of(cells: Iterable[str], separator: str) -> Decimal:
    """Return the decimal of a log by its cells, where no rig file states it."""
    comma = separator != "," and any(_WITH_COMMA.fullmatch(cell) for cell in cells)
    return "," if comma else "."


def number_in(cell: str, decimal: str) -> float | None:
    """Return the finite number that a cell holds; None where it holds none."""
    plain = cell.translate(_SWAPPED) if decimal == "," else cell
    if _NUMBER.fullmatch(plain) and math.isfinite(value := float(plain)):
        return value
    return None


def is_number(cell: str, decimal: str) -> bool:
    """Tell whether a cell is a number, be it none that a log may hold."""
    plain = cell.replace(",", ".") if decimal == "," else cell
    return "," not in plain and bool(_EITHER.fullmatch(plain) or plain.lower() in ("nan", "inf"))


def is_number_of_either(cell: str) -> bool:
    """Tell whether a cell is a number with whichever decimal."""
    return bool(_EITHER.fullmatch(cell))


def advice(cell: str, decimal: str) -> str:
    """Say what to do about a cell that holds no finite number."""
    swapped = cell.replace(",", ".") if decimal == "." else cell
    if swapped != cell and _NUMBER.fullmatch(swapped):
        return 'state `decimal: ","` in the log block of rig.yaml if the comma is the decimal'
    if decimal == "," and _NUMBER.fullmatch(cell):
        return 'the mapping says `decimal: ","`; take it out if the point is the decimal'
    return "each cell must be a finite number"


SEPARATORS: Final = (",", ";", "\t", "|", " ")
"""What may stand between cells; a space stands for any run of spaces."""
SEARCHED: Final = 64
"""Lines among which a header is looked for."""
END: Final = b"EOF"
"""What an export of TwinCAT Scope may end with."""
_TIME: Final = "time"  # what an export's first column of time is called here; it says Name
_METADATA: Final = frozenset(
    {"SymbolComment", "Data-Type", "SampleTime[ms]", "VariableSize", "SymbolBased", "SymbolName"}
    | {"IndexGroup", "IndexOffset", "NetID", "Port", "Offset", "ScaleFactor", "BitMask", "Unit"}
    | {"Unit ScaleFactor", "Unit Offset"}
)


@record
class Head:
    """A line that may hold the names of a table's columns.

    line : its number from 0; -1 where the columns are named by their numbers. cells : the names,
    as they stand there. named : how many of the wanted names are among them. scope : it is of an
    export of TwinCAT Scope, with so many lines before the first sample, and these units by column.
    """

    line: int
    separator: str
    cells: tuple[str, ...]
    named: int = 0
    scope: bool = False
    lines: int = 0
    units: Mapping[int, str] = field(default_factory=dict)


def best_line(lines: Sequence[str], wanted: Collection[str], decimal: str) -> Head | None:
    """The line that holds most of the wanted names, whatever comes before it."""
    found = []
    for number, line in enumerate(lines[:SEARCHED]):
        for separator in SEPARATORS if line.strip() else ():
            if separator != decimal:
                cells = header_cells(line, separator)
                named = len({split_label(cell, wanted)[0] for cell in cells} & set(wanted))
                found.append(Head(number, separator, tuple(cells), named))
    # Where no line holds a wanted name, it is the first, at the separator that parts it most.
    return max(
        found, key=lambda c: (c.named, -c.line, 0 if c.named else len(c.cells)), default=None
    )


def numbered_columns(lines: Sequence[str], decimal: str) -> Head | None:
    """The table of a file without a header, its columns named from 1; None where there is none.

    It begins with the first line whose cells are all numbers, but for a date and time.
    """
    for number, line in enumerate(lines[:SEARCHED]):
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
                return Head(number - 1, separator, names)
    return None


def line_above_rows(lines: Sequence[str]) -> Head:
    """The first line of names above most lines.

    Raises DataError where there is no table, or its header has other cells than its rows.
    """
    best: Head | None = None
    fault: DataError | None = None
    for separator in SEPARATORS:
        if separator == " " and best is not None:
            continue  # spaces stand within names, too
        split = [split_cells(line, separator) for line in lines[:SEARCHED]]
        widths = [len(cells) for cells in split if len(cells) > 1]
        if not widths:
            continue
        width = max(set(widths), key=widths.count)
        number = next(k for k, cells in enumerate(split) if len(cells) == width)
        if _has_number(split[number]):
            # Recorders end their rows with a separator, or the header, and the other not.
            number -= 1
            above = header_cells(lines[number], separator) if number >= 0 else []
            if abs(len(above) - width) > 1 or _has_number(above):
                continue
            if not fits_header(split[number + 1], above):
                where = f"line {number + 2}"
                fault = fault or ragged(width, len(above)).restated(where=where)
                continue
        # Commas within numbers make columns too; the header has none of them then.
        if best is None or width > len(best.cells):
            best = Head(number, separator, tuple(header_cells(lines[number], separator)))
    if best is None and fault is not None:
        raise fault
    for decimal in ".,":
        numbered = numbered_columns(lines, decimal)
        if numbered is not None and (best is None or len(numbered.cells) > len(best.cells)):
            return numbered
    if best is None:
        raise DataError(
            "there is no table of numbers",
            hint="export the recording as a table, with the columns' names in the first line",
        )
    return best


def units_below(
    lines: Sequence[str], head: Head, columns: Sequence[int] | None = None
) -> dict[int, str] | None:
    """Units by column where the line below the header is a row of units; None where it is none.

    columns : that have to hold units, or nothing; where they are not known, no cell is a number.
    """
    row = split_cells(lines[head.line + 1], head.separator) if head.line + 1 < len(lines) else []
    row = [cell.strip("[]() ") for cell in row]
    if not fits_header(row, head.cells) or (columns is None and _has_number(row)):
        return None
    stated = {k: row[k] for k in columns or range(len(row)) if row[k]}
    found = {k: unit for k, unit in stated.items() if is_unit(unit)}
    return None if columns is not None and len(found) < len(stated) else found


def ragged(cells: int, expected: int, above: str = "the header") -> DataError:
    """Build the error for a line with another number of cells than what is above it."""
    return DataError(
        f"the line has {cells} cells, {above} {expected}",
        hint="the file may be cut short or damaged there; record or export it again",
    )


def _has_number(cells: Sequence[str]) -> bool:
    return any(is_number(c, d) for c in cells for d in ".,")


def scope_head(lines: Sequence[str]) -> Head | None:
    """Recognise an export of TwinCAT Scope by its metadata; None for any other table.

    Raises DataError where its channels are sampled at different times.
    """
    for number, line in enumerate(lines[: SEARCHED - 1]):
        for separator in (";", "\t", ",", ":", "|", " "):
            cells = _cells(line, separator)
            if cells[0] != "Name" or len(cells) < 3 or number + 1 == len(lines):
                continue
            if _cells(lines[number + 1], separator)[0] in _METADATA:
                return _scope(lines[:SEARCHED], number, separator, cells)
    return None


def _scope(lines: Sequence[str], number: int, separator: str, cells: list[str]) -> Head:
    clocks = [k for k, cell in enumerate(cells) if cell == "Name"]
    names = list(cells)
    for count, k in enumerate(clocks, 1):
        names[k] = _TIME if count == 1 else f"{_TIME} {count}"
    units = dict.fromkeys(clocks, "ms")
    first = number + 1
    while first < len(lines):
        row = _cells(lines[first], separator)
        if row[0] and row[0] not in _METADATA:
            break
        first += 1
        if row[0] == "Unit" and len(row) == len(cells):  # between spaces an empty one is none
            stated = {k: unit.partition(" (")[0] for k, unit in enumerate(row) if k not in clocks}
            units |= {k: unit for k, unit in stated.items() if unit not in ("", "(None)")}
    for k, line in enumerate(lines[first:], first + 1):
        _refuse_different_clocks(cells, _cells(line, separator), clocks, f"line {k}")
    return Head(number, separator, tuple(names), scope=True, lines=first, units=units)


def _refuse_different_clocks(
    names: Sequence[str], row: Sequence[str], clocks: Sequence[int], where: str
) -> None:
    """Refuse a sample whose channels have different times: only the first column is read."""
    times: dict[float | None, str] = {}
    for k in clocks:
        if k + 1 < min(len(row), len(names)):
            times.setdefault(number_in(row[k].replace(",", "."), "."), names[k + 1])
    if len(times) > 1:
        shown = {name: "no time" if t is None else f"{t:g} ms" for t, name in times.items()}
        listed = ", ".join(f"{name} at {time}" for name, time in list(shown.items())[:4])
        raise DataError(
            f"the channels are sampled at different times: {listed}",
            where=where,
            hint="export the channels of each sample time to a file of its own",
        )


def _cells(line: str, separator: str) -> list[str]:
    cells = line.split() or [""] if separator == " " else line.split(separator)
    return [cell.strip().strip('"') for cell in cells]
