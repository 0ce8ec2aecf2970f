"""Postures that could be commanded: poses and squeezes inside the limits of the machine."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.frozen import field, record
from tdfscal.model.parameters import gravity, nominal
from tdfscal.model.statics import carrying, internal_modes
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.significance import OF_CAPACITY


@record
class Limits:
    """What a posture may ask of the machine.

    tilt : rad, largest lean; the turn about the vertical stays within it, too.
    squeeze : N, largest internal force at any NCP. force : N, largest force at any NCP in all.
    travel : (n, 3), m, how far each NCP goes from its place at home, either way along each axis
    of the BCS. home : (3,), m, BCS, the LCS origin at home; level : (3, 3), LCS → BCS there;
    recorded : both are the mean of what was recorded. stiffness : N/m, of each NCP, isotropic;
    None where forces are servoed to.
    """

    tilt: float
    squeeze: float
    travel: FloatArray
    home: FloatArray
    force: float = np.inf
    stiffness: float | None = None
    level: FloatArray = field(default_factory=lambda: np.eye(3))
    recorded: bool = False

    def at_home(self, rig: Rig) -> FloatArray:
        """Hinge centres (n, 3) at home, m, BCS."""
        return np.asarray(self.home + rig.hinge @ self.level.T)

    def repeatability_force(self, rig: Rig) -> float:
        """Standard deviation, N per internal mode, of the forces that the NCPs' scatter makes.

        Unplanned, but read by the sensors like any other: they carry information.
        """
        return (self.stiffness or 0.0) * rig.declared.positioner


@record
class Request:
    """What is asked for.

    noise : N per axis, expected standard uncertainty of a posture's mean force, beyond what the
    rig declares. candidates : how many there are to choose from.
    """

    limits: Limits
    noise: float = 1.0
    candidates: int = 2000


def check_noise(rig: Rig, noise: float) -> None:
    """Raise UsageError where neither the request, in N, nor the rig states a force noise."""
    if noise == 0.0 and rig.declared.force_noise == 0.0:
        what = "neither the request nor the rig states a force noise"
        raise UsageError(what, hint="state what a posture's mean force will scatter by")


def displacement(rig: Rig, limits: Limits, rotation: FloatArray) -> FloatArray:
    """Way (..., n, 3), m, BCS, of each hinge from home with the middle of the hinges at rest."""
    spoke = rig.hinge - rig.hinge.mean(axis=0)
    return np.asarray(spoke @ np.swapaxes(rotation, -1, -2) - spoke @ limits.level.T)


#: Unplanned internal forces are allowed for up to this many standard deviations.
_MARGIN = 3.0
#: Share of the candidates whose lean, and whose squeeze, is on the limit: good plans live there.
_AT_THE_LIMIT = 0.8
_ROUNDING = 1e-9


@record
class Candidates:
    """N postures: to choose from, chosen, or on the way of a motion.

    rotation : (N, 3, 3), LCS → BCS. place : (N, n, 3), m, BCS, hinge centres of the undeformed
    terminal. carried, squeeze : (N, n, 3), N, BCS, force of each NCP on the terminal that carries
    the weight, and the internal force that is added to it.
    """

    rotation: FloatArray
    place: FloatArray
    carried: FloatArray
    squeeze: FloatArray

    def __len__(self) -> int:
        return len(self.rotation)

    @property
    def force(self) -> FloatArray:
        """Force of each NCP on the terminal (N, n, 3), N, BCS."""
        return self.carried + self.squeeze

    def displacement(self, limits: Limits) -> FloatArray | None:
        """What squeezes (N, n, 3), m, BCS; None where forces are servoed to."""
        return None if limits.stiffness is None else self.squeeze / limits.stiffness

    def position(self, limits: Limits) -> FloatArray:
        """Hinge centres (N, n, 3) to command to the servos, m, BCS: with what squeezes."""
        extra = self.displacement(limits)
        return self.place if extra is None else self.place + extra

    def take(self, which: IntArray) -> Candidates:
        """Return the candidates with these indices, in their order."""
        return Candidates(
            self.rotation[which], self.place[which], self.carried[which], self.squeeze[which]
        )


def draw(rig: Rig, limits: Limits, count: int, rng: np.random.Generator) -> Candidates:
    """Draw candidates inside the limits, most of them on one.

    Leans spread evenly over the disc of the tilt limit, turns about the vertical within it.
    Squeezes have a random direction in the space of internal forces and an even size up to the
    limit. What breaks a limit is scaled down onto it. The middle of the hinges stays at home:
    translations tell the balance nothing.

    Raises UsageError where the weight alone breaks a limit.
    """
    at_limit = rng.uniform(size=(3, count)) < _AT_THE_LIMIT
    lean = limits.tilt * np.where(at_limit[0], 1.0, np.sqrt(rng.uniform(size=count)))
    azimuth = rng.uniform(-np.pi, np.pi, count)
    turn = rng.uniform(-1.0, 1.0, count)
    turn = limits.tilt * np.where(at_limit[1], np.sign(turn), turn)
    axis = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    rotation = _within_travel(rig, limits, turn, lean[:, None] * axis)
    arm, carried = hanging(rig, rotation)
    modes = internal_modes(arm)
    along = rng.standard_normal((count, modes.shape[1]))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    direction = np.einsum("kd,kdna->kna", along, modes)
    radius = np.where(at_limit[2], 1.0, rng.uniform(size=count))
    reach = np.max(np.linalg.norm(direction, axis=2), axis=1)
    squeeze = (limits.squeeze * radius / reach)[:, None, None] * direction
    place = limits.at_home(rig) + displacement(rig, limits, rotation)
    share = room(rig, limits, carried, squeeze)
    keep = np.flatnonzero(share >= 0.0)
    if not keep.size:
        raise too_heavy(rig, limits, carried)
    squeeze = squeeze * np.minimum(share, 1.0)[:, None, None]
    return Candidates(rotation, place, carried, squeeze).take(keep)


def hanging(rig: Rig, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Arms (K, n, 3), m, BCS, about the barycentre, and smallest carrying forces (K, n, 3), N."""
    state = nominal(rig)
    arm = (rig.hinge - rig.barycentre.value) @ np.swapaxes(rotation, -1, -2)
    weight = state.mass * gravity(state, rig.gravity)
    return arm, carrying(arm, np.zeros((*rotation.shape[:-2], 3)), weight)


def _within_travel(rig: Rig, limits: Limits, turn: FloatArray, lean: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) of turn (N,) and lean (N, 2), both scaled down where travel ends."""
    scale = np.ones(len(turn))
    lean = np.concatenate([lean, np.zeros((len(lean), 1))], axis=1)
    upright = np.array([0.0, 0.0, 1.0])
    for _ in range(8):  # the way grows almost linearly with the angles
        R = so3.exp((scale * turn)[:, None] * upright) @ so3.exp(scale[:, None] * lean)
        R = R @ limits.level
        way = np.abs(displacement(rig, limits, R))
        with np.errstate(divide="ignore", invalid="ignore"):
            use = np.max(np.where(way > _ROUNDING, way / limits.travel, 0.0), axis=(1, 2))
        if np.all(use <= 1.0):
            break
        scale /= np.where(use > 1.0, use * (1 + _ROUNDING), 1.0)
    return R


def room(rig: Rig, limits: Limits, carried: FloatArray, squeeze: FloatArray) -> FloatArray:
    """Largest t (N,) for which carried + t squeeze (N, n, 3) keeps the limits of force and the
    sensors' capacity, unplanned internal forces included; below 0: none.
    """
    margin = _MARGIN * limits.repeatability_force(rig)
    # |carried + t squeeze| ≤ limit at every NCP.
    limit = limits.force - margin
    a, b = np.sum(squeeze**2, axis=2), np.sum(carried * squeeze, axis=2)
    c = np.sum(carried**2, axis=2) - limit**2
    with np.errstate(invalid="ignore"):
        root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
    t = np.where(a > 0, (-b + root) / np.where(a > 0, a, 1.0), np.inf)
    in_force = np.min(np.where((c > 0) | (limit < 0.0), -1.0, t), axis=1)
    # Every reading inside its share of capacity.
    X = so3.from_rpy(rig.nominal_rpy)
    base = np.einsum("nba,knb->kna", X, carried) + rig.zero.value
    slope = np.einsum("nba,knb->kna", X, squeeze)
    most = np.maximum(OF_CAPACITY * rig.capacity - margin, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(slope != 0.0, (most - np.sign(slope) * base) / np.abs(slope), np.inf)
    t = np.where(np.abs(base) > most, -1.0, t)
    return np.asarray(np.minimum(in_force, np.min(t, axis=(1, 2))))


def too_heavy(rig: Rig, limits: Limits, carried: FloatArray) -> UsageError:
    """Say what the weight alone asks of the machine in the easiest posture."""
    margin = _MARGIN * limits.repeatability_force(rig)
    easiest = np.linalg.norm(carried, axis=2).min(axis=0)
    i, most = int(np.argmax(easiest)), f"{OF_CAPACITY:.0%} of the sensors' capacity"
    most += f" and {limits.force:.4g} N in all" * bool(np.isfinite(limits.force))
    return UsageError(
        f"the weight alone puts {easiest[i]:.4g} N on {rig.supports[i]}, and unplanned internal "
        f"forces up to {margin:.3g} N come on top: no posture keeps the limit of {most}",
        where="limits of force",
        hint="raise the limit, or correct the mass, capacities and stiffness that are stated",
    )
