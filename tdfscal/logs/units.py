"""Units that a log may be recorded in, and their factors to SI."""

from __future__ import annotations

from typing import Final, Literal

Quantity = Literal["position", "force", "time"]

_FACTORS: Final[dict[Quantity, dict[str, float]]] = {
    "position": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "force": {"N": 1.0, "kN": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
_SPELLINGS: Final[dict[str, str]] = {
    "µm": "um",
    "μm": "um",
    "µs": "us",
    "μs": "us",
    "sec": "s",
}
# Units that recorders write and that are none of ours: naming one is a disagreement, not a name.
_FOREIGN: Final[frozenset[str]] = frozenset(
    {"in", "inch", "ft", "cm", "dm", "km", "mil", "lbf", "lb", "kp", "kgf", "gf", "mN", "MN", "dN"}
    | {"daN", "V", "mV", "mV/V", "A", "deg", "rad", "g", "kg", "h", "min", "counts", "raw", "%"}
)


def known_units(quantity: Quantity) -> tuple[str, ...]:
    """Units that can be declared for a quantity."""
    return tuple(_FACTORS[quantity])


def measures(quantity: Quantity, unit: str) -> bool:
    """Tell whether a unit is one of `known_units`, however it is spelt."""
    return canonical(unit) in _FACTORS[quantity]


def factor(quantity: Quantity, unit: str) -> float:
    """Return the factor to SI of a unit that `measures` the quantity."""
    return _FACTORS[quantity][canonical(unit)]


def canonical(unit: str) -> str:
    """Return the one spelling of a unit: µm and um are the same."""
    stripped = unit.strip()
    return _SPELLINGS.get(stripped, stripped)


def is_unit(text: str) -> bool:
    """Tell whether a text is a unit of measurement, ours or another."""
    unit = canonical(text)
    return unit in _FOREIGN or any(unit in table for table in _FACTORS.values())
