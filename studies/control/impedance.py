"""Impedance of the terminal: M ẍ + B ẋ + K (x − x_d) = F_e − F_d in six dimensions (Sect. 5).

x is the pose of the centre of compliance, a point of the terminal: three translations and three
rotations, in the axes of the reference LCS. Held forces are integrated exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.control.terminal import exponential
from tdfscal.errors import UsageError
from tdfscal.records import FloatArray


@dataclass(frozen=True, slots=True)
class Impedance:
    """Virtual mass, damping and stiffness: translations along x, y, z, rotations about x, y, z.

    mass : kg, kg·m². damping : N·s/m, N·m·s/rad. stiffness : N/m, N·m/rad. centre : (3,), m,
    LCS, the centre of compliance. The defaults are `stability.designed` of the reference rig.
    """

    mass: tuple[float, ...] = (500.0, 500.0, 500.0, 72.0, 72.0, 72.0)
    damping: tuple[float, ...] = (3.3e4, 3.3e4, 3.3e4, 9.9e3, 9.9e3, 9.9e3)
    stiffness: tuple[float, ...] = (1.0e4, 1.0e4, 1.0e4, 3.0e3, 3.0e3, 3.0e3)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.5)

    def __post_init__(self) -> None:
        for name in ("mass", "damping", "stiffness"):
            value = getattr(self, name)
            if len(value) != 6 or not all(0.0 < v < np.inf for v in value):
                raise UsageError(
                    f"the impedance's {name} is {value}", hint="give six numbers above zero"
                )


def transition(impedance: Impedance, step: float) -> tuple[FloatArray, FloatArray]:
    """State (6, 2, 2) and drive (6, 2) of an exact step (s) of M d̈ + B ḋ + K d = g, g held.

    Per axis (d, ḋ) ← state (d, ḋ) + drive · g, of the deviation d = x − x_d and its rate.
    """
    M, B, K = (np.array(v) for v in (impedance.mass, impedance.damping, impedance.stiffness))
    A = np.zeros((6, 3, 3))
    A[:, 0, 1] = step
    A[:, 1, 0], A[:, 1, 1], A[:, 1, 2] = -K / M * step, -B / M * step, step / M
    whole = exponential(A)
    return whole[:, :2, :2], whole[:, :2, 2]
