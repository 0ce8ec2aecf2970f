"""Where a text log's table begins, whatever is wanted of it: separator, names, first row.

TwinCAT Scope's exports have a shape of their own: a column `Name` is the time in ms of the channels
behind it; below the names stand rows of metadata, each with its own name in the columns of time,
then a blank line, then the samples. Channels sampled alike share one column of time or repeat it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from tdfscal.errors import DataError
from tdfscal.logs.date_times import is_date_time
from tdfscal.logs.text.cells import (
    fits_header,
    header_cells,
    is_number,
    number_in,
    split_cells,
    split_label,
)

SEPARATORS: Final = (",", ";", "\t", " ")
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


@dataclass(frozen=True, slots=True)
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
        for separator in (";", "\t", ",", ":", " "):
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
