"""Postures that could be commanded: poses and squeezes inside the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.model.parameters import gravity, nominal
from tdfscal.model.statics import carrying, internal_modes
from tdfscal.numerics import so3
from tdfscal.planning.limits import Limits, displacement
from tdfscal.records import FloatArray, IntArray, Rig

#: Share of a sensor's capacity that a plan uses.
OF_CAPACITY = 0.9
#: Unplanned internal forces are allowed for up to this many standard deviations.
_MARGIN = 3.0
#: Share of the candidates whose lean, and whose squeeze, is on the limit: good plans live there.
_AT_THE_LIMIT = 0.8
_ROUNDING = 1e-9
#: Projections on the internal forces and onto the limit, in turn, until both hold.
_PROJECTIONS = 12


@dataclass(frozen=True, slots=True)
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
        return Candidates(*(values[which] for values in self._arrays))

    def joined(self, others: Candidates) -> Candidates:
        """Return these candidates, and the others behind them."""
        pairs = zip(self._arrays, others._arrays, strict=True)
        return Candidates(*(np.concatenate(pair) for pair in pairs))

    @property
    def _arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return self.rotation, self.place, self.carried, self.squeeze


def draw(
    rig: Rig, limits: Limits, count: int, rng: np.random.Generator, *, extremes: bool = True
) -> Candidates:
    """Draw candidates inside the limits; without extremes, evenly: what nobody planned.

    Leans spread evenly over the disc of the tilt limit, turns about the vertical within it.
    Squeezes have a random direction in the space of internal forces and an even size up to the
    limit. What breaks a limit is scaled down onto it. The middle of the hinges stays at home:
    translations tell the balance nothing.

    Raises UsageError where the weight alone breaks a limit.
    """
    share = _AT_THE_LIMIT if extremes else 0.0
    at_limit = rng.uniform(size=(3, count)) < share
    lean = limits.tilt * np.where(at_limit[0], 1.0, np.sqrt(rng.uniform(size=count)))
    azimuth = rng.uniform(-np.pi, np.pi, count)
    turn = rng.uniform(-1.0, 1.0, count)
    turn = limits.tilt * np.where(at_limit[1], np.sign(turn), turn)
    axis = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    rotation = _within_travel(rig, limits, turn, lean[:, None] * axis)
    modes = internal_modes(hanging(rig, rotation)[0])
    along = rng.standard_normal((count, modes.shape[1]))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    direction = np.einsum("kd,kdna->kna", along, modes)
    radius = np.where(at_limit[2], 1.0, rng.uniform(size=count))
    reach = np.max(np.linalg.norm(direction, axis=2), axis=1)
    squeeze = (limits.squeeze * radius / reach)[:, None, None] * direction
    return _loaded(rig, limits, rotation, squeeze)[0]


def realised(
    rig: Rig, limits: Limits, turn: FloatArray, lean: FloatArray, squeeze: FloatArray
) -> tuple[Candidates, IntArray] | None:
    """Postures inside the limits, nearest to those wished for, and which of these exist; None where
    not one does.

    turn : (N,), about the vertical, lean : (N, 2), about horizontal axes of the LCS, rad: the
    rotation is exp(turn z) exp(lean); both are scaled down onto tilt and travel. squeeze :
    (N, n, 3), N, BCS, is projected on the internal forces, and each NCP's part of it onto the limit
    in turn with that.
    """
    length = np.linalg.norm(lean, axis=1)
    shrink = np.minimum(1.0, limits.tilt / np.maximum(length, _ROUNDING))
    turn = np.clip(turn, -limits.tilt, limits.tilt)
    rotation = _within_travel(rig, limits, turn, shrink[:, None] * lean)
    modes = internal_modes(hanging(rig, rotation)[0])

    def internal(force: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("kdna,kd->kna", modes, np.einsum("kdna,kna->kd", modes, force)))

    for _ in range(_PROJECTIONS):
        squeeze = internal(squeeze)
        size = np.linalg.norm(squeeze, axis=2, keepdims=True)
        squeeze = squeeze / np.maximum(1.0, size / max(limits.squeeze, _ROUNDING))
    squeeze = internal(squeeze)
    reach = np.max(np.linalg.norm(squeeze, axis=2), axis=1)
    squeeze *= np.minimum(1.0, limits.squeeze / np.maximum(reach, _ROUNDING))[:, None, None]
    try:
        return _loaded(rig, limits, rotation, squeeze)
    except UsageError:
        return None


def _loaded(
    rig: Rig, limits: Limits, rotation: FloatArray, squeeze: FloatArray
) -> tuple[Candidates, IntArray]:
    """Postures with as much of the squeeze as the limits leave, and which: some have no room.

    Raises UsageError where none has.
    """
    place = limits.home + rig.hinge + displacement(rig, rotation)
    _, carried = hanging(rig, rotation)
    share = room(rig, limits, carried, squeeze)
    keep = np.flatnonzero(share >= 0.0)
    if not keep.size:
        raise _too_heavy(rig, limits, carried)
    squeeze = squeeze * np.minimum(share, 1.0)[:, None, None]
    return Candidates(rotation, place, carried, squeeze).take(keep), keep


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
        way = np.abs(displacement(rig, R))
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


def _too_heavy(rig: Rig, limits: Limits, carried: FloatArray) -> UsageError:
    """Say which limit the weight alone breaks in every posture."""
    margin = _MARGIN * limits.repeatability_force(rig)
    largest = np.linalg.norm(carried, axis=2)
    if not np.all(np.max(largest, axis=1) <= limits.force - margin):
        i = int(np.argmax(largest.max(axis=0)))
        return UsageError(
            f"the weight alone puts {largest[:, i].min():.4g} N on {rig.supports[i]}, and "
            f"unplanned internal forces up to {margin:.3g} N come on top: no posture keeps the "
            f"limit of {limits.force:.4g} N",
            where="force limit",
            hint="raise the limit, or state the NCPs' stiffness and repeatability better",
        )
    return UsageError(
        f"no posture keeps every reading within {OF_CAPACITY:.0%} of the sensors' capacity "
        f"with {margin:.3g} N of unplanned internal forces",
        where="capacity",
        hint="check the mass and the capacities that are stated",
    )
