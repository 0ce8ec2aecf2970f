"""Numbers in the cells of a text log: with a decimal point or a decimal comma."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Literal

Decimal = Literal[".", ","]

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_EITHER = re.compile(r"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*")
_SWAPPED = str.maketrans(".,", ",.")


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
