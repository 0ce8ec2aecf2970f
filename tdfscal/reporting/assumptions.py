"""What a calibration takes as exact or as well known, and what an error of it would do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tdfscal.catalogue.numbers import quantity, rounded
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import ExactQuantityResult
from tdfscal.records import FloatArray
from tdfscal.reporting.layout import Table

#: What may be taken as exact, and the key of the rig file that states how well it is known.
STATED_BY = {
    "NCP repeatability": "uncertainty.positioner",
    "hinge drawing": "uncertainty.hinge",
    "servo datums": "uncertainty.datum",
    "gain, crosstalk": "uncertainty.force_sensitivity",
    "friction of the hinges": "uncertainty.hinge_moment",
    "base level": "gravity.tilt_std",
    "mass": "terminal.mass.std",
    "barycentre": "terminal.barycenter.std",
    "zeros": "zero.std",
    "delay": "log.delay.std",
    "body against axes": "tracker.misalignment",
    "target drawing": "tracker.drawing",
}
_CAPTION = "What a typical error of each quantity taken as exact would do to roll/pitch/yaw, mrad"
_UNITS = {"rad": (1e3, "mrad"), "m": (1e3, "mm"), "s": (1e3, "ms"), "relative": (100.0, "%"),
          "of it": (100.0, "%")}  # fmt: skip
#: Quantities named in one sentence, and the share of the half width from which on they are.
_NAMED, _NOTABLE = 3, 0.1


def exact_names(c: Calibration) -> list[str]:
    """Quantities that the rig file states without uncertainty: the result has none of theirs.

    Those of which a typical error is worked out come first, the worst before the others.
    """
    terminal = c.rig.terminal
    block = {name: key for name, key in STATED_BY.items() if key.startswith("uncertainty.")}
    exact = [
        name
        for name, key in block.items()
        if getattr(c.rig.uncertainty, key.removeprefix("uncertainty.")) == 0
    ]
    if c.method == "tracker":
        return exact
    stated: dict[str, Any] = {"mass": terminal.mass.std, "barycentre": terminal.barycenter.std}
    stated |= {f"zero of {s.name}": s.zero.std for s in c.rig.supports}
    stated["base level"] = c.rig.gravity.tilt_std
    exact += [name for name, std in stated.items() if not np.any(std)]
    return list(dict.fromkeys([*(q.name for q in _by_effect(c)), *exact]))


def assumption_sentences(c: Calibration, half_width: float) -> str:
    """What the headline's number does not count, with what a typical error of each would do.

    half_width : rad, of the angles' intervals; what is small against it is not named, nor what adds
    little to those that exceed it.
    """
    more, every = exceeding(c, half_width), _by_effect(c)
    named = more or [q for q in every if _effects(q).max() > _NOTABLE * half_width]
    moves = [
        f"{_typical_error(q)} in the {q.name} by {rounded(1e3 * _effects(q).max())} mrad"
        for q in named[:_NAMED]
    ]
    said = ""
    if moves:
        said = f"Not counted (exact in the rig file): {_moving(moves)}"
        said = said.replace("gain, crosstalk", "gain and crosstalk")
        if len(more) > 1:
            said += f", together by {rounded(1e3 * _together(every))} mrad"
        said += ", which is more. " if more else ". "
    if trusted := _trusted(c, half_width):
        said += f"Stated, not measured: {_moving(trusted)}."
    return said.strip()


def _moving(moves: Sequence[str]) -> str:
    said = f"{', '.join(moves)}".replace(" in ", " of error in ", 1)
    return said.replace(" by ", " would move an angle by ", 1)


def _trusted(c: Calibration, half_width: float) -> list[str]:
    """What an error of typical size does of what is stated to be better, as a tare that is none.

    Linear, and so by the budget: errors of all components of a group add in squares.
    """
    if c.budget is None or c.method == "tracker":
        return []
    terminal, parts = c.rig.terminal, []
    stated = {
        "zero": ("tare", 1.0, "N", [std for s in c.rig.supports for std in s.zero.std]),
        "barycentre": ("barycentre", 1e-3, "m", list(terminal.barycenter.std)),
        "mass": ("mass", 1e-3 * terminal.mass.value, "kg", [terminal.mass.std]),
    }
    for source, (name, error, unit, std) in stated.items():
        variance = max((angle.variance.get(source, 0.0) for angle in c.budget.angles), default=0.0)
        move = math.sqrt(variance) * error / std[0] if 0 < max(std) < error else 0.0
        if min(std) == max(std) and move > _NOTABLE * half_width:
            parts.append(f"{quantity(error, unit)} in the {name} by {rounded(1e3 * move)} mrad")
    return parts


def exceeding(c: Calibration, half_width: float) -> list[ExactQuantityResult]:
    """Quantities taken as exact of which typical errors together move an angle by more.

    half_width : rad, of the angles' intervals. The worst first; the others together do not.
    """
    each = _by_effect(c)
    if _together(each) <= half_width:
        return []
    enough = (
        k for k in range(len(each) + 1) if _together(each[k:]) <= half_width < _together(each[:k])
    )
    return each[: next(enough)]


def _together(quantities: Sequence[ExactQuantityResult]) -> float:
    """Largest move of an angle, rad, by typical errors of all, which are independent."""
    return float(np.sqrt(np.sum([_effects(q) ** 2 for q in quantities], axis=0)).max(initial=0.0))


def _by_effect(c: Calibration) -> list[ExactQuantityResult]:
    """Quantities taken as exact, the one whose typical error moves an angle most first."""
    return sorted(c.taken_as_exact, key=lambda q: -float(_effects(q).max()))


def exact_table(c: Calibration) -> tuple[Table, ...]:
    """One row per quantity: effect on roll, pitch, yaw of each sensor, mrad."""
    names = [support.name for q in c.taken_as_exact[:1] for support in q.supports]
    rows = tuple(
        (
            f"{quantity.name}, {_typical_error(quantity)}",
            *("/".join(f"{1e3 * v:.2f}" for v in row) for row in _effects(quantity)),
        )
        for quantity in _by_effect(c)
    )
    return (Table(_CAPTION, ("", *names), rows),) if rows else ()


def _effects(quantity: ExactQuantityResult) -> FloatArray:
    """Effects (n, 3), rad, on roll, pitch, yaw; of the turns where these are not separable."""
    return np.array([s.turn if s.rpy is None else s.rpy for s in quantity.supports])


def _typical_error(quantity: ExactQuantityResult) -> str:
    """The error of each component, in a unit that reads well."""
    scale, unit = _UNITS.get(quantity.unit, (1.0, quantity.unit))
    return f"{scale * quantity.error:g} {unit}"
