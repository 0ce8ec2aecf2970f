"""Every unit that a log may state."""

from __future__ import annotations

from typing import Final, Literal

Quantity = Literal["position", "force", "time"]

UNITS: Final[dict[Quantity, dict[str, float]]] = {
    "position": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "force": {"N": 1.0, "kN": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Units that can be declared, and their factors to SI."""
_SPELLINGS: Final = {"µm": "um", "μm": "um", "µs": "us", "μs": "us", "sec": "s"}
FOREIGN: Final[dict[Quantity, dict[str, float]]] = {
    "position": {"cm": 1e-2, "dm": 1e-1, "km": 1e3, "ft": 0.3048, "mil": 2.54e-5}
    | dict.fromkeys(("in", "inch"), 0.0254),
    "force": {"mN": 1e-3, "dN": 0.1, "daN": 10.0, "MN": 1e6, "gf": 9.80665e-3}
    | dict.fromkeys(("kp", "kgf", "kg"), 9.80665)
    | dict.fromkeys(("lbf", "lb"), 4.4482216152605),
}
"""Units that recorders write and that are none of ours, by the scale of the rig file for each."""
# Naming one is a disagreement too, and not a name.
_OTHERS: Final = frozenset(
    ("V", "mV", "mV/V", "A", "deg", "rad", "g", "h", "min", "counts", "raw", "%")
)


def canonical(unit: str) -> str:
    """Return the one spelling of a unit: µm and um are the same."""
    return _SPELLINGS.get(unit.strip(), unit.strip())


def unit_factor(quantity: Quantity, unit: str) -> float | None:
    """Return the factor to SI of a unit however it is spelt; None where it is none of `UNITS`."""
    return UNITS[quantity].get(canonical(unit))


def is_unit(text: str) -> bool:
    """Tell whether a text is a unit of measurement, ours or another."""
    unit = canonical(text)
    tables = (_OTHERS, *UNITS.values(), *FOREIGN.values())
    return any(unit in table for table in tables)


def by_scale(quantity: Quantity, unit: str) -> str | None:
    """Return how a rig file states a unit that it does not know by name; None of one unknown."""
    factor = FOREIGN.get(quantity, {}).get(unit.strip())
    if factor is None:
        return None
    line = f"{quantity}_scale: {factor:.14g}"
    return f"write `{line}` beside the {quantity} fields of each support in the log block"
