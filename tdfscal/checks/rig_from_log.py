"""What the static postures of a log show of a rig of which nothing is known yet.

Starting points for a rig file, each to be confirmed from drawings and weighing: not a calibration.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.records import FloatArray

_ROUNDS: Final = 10
_ALONG: Final = 0.8  # cosine; a load further off an axis shows no quarter turn about the others
_BETTER: Final = (
    0.25  # a mounting is shown where its misfit is this small a share of the next one's
)
_MOST: Final = 6  # supports whose mountings are tried in all combinations


@record
class RigSketch:
    """Estimates from K static postures of n supports.

    hinge : (n, 3), m, in an LCS at the hinges' centre that is parallel to the BCS at `reference`.
    spread : m, RMS by which the distances of the hinges vary. mass : kg. barycentre : (2,), m, x
    and y in that LCS. nominal_rpy : (n, 3), rad, quarter turns. upright : (n,), whether a sensor's
    load lies along one of its axes. turned : whether the turns about the vertical are shown.
    """

    hinge: FloatArray
    spread: float
    mass: float
    barycentre: FloatArray
    nominal_rpy: FloatArray
    upright: tuple[bool, ...]
    turned: bool
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
    rotation, upright, turned = _mounting(position, force)
    load = np.einsum("nij,knj->kni", rotation, force)
    total = load.sum(axis=1)
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
        turned,
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


def _mounting(position: FloatArray, force: FloatArray) -> tuple[FloatArray, tuple[bool, ...], bool]:
    """Quarter turns (n, 3, 3), whose load lies along an axis, and whether turns about Z show."""
    mean = force.mean(axis=0)
    size = np.linalg.norm(mean, axis=1)
    axis = np.abs(mean).argmax(axis=1)
    n = len(mean)
    upright = tuple(
        bool(size[i] > 0 and abs(mean[i, axis[i]]) >= _ALONG * size[i]) for i in range(n)
    )
    candidates = np.stack(
        [_upright(int(axis[i]), float(np.sign(mean[i, axis[i]]))) if upright[i]
         else np.broadcast_to(np.eye(3), (4, 3, 3)) for i in range(n)]
    )  # fmt: skip
    if n > _MOST or not all(upright) or len(position) < 3:
        return candidates[:, 0], upright, False
    # Without contact the changes of the forces cancel, and so do their moments about the vertical,
    # of which the weight has none; zero offsets and mass drop out with the mean.
    arm = position - position.mean(axis=(0, 1))
    load = np.einsum("ncij,knj->nkci", candidates, force - mean)
    length = float(np.sqrt((arm**2).sum(axis=2).mean()))
    whole = np.einsum("ncij,knj->nkci", candidates, force)
    moment = np.cross(arm.transpose(1, 0, 2)[:, :, None], whole)[..., 2] / length
    moment -= moment.mean(axis=1, keepdims=True)
    rows = np.concatenate([load, moment[..., None]], axis=3)
    gram = np.einsum("akci,bkdi->acbd", rows, rows)
    combinations = np.array(list(itertools.product(range(4), repeat=n)))
    misfit = np.zeros(len(combinations))
    for a, b in itertools.product(range(n), repeat=2):
        misfit += gram[a, combinations[:, a], b, combinations[:, b]]
    best, second = np.argsort(misfit)[:2]
    shown = bool(misfit[best] < _BETTER * misfit[second])
    chosen = combinations[best] if shown else np.zeros(n, dtype=np.int64)
    return candidates[np.arange(n), chosen], upright, shown


def _upright(axis: int, sign: float) -> FloatArray:
    """Four rotations (4, 3, 3) that take an axis of the sensor to the vertical, 90° apart."""
    up = np.zeros(3)
    up[axis] = sign
    level = np.roll(np.eye(3)[axis], 1)
    base = np.stack([level, np.cross(up, level), up])
    if axis == 2 and sign > 0:
        base = np.eye(3)
    quarter = so3.from_rpy(np.array([[0.0, 0.0, k * np.pi / 2] for k in range(4)]))
    turned: FloatArray = np.rint(quarter @ base)
    return turned
