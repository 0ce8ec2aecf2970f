"""The paper's linear method and what it could have been: entries or angles, with forces or without.

Eq. 21–24 as corrected (theory, sections 1 and 3): with G = m g and r̂ = [r]×, in every posture

    Σ r̂_i Rᵀ X_i f_i = − r̂_m Rᵀ G      N·m, moments about the LCS origin
    Σ X_i f_i        = − G             N, which the paper leaves out

The paper solves the first for the 9 n entries of all X_i and projects each on SO(3) here; the same
equations may be solved for the 3 n angles themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import rotations

_ROUNDS = 30
#: Largest step, rad: beyond it the angles are not near enough for the linearisation.
_STRIDE = 0.3


@dataclass(frozen=True, slots=True)
class Readings:
    """What the method takes as given, B campaigns of K postures.

    load : (B, K, n, 3), readings less their stated zeros, N. pose : (B, K, 3, 3), R, LCS → BCS.
    """

    rig: Rig
    load: FloatArray
    pose: FloatArray


def readings(rig: Rig, position: FloatArray, force: FloatArray) -> Readings:
    """Register the terminal on positions (B, K, n, 3), m; force : (B, K, n, 3), N."""
    pose, _ = rotations.fit(rig.hinge, position)
    return Readings(rig, force - rig.zero.value, pose)


def equations(given: Readings, *, forces: bool) -> tuple[FloatArray, FloatArray]:
    """Rows (B, K, r, n, 3, 3) that X_i enters, and their right sides (B, K, r).

    Row · X = Σ_i Σ_ab row[i, a, b] X_i[a, b]; r = 3 moments, N·m, then with `forces` also 3 forces,
    times the rms lever of the hinges (m), so that both have one unit and weight.
    """
    rig, back = given.rig, np.swapaxes(given.pose, -1, -2)
    weight = np.array([0.0, 0.0, -float(rig.mass.value) * rig.gravity])
    turned = so3.hat(rig.hinge) @ back[:, :, None]  # (B, K, n, 3, 3), r̂_i Rᵀ
    rows = turned[..., None] * given.load[:, :, :, None, None, :]
    right = -np.cross(rig.barycentre.value, back @ weight)
    if forces:
        lever = np.sqrt(np.mean(np.sum(rig.hinge**2, axis=1)))
        own = lever * np.eye(3)[:, :, None] * given.load[:, :, :, None, None, :]
        rows = np.concatenate([rows, own], axis=3)
        right = np.concatenate([right, np.broadcast_to(-lever * weight, right.shape)], axis=2)
    return np.moveaxis(rows, 3, 2), right


def by_entries(given: Readings, *, forces: bool = False) -> FloatArray:
    """X (B, n, 3, 3) from the 9 n entries by least squares, each projected on SO(3)."""
    rows, right = equations(given, forces=forces)
    count, n = len(rows), given.rig.n
    A = rows.reshape(count, -1, 9 * n)
    entries = np.linalg.pinv(A) @ right.reshape(count, -1, 1)
    return rotations_near(entries.reshape(count, n, 3, 3))


def by_angles(given: Readings, start: FloatArray, *, forces: bool = False) -> FloatArray:
    """X (B, n, 3, 3) from the 3 n angles by Gauss–Newton on the same equations, from `start`."""
    rows, right = equations(given, forces=forces)
    count, n = len(rows), given.rig.n
    rows, right = rows.reshape(count, -1, n, 3, 3), right.reshape(count, -1)
    X = start.copy()
    generators = so3.hat(np.eye(3))  # (3, 3, 3)
    for _ in range(_ROUNDS):
        residual = np.einsum("qrnab,qnab->qr", rows, X, optimize=True) - right
        tangent = generators @ X[:, :, None]  # (B, n, 3, 3, 3): [e_j]× X
        J = np.einsum("qrnab,qnjab->qrnj", rows, tangent, optimize=True).reshape(count, -1, 3 * n)
        step = -(np.linalg.pinv(J) @ residual[..., None]).reshape(count, n, 3)
        size = np.abs(step).max(axis=(1, 2), keepdims=True)
        X = so3.exp(step * np.minimum(1.0, _STRIDE / np.maximum(size, 1e-12))) @ X
        if size.max() < 1e-9:
            break
    return X


def rotations_near(matrix: FloatArray) -> FloatArray:
    """Nearest rotations, det = +1, of matrices (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(matrix)
    sign = np.ones((*matrix.shape[:-2], 3))
    sign[..., 2] = np.sign(np.linalg.det(U @ Vt))
    return np.asarray((U * sign[..., None, :]) @ Vt)
