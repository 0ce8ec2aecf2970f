"""Friction of the hinges: a moment on the terminal against its turn."""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.options import Options
from tdfscal.simulation.truth import Truth

#: Friction is Coulomb's above this angular speed, rad/s, and viscous well below it.
_STICK = 1.0e-4


def at_rest(
    rig: Rig, options: Options, rotation: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Moment (B, K, 3), N·m, BCS, in postures (B, K, 3, 3): the declared one, and hysteresis."""
    drawn = rig.declared.hinge_moment * rng.standard_normal((*rotation.shape[:2], 3))
    return np.asarray(drawn - rig.n * options.faults.hysteresis * _approach(rotation))


def in_motion(friction: float, truth: Truth, turning: FloatArray) -> FloatArray:
    """Coulomb's moment (N, 3), N·m, BCS; friction : N·m of each hinge. turning : (N, 3), rad/s."""
    speed = np.sqrt(np.sum(turning**2, axis=1) + _STICK**2)[:, None]
    return np.asarray(-friction * truth.hinge.shape[0] * turning / speed)


def _approach(rotation: FloatArray) -> FloatArray:
    """Unit vectors (B, K, 3), BCS, of the turns from posture to posture; the first is 0."""
    turn = rotations.log(rotation[:, 1:] @ np.swapaxes(rotation[:, :-1], -1, -2))
    size = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-12)
    return np.concatenate([np.zeros((len(rotation), 1, 3)), turn / size], axis=1)
