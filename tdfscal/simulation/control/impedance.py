"""Impedance of the terminal: M ẍ + B ẋ + K (x − x_d) = F_e − F_d in six dimensions (Sect. 5).

x is the pose of the centre of compliance, a point of the terminal: three translations and three
rotations, in the axes of the reference LCS. Held forces are integrated exactly, so that a step is
limited by contact alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray


@dataclass(frozen=True, slots=True)
class Impedance:
    """Virtual mass, damping and stiffness: translations along x, y, z, rotations about x, y, z.

    mass : kg, kg·m². damping : N·s/m, N·m·s/rad. stiffness : N/m, N·m/rad. centre : (3,), m,
    LCS, the centre of compliance.
    """

    mass: tuple[float, ...] = (80.0, 80.0, 80.0, 24.0, 24.0, 24.0)
    damping: tuple[float, ...] = (8.0e3, 8.0e3, 8.0e3, 2.4e3, 2.4e3, 2.4e3)
    stiffness: tuple[float, ...] = (1.0e4, 1.0e4, 1.0e4, 3.0e3, 3.0e3, 3.0e3)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.5)

    def __post_init__(self) -> None:
        for name in ("mass", "damping", "stiffness"):
            value = getattr(self, name)
            if len(value) != 6 or not all(0.0 < v < np.inf for v in value):
                raise UsageError(
                    f"the impedance's {name} is {value}", hint="give six numbers above zero"
                )


@dataclass(frozen=True, slots=True)
class Transition:
    """One step of the deviation d = x − x_d and its rate under a constant drive, per axis.

    state : (6, 2, 2), drive : (6, 2): (d, ḋ) ← state (d, ḋ) + drive · g.
    """

    state: FloatArray
    drive: FloatArray

    def step(self, deviation: FloatArray, g: FloatArray) -> FloatArray:
        """Next deviation and rate (L, 6, 2) under g (L, 6), N and N·m."""
        moved = (self.state @ deviation[..., None])[..., 0]
        return np.asarray(moved + self.drive * g[..., None])


def transition(impedance: Impedance, step: float) -> Transition:
    """Exact transition over `step` (s) of M d̈ + B ḋ + K d = g, g held."""
    M, B, K = (np.array(v) for v in (impedance.mass, impedance.damping, impedance.stiffness))
    A = np.zeros((6, 3, 3))
    A[:, 0, 1] = step
    A[:, 1, 0], A[:, 1, 1], A[:, 1, 2] = -K / M * step, -B / M * step, step / M
    whole = _exponential(A)
    return Transition(whole[:, :2, :2], whole[:, :2, 2])


def _exponential(A: FloatArray) -> FloatArray:
    """Matrix exponential by scaling and squaring."""
    halvings = max(0, int(np.ceil(np.log2(max(float(np.abs(A).sum(axis=-1).max()), 1e-300)))) + 2)
    A = A / 2.0**halvings
    out = term = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    for k in range(1, 16):
        term = term @ A / k
        out = out + term
    for _ in range(halvings):
        out = out @ out
    return np.asarray(out)


def contact_radius(
    impedance: Impedance,
    stiffness: FloatArray,
    lag: float,
    step: float,
    held: int,
    gain: float = 1.0,
) -> float:
    """Spectral radius per sample of the loop closed over a surrounding of `stiffness`; < 1: stable.

    stiffness : (6, 6), N/m … N·m/rad, about the centre of compliance. lag : time constant of the
    servos, s. held : steps for which a force sample is held; it acts in the step after it.
    gain : of the force filter.
    """
    one = transition(impedance, step)
    I, O = np.eye(6), np.zeros((6, 6))  # noqa: E741
    d11, d12, d21, d22 = (np.diag(one.state[:, a, b]) for a in (0, 1) for b in (0, 1))
    g1, g2 = np.diag(one.drive[:, 0]), np.diag(one.drive[:, 1])
    a = 1.0 - np.exp(-step / lag) if lag > 0.0 else 1.0
    # (d, ḋ, q, F): the force of the last sample drives the deviation, the servo q follows it.
    go = np.block(
        [
            [d11, d12, O, g1],
            [d21, d22, O, g2],
            [a * d11, a * d12, (1 - a) * I, a * g1],
            [O, O, O, I],
        ]
    )
    sample = np.block(
        [[I, O, O, O], [O, I, O, O], [O, O, I, O], [O, O, -gain * stiffness, (1 - gain) * I]]
    )
    return float(np.abs(np.linalg.eigvals(np.linalg.matrix_power(go, held) @ sample)).max())


def require_stable(
    impedance: Impedance,
    stiffness: FloatArray,
    lag: float,
    step: float,
    held: int,
    gain: float = 1.0,
) -> None:
    """Refuse a loop that shakes itself up in contact. Raises UsageError."""
    radius = contact_radius(impedance, stiffness, lag, step, held, gain)
    if radius >= 1.0:
        filtered = f", filtered with a gain of {gain:.2g}," if gain < 1.0 else ""
        raise UsageError(
            f"the impedance is unstable in contact: with a force sample every "
            f"{1e3 * step * held:g} ms{filtered} and servos of {1e3 * lag:.3g} ms, oscillations "
            f"grow by {100 * (radius - 1):.2g} % per sample",
            hint="raise the damping, sample faster, filter less, or make servos faster",
        )
