"""Length units as point files write them."""

from __future__ import annotations

from tdfscal.errors import DataError

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


def to_metres(unit: str, where: str) -> float:
    """Return the factor from `unit`, however spelt, to m; DataError where it is no length unit."""
    try:
        return METRES[SPELLINGS[unit.strip().lower().rstrip(".")]]
    except KeyError:
        raise DataError(
            f"`{unit.strip()}` is not a length unit known here",
            where=where,
            hint=f"use one of {', '.join(METRES)}",
        ) from None
