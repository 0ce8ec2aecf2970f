"""Cells of one line of a text log: names with units, numbers with a decimal point or comma."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Iterable, Sequence
from typing import Literal

from tdfscal.logs.request import is_unit

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
