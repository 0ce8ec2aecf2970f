"""What a terminal's own mass does to the forces while it moves: d'Alembert's wrench."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.equilibrium import Pose
from tdfscal.simulation.truth import Truth

#: Step of the differences in time, s.
_STEP = 5.0e-3


def draw_inertia(rig: Rig, truth: Truth, rng: np.random.Generator) -> FloatArray:
    """Inertia about the LCS origin, (3, 3), kg m²: within what the rig states, or of a body.

    That has the hinges' radius of gyration over √2, and its barycentre off the origin.
    """
    draw = rng.standard_normal((3, 3))
    draw = (draw + draw.T) / 2
    if rig.inertia is not None and np.all(np.isfinite(rig.inertia.std)):
        return np.asarray(rig.inertia.value + rig.inertia.std * draw)
    size = 0.5 * float(truth.mass) * np.mean(np.sum(truth.hinge**2, axis=1))
    own = 0.5 * size * (np.diag([1.0, 1.1, 1.3]) + 0.05 * draw)
    return np.asarray(own + _off_centre(truth))


def _off_centre(truth: Truth) -> FloatArray:
    """What the inertia about the LCS origin is more than that about the barycentre."""
    r = truth.barycentre
    return np.asarray(truth.mass * (r @ r * np.eye(3) - np.outer(r, r)))


def inertial(
    pose: Callable[[FloatArray], Pose], truth: Truth, inertia: FloatArray, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """D'Alembert's force and moment at times (N,), s, on a terminal that follows a course.

    Returns
    -------
    (N, 2, 3), N and N·m, about the LCS origin in the LCS; and its angular velocity (N, 3), rad/s,
    BCS.
    """
    h = _STEP
    back, here, ahead = (pose(time + shift) for shift in (-h, 0.0, h))
    R = here.rotation
    after = rotations.log(ahead.rotation @ np.swapaxes(R, 1, 2))
    before = rotations.log(R @ np.swapaxes(back.rotation, 1, 2))
    turning, turning_rate = (after + before) / (2 * h), (after - before) / h**2
    rise = (ahead.translation - 2 * here.translation + back.translation) / h**2
    bary = R @ truth.barycentre
    centre = rise + np.cross(turning_rate, bary)
    centre += np.cross(turning, np.cross(turning, bary))
    J = R @ (inertia - _off_centre(truth)) @ np.swapaxes(R, 1, 2)
    spin = np.einsum("kab,kb->ka", J, turning)
    gyro = np.einsum("kab,kb->ka", J, turning_rate) + np.cross(turning, spin)
    push = -truth.mass * centre
    moment = -gyro + np.cross(bary, push)
    # Rows vᵀR are the components in the LCS.
    return np.asarray(np.stack([push, moment], axis=1) @ R), turning
