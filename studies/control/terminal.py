"""The terminal as a body between its NCPs and the load: inertia, springs, structural damping.

The sensors stand between NCP and terminal, so they feel m·a: F = weight, contact and inertia. A
step is an exponential one (Rosenbrock–Euler): exact for the linearised body whatever the step, and
at rest exactly where springs, weight and contact balance. Forces that go with the square of the
rate of turn (0.02 N in the studies' moves) are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import Options, rotations
from tdfscal.simulation.equilibrium import Load, Pose, settle, springs
from tdfscal.simulation.options import carriage_stiffness
from tdfscal.simulation.truth import Truth

#: Turn since the last linearisation, rad, from which it is made anew.
_REFRESH = 1.0e-3


def inertia_of(rig: Rig) -> FloatArray:
    """Inertia (3, 3), kg m², about the LCS origin: the rig file's, or that of a body whose radius
    of gyration is half that of the hinges, as in the simulated campaigns in motion.
    """
    if rig.inertia is not None and np.all(np.isfinite(rig.inertia.std)):
        return np.asarray(rig.inertia.value)
    m, r = float(rig.mass.value), rig.barycentre.value
    own = 0.25 * m * np.mean(np.sum(rig.hinge**2, axis=1)) * np.diag([1.0, 1.1, 1.3])
    return np.asarray(own + m * (r @ r * np.eye(3) - np.outer(r, r)))


def moment(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Σ a_i × F_i, (L, 3), of (L, m, 3): the skew part of Σ F_i a_iᵀ."""
    return rotations.vee(np.swapaxes(force, -1, -2) @ arm)


@dataclass(frozen=True, slots=True)
class Body:
    """The linearised body about the LCS origin, BCS: M q̈ = Σ F(q, q̇) + applied.

    mass, stiffness : (..., 6, 6). decay : s, damping over stiffness.
    """

    mass: FloatArray
    stiffness: FloatArray
    decay: FloatArray

    def step(self, step: float) -> FloatArray:
        """(..., 12, 18): what (rate, net force, its slope in time), held over `step` (s), add to
        displacement and rate.
        """
        S = np.linalg.solve(self.mass, self.stiffness)
        A = np.zeros((*S.shape[:-2], 12, 12))
        A[..., :6, 6:] = np.eye(6)
        A[..., 6:, :6], A[..., 6:, 6:] = -S, -self.decay[..., None, None] * S
        first = np.linalg.solve(A, expm(A * step) - np.eye(12))  # h φ₁
        second = np.linalg.solve(A, first - step * np.eye(12))  # h² φ₂
        into = np.linalg.inv(self.mass)
        return np.concatenate(
            [first[..., :6], first[..., 6:] @ into, second[..., 6:] @ into], axis=-1
        )


def body(truth: Truth, inertia: FloatArray, damping: float, rotation: FloatArray) -> Body:
    """Linearise at rotation (L, 3, 3); truth : (L,); inertia (L, 3, 3), LCS; damping : ratio, of
    the mode in which the whole terminal goes up and down; in proportion to the stiffness, so that
    modes of higher frequency have more.
    """
    back = np.swapaxes(rotation, -1, -2)
    off = truth.mass[:, None, None] * rotations.hat(
        (rotation @ truth.barycentre[..., None])[..., 0]
    )
    mass = np.zeros((len(rotation), 6, 6))
    mass[:, :3, :3] = truth.mass[:, None, None] * np.eye(3)
    mass[:, :3, 3:], mass[:, 3:, :3] = -off, off
    mass[:, 3:, 3:] = rotation @ inertia @ back
    K = springs(truth.stiffness, truth.hinge @ back)
    rise = np.sqrt(K[:, 2, 2] / truth.mass)
    return Body(mass, K, 2.0 * damping / rise)


class Terminal:
    """Poses, rates and hinge forces of L terminals at once.

    rotation : (L, 3, 3), LCS → BCS. translation : (L, 3), m. rate : (L, 6), m/s of the LCS origin
    and rad/s, BCS. force : (L, n, 3), N, BCS, of the NCPs on the terminal, as the sensors feel it.
    """

    def __init__(
        self,
        truth: Truth,
        inertia: FloatArray,
        damping: float,
        stand: FloatArray,
        start: Pose,
        step: float,
    ) -> None:
        """Damping : as in `body`. stand : (L, n, 3), m, BCS, carriages.

        Raises NotConvergedError where nothing stands.
        """
        lanes = len(stand)
        load = Load(np.zeros((lanes, 1, 2, 3)), np.zeros((lanes, 1, 3)))
        first = Pose(start.rotation[:, None], start.translation[:, None])
        rest = settle(truth, stand[:, None], load, first)
        self.rotation = rest.pose.rotation[:, 0]
        self.translation = rest.pose.translation[:, 0]
        self.rate = np.zeros((lanes, 6))
        self.force = rest.force[:, 0]
        self._truth, self._inertia, self._damping = truth, inertia, damping
        self._levers = np.concatenate([truth.hinge, truth.barycentre[:, None, :]], axis=1)
        self._acting = np.empty_like(self._levers)
        self._acting[:, -1] = truth.mass[:, None] * truth.gravity
        self._slope = np.zeros_like(self.force)
        self._stand, self._step = stand, step
        self._linearise()

    def move(self, stand: FloatArray, contact: FloatArray) -> None:
        """One step, in which the carriages go evenly to `stand`, under a held contact wrench
        (L, 6), N, and N·m about the LCS origin, BCS.
        """
        h = self._step
        if np.abs(self.rotation - self._linearised).max() > _REFRESH:
            self._linearise()
        speed = (stand - self._stand) / h
        slope = (self._truth.stiffness @ speed[..., None])[..., 0]
        levers = self._levers @ np.swapaxes(self.rotation, -1, -2)
        # The dampers feel the carriages' new speed at once.
        self._acting[:, :-1] = self.force + self._decay * (slope - self._slope)
        state = np.empty((len(stand), 18))
        state[:, :6] = self.rate
        state[:, 6:12] = contact
        state[:, 6:9] += self._acting.sum(axis=1)
        state[:, 9:12] += moment(levers, self._acting)
        state[:, 12:15] = slope.sum(axis=1)
        state[:, 15:] = moment(levers[:, :-1], slope)
        change = (self._gain @ state[..., None])[..., 0]
        self._stand, self._slope = stand, slope
        self.translation = self.translation + change[:, :3]
        turn = rotations.hat(change[:, 3:6])
        # To the third order in a turn of microradians.
        self.rotation = self.rotation + turn @ (self.rotation + 0.5 * (turn @ self.rotation))
        self.rate = self.rate + change[:, 6:]
        self.force = self.pull(speed)

    def _linearise(self) -> None:
        own = body(self._truth, self._inertia, self._damping, self.rotation)
        self._decay, self._gain = own.decay[:, None, None], own.step(self._step)
        self._linearised = self.rotation

    def pull(self, speed: FloatArray) -> FloatArray:
        """−K (stretch + decay · its rate), (L, n, 3), N; speed : (L, n, 3), m/s, of carriages."""
        arm = self._levers[:, :-1] @ np.swapaxes(self.rotation, -1, -2)
        stretch = arm + (self.translation[:, None, :] - self._stand)
        rate = self.rate[:, None, :3] - arm @ rotations.hat(self.rate[:, 3:]) - speed
        stretch += self._decay * rate
        return np.asarray(-(self._truth.stiffness @ stretch[..., None])[..., 0])


def stated(rig: Rig, trials: int) -> Truth:
    """The rig just as its file states it, leading axis (trials,): what is assumed uncalibrated."""
    n = rig.n

    def each(value: FloatArray, *shape: int) -> FloatArray:
        return np.array(np.broadcast_to(value, (trials, *shape)), dtype=np.float64)

    return Truth(
        rotation=each(rotations.from_rpy(rig.nominal_rpy), n, 3, 3),
        rpy=each(rig.nominal_rpy, n, 3),
        zero=each(rig.zero.value, n, 3),
        sensitivity=np.zeros((trials, n, 3, 3)),
        mass=each(rig.mass.value),
        barycentre=each(rig.barycentre.value, 3),
        hinge=each(rig.hinge, n, 3),
        datum=np.zeros((trials, n, 3)),
        gravity=each(np.array([0.0, 0.0, -rig.gravity]), 3),
        stiffness=each(carriage_stiffness(rig, Options()), n, 3, 3),
    )
