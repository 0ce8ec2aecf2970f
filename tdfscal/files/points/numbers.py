"""Numbers and length units as point files write them, and what a number's last digit is worth."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NoReturn

from tdfscal.errors import DataError
from tdfscal.files.field_types import LARGEST

_NUMBER = re.compile(r"[+-]?(?:\d+\.?(\d*)|\.(\d+))(?:e([+-]?\d+))?", re.IGNORECASE)
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
_SPELLINGS = {
    "m": ("m", "meter", "meters", "metre", "metres"),
    "cm": ("cm", "centimeter", "centimeters", "centimetre", "centimetres"),
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "um": ("um", "µm", "μm", "micron", "microns", "micrometer", "micrometre"),
    "in": ("in", "inch", "inches", '"'),
}
SPELLINGS = {spelling: unit for unit, all_of in _SPELLINGS.items() for spelling in all_of}
"""Every spelling of a unit that is known, and which of METRES it means."""


def refuse(where: str, what: str, hint: str) -> NoReturn:
    """Raise DataError: where a file is at fault, what is wrong, what to do."""
    raise DataError(what, where=where, hint=hint)


def as_number(cell: str, *, comma: bool = False) -> float | None:
    """Return the number of a cell; None where it is none, or no length. comma : decimal comma."""
    text = _plain(cell, comma)
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if abs(value) <= LARGEST else None


def last_digit(cells: Iterable[str], *, comma: bool = False) -> float:
    """Return the worth of the last digit of the most finely written of these numbers; 0 of none."""
    worth = [_last(_plain(cell, comma)) for cell in cells]
    return min((w for w in worth if w > 0), default=0.0)


def to_metres(unit: str, where: str) -> float:
    """Return the factor from `unit`, however spelt, to m; DataError where it is no length unit."""
    known = unit_of(unit)
    if known is None:
        what = f"`{unit.strip()}` is not a length unit known here"
        refuse(where, what, f"use one of {', '.join(METRES)}")
    return METRES[known]


def unit_of(text: str) -> str | None:
    """Return which of METRES a spelling means; None of another word."""
    return SPELLINGS.get(text.strip().lower().rstrip("."))


def _plain(cell: str, comma: bool) -> str:
    return cell.replace(",", ".") if comma and cell.count(",") == 1 and "." not in cell else cell


def _last(text: str) -> float:
    number = _NUMBER.fullmatch(text)
    if number is None:
        return 0.0
    decimals = len(number[1] or number[2] or "")
    return float(10.0 ** (int(number[3] or 0) - decimals))
