"""TwinCAT Scope's text exports: a column `Name` is the time in ms of the channels behind it.

Below the channels' names stand rows of metadata, each with its own name in the columns of time,
then a blank line, then the samples. Channels sampled alike share one column of time or repeat it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tdfscal.errors import DataError
from tdfscal.logs.text.numbers import number_in

TIME: Final = "time"
"""What the first column of time is called here; the file calls it Name."""
END: Final = b"EOF"
"""What an export's last line may say."""
_METADATA: Final = frozenset(
    {"SymbolComment", "Data-Type", "SampleTime[ms]", "VariableSize", "SymbolBased", "SymbolName"}
    | {"IndexGroup", "IndexOffset", "NetID", "Port", "Offset", "ScaleFactor", "BitMask", "Unit"}
    | {"Unit ScaleFactor", "Unit Offset"}
)


@dataclass(frozen=True, slots=True)
class ScopeTable:
    """Shape of an export.

    line : of the channels' names, from 0. lines : that come before the first sample. names : of
    the columns. units : as stated, by column; ms of the time.
    """

    separator: str
    line: int
    lines: int
    names: tuple[str, ...]
    units: dict[int, str]


def scope_table(lines: Sequence[str]) -> ScopeTable | None:
    """Recognise an export by the metadata below its channels' names; None for any other table.

    Raises DataError where its channels are sampled at different times.
    """
    for number, line in enumerate(lines[:-1]):
        for separator in (";", "\t", ",", ":"):
            cells = _cells(line, separator)
            below = _cells(lines[number + 1], separator)
            if cells[0] == "Name" and len(cells) > 2 and below[0] in _METADATA:
                return _table(lines, number, separator, cells)
    return None


def _table(lines: Sequence[str], number: int, separator: str, cells: list[str]) -> ScopeTable:
    clocks = [k for k, cell in enumerate(cells) if cell == "Name"]
    names = list(cells)
    for count, k in enumerate(clocks, 1):
        names[k] = TIME if count == 1 else f"{TIME} {count}"
    units = dict.fromkeys(clocks, "ms")
    first = number + 1
    while first < len(lines):
        row = _cells(lines[first], separator)
        if row[0] and row[0] not in _METADATA:
            break
        first += 1
        if row[0] == "Unit":
            stated = {k: unit.partition(" (")[0] for k, unit in enumerate(row) if k not in clocks}
            units |= {k: unit for k, unit in stated.items() if unit not in ("", "(None)")}
    for k, line in enumerate(lines[first:], first + 1):
        _refuse_different_clocks(cells, _cells(line, separator), clocks, f"line {k}")
    return ScopeTable(separator, number, first, tuple(names), units)


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
    return [cell.strip().strip('"') for cell in line.split(separator)]
