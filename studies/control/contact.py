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
from tdfscal.simulation import rotations

_TEETH = 8
#: m, of an engagement.
LONGEST = 1.0
#: Stiffness across, N/m. Tooth pair: ISO 6336-1, single stiffness c' = 14 N/(mm·µm) of steel, times
#: 30 mm of face width. Bearings of the shaft: 200 N/µm, catalogues of pairs of 100 mm bore. Stand:
#: a cantilever 3EI/L³, square hollow section 120 × 6 mm (EN 10219: 562 cm⁴), 1.75 m to the mouth.
TOOTH_PAIR, BEARINGS, STAND = 14.0e9 * 0.03, 2.0e8, 3.0 * 210.0e9 * 5.62e-6 / 1.75**3
#: In series: the stand gives it all.
SERIES = 1.0 / (1.0 / TOOTH_PAIR + 1.0 / BEARINGS + 1.0 / STAND)
#: A shaft that touches the mouth's edge does so with all its stiffness from this depth on, m.
_EDGE = 0.01
#: Lean of the axis by a turn about y and x: (θy, −θx).
_LEAN = np.array([1.0, -1.0])

#: A ring of teeth in touch: radial and axial force (L, J), N, and its place up the shaft from the
#: tip, (L, 1), m.
_Ring = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class GearPair:
    """Inner gear (shaft) and outer gear (bore).

    radius : m, of both, about. clearance : m, radial. twist : rad, free play about the axis.
    length : m, engagement, at which the shoulder seats. chamfer : m, axial length of the lead-in;
    chamfer_angle : rad, against the axis. stiffness : N/m of one tooth across, with what carries
    the outer gear. seat_stiffness : N/m of the shoulder, axial. friction : Coulomb's
    coefficient. slip : m/s, at which friction reaches 71 % of it. tip : (3,), m, LCS.
    """

    radius: float = 0.1
    clearance: float = 5.0e-5
    twist: float = 2.0e-4
    length: float = 1.0 / 3.0
    chamfer: float = 3.0e-3
    chamfer_angle: float = np.pi / 6
    stiffness: float = SERIES
    seat_stiffness: float = 2.0 * SERIES
    friction: float = 0.15
    slip: float = 5.0e-4
    tip: tuple[float, float, float] = (0.0, 0.0, 0.5)

    def __post_init__(self) -> None:
        positive = (self.clearance, self.stiffness, self.seat_stiffness)
        if min(positive) <= 0.0 or not self.chamfer < self.length <= LONGEST:
            raise UsageError(
                "these gears cannot be docked: clearance and stiffness are above zero, and the "
                f"engagement is longer than the lead-in and at most {LONGEST:g} m"
            )

    @property
    def stiffest(self) -> FloatArray:
        """(6, 6), the stiffest that contact can be, about the LCS origin: at full depth, in touch
        at tip, mouth, teeth and shoulder.
        """
        out = np.zeros((6, 6))
        k, ring = self.stiffness, self.seat_stiffness * self.radius**2 / 2
        for back in (0.0, self.length):
            z = self.tip[2] - back
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

    @cached_property
    def _flow(self) -> tuple[FloatArray, FloatArray]:
        """Velocities of the teeth by q̇, outwards, around and along: (6, 3 J) of a ring about the
        tip, and what each metre up the shaft adds, (6, 3 J).
        """
        ex, ey = self._rim
        at_tip, per_metre = np.zeros((2, 6, 3, _TEETH))
        at_tip[0, :2], at_tip[1, :2] = (ex, -ey), (ey, ex)
        at_tip[5, 1], at_tip[2, 2], at_tip[3:5, 2] = self.radius, 1.0, self._rise
        per_metre[4, :2], per_metre[3, :2] = (ex, -ey), (-ey, -ex)
        return at_tip.reshape(6, -1), per_metre.reshape(6, -1)

    def wrench(self, q: FloatArray, rate: FloatArray | None = None) -> FloatArray:
        """Force and moment about the tip, (L, 6), on the shaft, bore's frame, at q (L, 6).

        rate : (L, 6), q̇, for friction; None for none.
        """
        out = np.zeros_like(q)
        reach = self.radius * np.abs(q[:, 3:5]).sum(axis=1)
        if np.all(q[:, 2] < -reach):
            return out
        rings = [self._tip(q), self._mouth(q)]
        if q[:, 2].max() > self.length - 0.1 * self.radius:
            rings.append(self._seat(q))
        radial, axial, up = (np.stack(part, axis=1) for part in zip(*rings, strict=True))
        force = np.zeros((*radial.shape[:2], 3, _TEETH))
        if rate is not None and self.friction > 0.0:
            self._rub(force, rate, radial, axial, up)
        force[:, :, 0] -= radial
        force[:, :, 2] -= axial
        # The mouth's axial part stems from the lean of its normal, and has no lever.
        force[:, 1, 2] += axial[:, 1]
        out[:, 2] -= axial[:, 1].sum(axis=1)
        # Virtual work: what q̇ does to the teeth's velocities, forces do to the wrench.
        at_tip, per_metre = self._flow
        teeth = force.reshape(*radial.shape[:2], -1)
        out += (teeth @ at_tip.T + up * (teeth @ per_metre.T)).sum(axis=1)
        self._flanks(q, rate, out)
        return out

    def _tip(self, q: FloatArray) -> _Ring:
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
        return radial, axial, np.zeros((len(q), 1))

    def _mouth(self, q: FloatArray) -> _Ring:
        """The bore's edge on the shaft's flank, behind the tip."""
        back = q[:, 2] - self.chamfer
        share = np.clip(back / _EDGE, 0.0, 1.0)[:, None]
        lean = q[:, 4:2:-1] * _LEAN
        gap = np.maximum((q[:, :2] - back[:, None] * lean) @ self._rim - self.clearance, 0.0)
        radial = self.stiffness * share * gap
        grows = (share < 1.0) * (share > 0.0) * (0.5 * self.stiffness / _EDGE) * gap**2
        return radial, grows - radial * (lean @ self._rim), -back[:, None]

    def _seat(self, q: FloatArray) -> _Ring:
        """The shoulder on the bore's face."""
        pressed = np.maximum(q[:, 2:3] + q[:, 3:5] @ self._rise - self.length, 0.0)
        axial = self.seat_stiffness / _TEETH * pressed
        return np.zeros_like(axial), axial, np.full((len(q), 1), -self.length)

    def _flanks(self, q: FloatArray, rate: FloatArray | None, out: FloatArray) -> None:
        """Twist of the teeth against each other, with friction along the axis."""
        depth, psi = q[:, 2], q[:, 5]
        over = np.abs(psi) - self.twist
        over[depth <= 0.0] = -1.0
        if over.max() <= 0.0:
            return
        k, face = self.stiffness * self.radius**2, self.seat_stiffness
        slope = (depth < self.chamfer) * np.tan(self.chamfer_angle) / self.radius
        over -= slope * (self.chamfer - depth)
        inside = over > 0.0
        by_face = inside & (face * depth**2 < k * over**2)
        torque = k * np.where(inside & ~by_face, over, 0.0)
        out[:, 5] -= torque * np.sign(psi)
        out[:, 2] -= torque * slope + np.where(by_face, face * depth, 0.0)
        if rate is not None:
            v = rate[:, 2]
            normal = torque / self.radius
            out[:, 2] -= self.friction * normal * v / np.sqrt(v * v + self.slip**2)

    def _rub(
        self,
        force: FloatArray,
        rate: FloatArray,
        radial: FloatArray,
        axial: FloatArray,
        up: FloatArray,
    ) -> None:
        """Regularised Coulomb friction: force (L, R, 3, J) outwards, around and along."""
        normal = np.sqrt(radial * radial + axial * axial)
        at_tip, per_metre = self._flow
        v = ((rate @ at_tip)[:, None] + up * (rate @ per_metre)[:, None]).reshape(force.shape)
        # The normal lies in the plane of out and along; slide is the slip in it, across to it.
        unit = 1.0 / np.maximum(normal, 1e-300)
        n_out, n_along = radial * unit, axial * unit
        around, slide = v[:, :, 1], v[:, :, 0] * n_along - v[:, :, 2] * n_out
        drag = normal / np.sqrt(around * around + slide * slide + self.slip**2)
        drag *= -self.friction
        force[:, :, 1] = drag * around
        drag *= slide
        force[:, :, 0], force[:, :, 2] = drag * n_along, -drag * n_out


def coordinates(mouth: FloatArray, tip: FloatArray, R: FloatArray) -> FloatArray:
    """Return q (L, 6) of shafts with tips at (L, 3) and rotations R (L, 3, 3), near the identity.

    mouth : (3,), the middle of the bore's; all in m, BCS, whose axes are the bore's.
    """
    return np.concatenate([tip - mouth, 0.5 * rotations.vee(R)], axis=1)
