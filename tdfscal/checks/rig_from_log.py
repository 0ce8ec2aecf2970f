"""What the static postures of a log show of a rig of which nothing is known yet.

Starting points for a rig file, each to be confirmed from drawings and weighing: not a calibration.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.records import FloatArray

_ROUNDS: Final = 10
_ALONG: Final = 0.8  # cosine; a load further off an axis shows no quarter turn


@record
class RigSketch:
    """Estimates from K static postures of n supports.

    hinge : (n, 3), m, in an LCS at the hinges' centre that is parallel to the BCS at `reference`.
    spread : m, RMS by which the distances of the hinges vary. mass : kg. barycentre : (2,), m, x
    and y in that LCS. nominal_rpy : (n, 3), rad, quarter turns that hold the loads upright; turns
    about the vertical are left to the calibration. upright : (n,), whether a sensor's load lies
    along one of its axes.
    """

    hinge: FloatArray
    spread: float
    mass: float
    barycentre: FloatArray
    nominal_rpy: FloatArray
    upright: tuple[bool, ...]
    reference: int


def sketch_rig(position: FloatArray, force: FloatArray, gravity: float) -> RigSketch:
    """Estimate hinges, weight and mounting.

    Parameters
    ----------
    position : (K, n, 3), m, BCS; hinge centres. force : (K, n, 3), N on the terminal, sensor
        frames.
    gravity : m/s².

    Returns
    -------
    RigSketch : with the posture nearest to the mean of all as its reference.

    Raises
    ------
    DataError
        No instant has finite numbers in all fields; others are left out.
    """
    whole = np.isfinite(position).all(axis=(1, 2)) & np.isfinite(force).all(axis=(1, 2))
    if not whole.any():
        raise DataError(Finding("instants-broken"))
    position, force = position[whole], force[whole]
    hinge, reference, spread = _shape(position)
    rotation, upright = _mounting(force)
    load = np.einsum("nij,knj->kni", rotation, force)
    # Turns about the vertical leave what is upright as it is.
    total = load.sum(axis=1)[:, 2:] if all(upright) else load.sum(axis=1)
    mass = float(np.median(np.linalg.norm(total, axis=1))) / gravity
    # Moments of vertical forces about the centre of the hinges, at the reference posture.
    share = load[reference, :, 2] / load[reference, :, 2].sum()
    return RigSketch(
        hinge,
        spread,
        mass,
        share @ hinge[:, :2],
        so3.to_rpy(rotation),
        upright,
        int(np.flatnonzero(whole)[reference]),
    )


def _shape(position: FloatArray) -> tuple[FloatArray, int, float]:
    """Mean shape (n, 3) of the hinges, its posture of reference, and its misfit, m.

    Generalised Procrustes: postures are registered on their mean, in turn.
    """
    centred = position - position.mean(axis=1, keepdims=True)
    reference = int(np.argmin(((centred - centred.mean(axis=0)) ** 2).sum(axis=(1, 2))))
    shape = centred[reference]
    for _ in range(_ROUNDS):
        aligned = centred @ register(shape, centred)[0]
        shape = aligned.mean(axis=0)
    spread = float(np.sqrt(((aligned - shape) ** 2).sum(axis=2).mean()))
    turn, _ = register(shape, centred[None, reference])
    return shape @ turn[0].T, reference, spread


def _mounting(force: FloatArray) -> tuple[FloatArray, tuple[bool, ...]]:
    """Quarter turns (n, 3, 3) that hold the mean loads upright, and whose lie along an axis."""
    mean = force.mean(axis=0)
    axis = np.abs(mean).argmax(axis=1)
    along = mean[np.arange(len(mean)), axis]
    upright = np.abs(along) >= _ALONG * np.linalg.norm(mean, axis=1)
    upright &= along != 0
    rotation = [
        _upright(int(i), float(np.sign(load))) if lies else np.eye(3)
        for i, load, lies in zip(axis, along, upright, strict=True)
    ]
    return np.stack(rotation), tuple(upright.tolist())


def _upright(axis: int, sign: float) -> FloatArray:
    """A rotation that takes an axis of the sensor to the vertical."""
    if axis == 2 and sign > 0:
        return np.eye(3)
    up = sign * np.eye(3)[axis]
    level = np.roll(np.eye(3)[axis], 1)
    return np.stack([level, np.cross(up, level), up])
