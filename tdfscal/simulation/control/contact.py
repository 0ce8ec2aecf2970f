"""A toothed shaft entering a bore: unilateral, compliant contact with friction.

Coordinates of the shaft in the bore: q = (x, y, depth, θx, θy, ψ), the tip's centre and a small
rotation vector, in the bore's frame (z into the bore, origin in the middle of its mouth). All
elastic forces are −∂V/∂q of one potential, so that contact without friction conserves energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray

_TEETH = 8
#: A shaft that touches the mouth's edge does so with all its stiffness from this depth on, m.
_EDGE = 0.01


@dataclass(frozen=True)
class GearPair:
    """Inner gear (shaft) and outer gear (bore).

    radius : m, of both, about. clearance : m, radial. twist : rad, free play about the axis.
    length : m, engagement, at which the shoulder seats. chamfer : m, axial length of the lead-in;
    chamfer_angle : rad, against the axis. stiffness : N/m of one tooth across, mostly that of the
    outer gear on its pedestal. seat_stiffness : N/m of the shoulder, axial. friction : Coulomb's
    coefficient. slip : m/s, at which friction reaches 71 % of it. tip : (3,), m, LCS.
    """

    radius: float = 0.1
    clearance: float = 5.0e-5
    twist: float = 2.0e-4
    length: float = 1.0 / 3.0
    chamfer: float = 3.0e-3
    chamfer_angle: float = np.pi / 6
    stiffness: float = 1.0e5
    seat_stiffness: float = 2.0e5
    friction: float = 0.15
    slip: float = 5.0e-4
    tip: tuple[float, float, float] = (0.0, 0.0, 0.5)

    def __post_init__(self) -> None:
        positive = ("radius", "clearance", "twist", "length", "chamfer", "stiffness", "slip")
        for name in (*positive, "seat_stiffness"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise UsageError(f"the gears' {name} is {getattr(self, name)}", hint="above zero")
        if not self.friction >= 0.0 or not 0.0 < self.chamfer_angle < np.pi / 2:
            raise UsageError("the gears' friction or chamfer angle makes no sense")
        if not self.chamfer < self.length:
            raise UsageError("the lead-in is longer than the engagement")

    @property
    def capture(self) -> float:
        """Lateral misalignment that the lead-in still catches, m."""
        return self.clearance + self.chamfer * float(np.tan(self.chamfer_angle))

    @property
    def tilt(self) -> float:
        """Largest tilt that the clearance allows when seated, rad."""
        return 2.0 * self.clearance / self.length

    def stiffness_at_mouth_and_tip(self, centre: tuple[float, ...]) -> FloatArray:
        """(6, 6), the stiffest that contact can be, about a point of the LCS (m): at full depth,
        in touch at tip, mouth, teeth and shoulder.
        """
        out = np.zeros((6, 6))
        k, ring = self.stiffness, self.seat_stiffness * self.radius**2 / 2
        for back in (0.0, self.length):
            z = self.tip[2] - back - centre[2]
            for axis, way in ((0, (0.0, z)), (1, (-z, 0.0))):
                row = np.zeros(6)
                row[axis], row[3], row[4] = 1.0, way[0], way[1]
                out += k * np.outer(row, row)
        out[2, 2] += self.seat_stiffness
        out[[3, 4], [3, 4]] += ring
        out[5, 5] += self.stiffness * self.radius**2
        return out

    @cached_property
    def _rim(self) -> FloatArray:
        """Directions of the teeth, (2, J)."""
        angle = 2.0 * np.pi * np.arange(_TEETH) / _TEETH
        return np.array([np.cos(angle), np.sin(angle)])

    @cached_property
    def _rise(self) -> FloatArray:
        """Depth of each tooth by tilt, (2, J), m: r (e_y, −e_x)."""
        return np.asarray(self.radius * np.array([self._rim[1], -self._rim[0]]))

    def wrench(self, q: FloatArray, rate: FloatArray | None = None) -> FloatArray:
        """Force and moment about the tip, (L, 6), on the shaft, bore's frame, at q (L, 6).

        rate : (L, 6), q̇, for friction; None for none.
        """
        if q[:, 2].max() < -self.radius * np.abs(q[:, 3:5]).sum(axis=1).max():
            return np.zeros_like(q)
        out = np.zeros_like(q)
        tip = self._tip(q, out)
        mouth = self._mouth(q, out)
        seat = self._seat(q, out)
        flank = self._flanks(q, out)
        if rate is not None and self.friction > 0.0:
            zero = np.zeros(len(q))
            self._rub(out, rate, zero, *tip)
            if mouth is not None:
                self._rub(out, rate, self.chamfer - q[:, 2], *mouth)
            if seat is not None:
                self._rub(out, rate, zero - self.length, *seat)
            v = rate[:, 2]
            out[:, 2] -= self.friction * flank * v / np.sqrt(v * v + self.slip**2)
        return out

    def _tip(self, q: FloatArray, out: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Teeth at the tip: on the bore's face, its lead-in or its wall, whichever is nearest."""
        tan, cos = np.tan(self.chamfer_angle), np.cos(self.chamfer_angle)
        k, face = self.stiffness, self.seat_stiffness / _TEETH
        wall = q[:, :2] @ self._rim - self.clearance
        depth = q[:, 2:3] + q[:, 3:5] @ self._rise
        cone = (wall - (self.chamfer - depth) * tan) * cos
        inside = (wall > 0.0) & (cone > 0.0) & (depth > 0.0)
        by_wall = inside & (wall <= cone)
        by_cone = inside & ~by_wall
        by_face = inside & (face * depth**2 < k * np.minimum(wall, cone) ** 2)
        by_wall &= ~by_face
        by_cone &= ~by_face
        radial = k * (by_wall * wall + by_cone * (cone * cos))
        axial = by_face * (face * depth) + by_cone * (k * tan * cos * cone)
        out[:, :2] -= radial @ self._rim.T
        out[:, 2] -= axial.sum(axis=1)
        out[:, 3:5] -= axial @ self._rise.T
        return radial, axial

    def _mouth(self, q: FloatArray, out: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The bore's edge on the shaft's flank, behind the tip."""
        back = q[:, 2] - self.chamfer
        if back.max() <= 0.0:
            return None
        share = np.clip(back / _EDGE, 0.0, 1.0)[:, None]
        lean = np.stack([q[:, 4], -q[:, 3]], axis=1)
        gap = np.maximum((q[:, :2] - back[:, None] * lean) @ self._rim - self.clearance, 0.0)
        radial = self.stiffness * share * gap
        out[:, :2] -= radial @ self._rim.T
        out[:, 3:5] -= (back[:, None] / self.radius) * (radial @ self._rise.T)
        grows = (share < 1.0) * (share > 0.0) * (0.5 * self.stiffness / _EDGE) * gap**2
        axial = grows - radial * (lean @ self._rim)
        out[:, 2] -= axial.sum(axis=1)
        return radial, axial

    def _seat(self, q: FloatArray, out: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The shoulder on the bore's face."""
        if q[:, 2].max() < self.length - 0.1 * self.radius:
            return None
        pressed = np.maximum(q[:, 2:3] + q[:, 3:5] @ self._rise - self.length, 0.0)
        axial = self.seat_stiffness / _TEETH * pressed
        out[:, 2] -= axial.sum(axis=1)
        out[:, 3:5] -= axial @ self._rise.T
        return np.zeros_like(axial), axial

    def _flanks(self, q: FloatArray, out: FloatArray) -> FloatArray:
        """Twist of the teeth against each other; returns their normal force (L,), N."""
        depth, psi = q[:, 2], q[:, 5]
        k, face = self.stiffness * self.radius**2, self.seat_stiffness
        slope = (depth < self.chamfer) * np.tan(self.chamfer_angle) / self.radius
        over = np.abs(psi) - self.twist - slope * (self.chamfer - depth)
        inside = (over > 0.0) & (depth > 0.0)
        by_face = inside & (face * depth**2 < k * over**2)
        torque = k * np.where(inside & ~by_face, over, 0.0)
        out[:, 5] -= torque * np.sign(psi)
        out[:, 2] -= torque * slope + np.where(by_face, face * depth, 0.0)
        return np.asarray(torque / self.radius)

    def _rub(
        self,
        out: FloatArray,
        rate: FloatArray,
        along: FloatArray,
        radial: FloatArray,
        axial: FloatArray,
    ) -> None:
        """Regularised Coulomb friction of teeth at `along` (L,), m, on the shaft's axis."""
        normal = np.sqrt(radial * radial + axial * axial)
        if not normal.any():
            return
        ex, ey = self._rim
        r, w, s = self.radius, rate[:, 3:], along[:, None]
        vx = rate[:, :1] + w[:, 1:2] * s - w[:, 2:] * (r * ey)
        vy = rate[:, 1:2] - w[:, :1] * s + w[:, 2:] * (r * ex)
        vz = rate[:, 2:3] + w[:, :2] @ self._rise
        # Without the part along the normal (radial e, axial).
        unit = 1.0 / np.maximum(normal, 1e-300)
        nx, ny, nz = radial * unit * ex, radial * unit * ey, axial * unit
        across = vx * nx + vy * ny + vz * nz
        vx, vy, vz = vx - across * nx, vy - across * ny, vz - across * nz
        drag = -self.friction * normal / np.sqrt(vx * vx + vy * vy + vz * vz + self.slip**2)
        fx, fy, fz = drag * vx, drag * vy, drag * vz
        out[:, 0] += fx.sum(axis=1)
        out[:, 1] += fy.sum(axis=1)
        out[:, 2] += fz.sum(axis=1)
        out[:, 3] += (r * ey * fz - s * fy).sum(axis=1)
        out[:, 4] += (s * fx - r * ex * fz).sum(axis=1)
        out[:, 5] += (r * ex * fy - r * ey * fx).sum(axis=1)


@dataclass(frozen=True, slots=True)
class Bore:
    """Where the outer gear really is: rotation (..., 3, 3), bore → BCS; place (..., 3), m, BCS."""

    rotation: FloatArray
    place: FloatArray

    def coordinates(self, tip: FloatArray, R: FloatArray) -> FloatArray:
        """Q (L, 6) of a shaft with its tip at (L, 3), m, BCS, and rotation R (L, 3, 3)."""
        back = np.swapaxes(self.rotation, -1, -2)
        turn = back @ R
        q = np.empty((len(tip), 6))
        q[:, :3] = (back @ (tip - self.place)[..., None])[..., 0]
        q[:, 3] = 0.5 * (turn[:, 2, 1] - turn[:, 1, 2])
        q[:, 4] = 0.5 * (turn[:, 0, 2] - turn[:, 2, 0])
        q[:, 5] = 0.5 * (turn[:, 1, 0] - turn[:, 0, 1])
        return q
