"""Cells of one line of a text log, and what a column's label says."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence

from tdfscal.logs.common import units

_BRACKETS = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))")
_REMARK = "#%/"
"""With what a line of remarks begins, and the header's in what numpy and MATLAB write."""
_NO_CELLS = frozenset({"", "Comment"})
"""Names at the header's end that rows may leave without a cell; the second is LabVIEW's."""


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
