"""What was taken as exact, and what a typical error of it would do to the angles."""

from __future__ import annotations

import numpy as np

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import ExactQuantityResult
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.layout import Table

#: Sensors beside each other in a table: 80 letters hold so many.
_BESIDE = 3
_SCALE = {"rad": (1e3, "mrad"), "m": (1e3, "mm"), "relative": (100.0, "%"), "of it": (100.0, "%")}
_CAPTION = (
    "Taken as exact, in no uncertainty: what a typical error would do to roll/pitch/yaw, mrad"
)


def exact_tables(c: Calibration) -> tuple[Table, ...]:
    """One row per quantity: effect on roll, pitch, yaw of each sensor, mrad."""
    if not c.taken_as_exact:
        return ()
    names = [support.name for support in c.taken_as_exact[0].supports]
    return tuple(
        Table(
            _CAPTION if first == 0 else "",
            ("", *names[first : first + _BESIDE]),
            tuple(
                (
                    f"{quantity.name}, {_error(quantity)}",
                    *("/".join(f"{1e3 * value:.2f}" for value in row)
                      for row in _effects(quantity)[first : first + _BESIDE]),
                )
                for quantity in c.taken_as_exact
            ),
        )
        for first in range(0, len(names), _BESIDE)
    )  # fmt: skip


def exact_claim(c: Calibration) -> str:
    """The largest effect, in a sentence; nothing where nothing is taken as exact."""
    if not c.taken_as_exact:
        return ""
    largest = max(c.taken_as_exact, key=lambda quantity: float(_effects(quantity).max()))
    effects = _effects(largest)
    i, j = np.unravel_index(int(effects.argmax()), effects.shape)
    return (
        f"Taken as exact, and in no uncertainty, is first of all the {largest.name}: "
        f"{_error(largest)} would move {ANGLES[j]} of {largest.supports[i].name} by "
        f"{1e3 * effects[i, j]:.2g} mrad."
    )


def _effects(quantity: ExactQuantityResult) -> FloatArray:
    """Effects (n, 3), rad, on roll, pitch, yaw; of the turns where these are not separable."""
    return np.array([s.turn if s.rpy is None else s.rpy for s in quantity.supports])


def _error(quantity: ExactQuantityResult) -> str:
    scale, unit = _SCALE.get(quantity.unit, (1.0, quantity.unit))
    return f"{scale * quantity.error:g} {unit}"
