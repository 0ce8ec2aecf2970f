"""Pose of the terminal from where its hinges are: rigid registration on the servo positions."""

from __future__ import annotations

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray

#: A turn from posture to posture below this leaves the hinges as they were, rad.
_TURNED = 1e-4


def register(hinge: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pose of the terminal: R (K, 3, 3) and T (K, 3) with R r_i + T ≈ p_i (Eq. 1).

    hinge (n, 3) in the LCS, position (K, n, 3) in the BCS, m; least squares over all n hinges.
    """
    r0, p0 = hinge.mean(axis=0), position.mean(axis=-2)
    R = so3.project(np.einsum("kni,nj->kij", position - p0[:, None], hinge - r0))
    return R, p0 - R @ r0


def approach(rotation: FloatArray) -> FloatArray:
    """Unit vectors (K, 3), BCS, of the turns from posture to posture; rotation (K, 3, 3).

    Where a posture differs from the one before by a squeeze or a shift only, its hinges stay as
    they were turned last. How the first posture was reached nobody knows: 0.
    """
    out = np.zeros((len(rotation), 3))
    turn = so3.log(rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2))
    size = np.linalg.norm(turn, axis=1)
    moved = np.flatnonzero(size > _TURNED)
    if len(moved):
        last = np.searchsorted(moved, np.arange(len(turn)), side="right") - 1
        unit = turn[moved] / size[moved, None]
        out[1:] = np.where(last[:, None] >= 0, unit[np.maximum(last, 0)], 0.0)
    return out
