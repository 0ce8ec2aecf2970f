"""Forces of the NCPs on the terminal at rest: what carries the weight, and what squeezes."""

from __future__ import annotations

import numpy as np

from tdfscal.model.statics import wrench
from tdfscal.records import FloatArray


def grasp(arm: FloatArray) -> FloatArray:
    """G (..., 6, 3n): net force and moment of forces at the lever arms (..., n, 3)."""
    blocks = np.moveaxis(wrench(arm), -3, -2)  # (..., 6, n, 3)
    return np.asarray(blocks.reshape(*blocks.shape[:-2], -1))


def carrying(arm: FloatArray, arm_m: FloatArray, weight: FloatArray) -> FloatArray:
    """Smallest forces (..., n, 3), N, that carry a weight (3,) at the arm arm_m (..., 3).

    F = −Gᵀ (G Gᵀ)⁻¹ w (Eq. 18 corrected). Equally stiff NCPs share the weight so.
    """
    G = grasp(arm)
    down = np.broadcast_to(weight, arm_m.shape)
    w = np.concatenate([down, np.cross(arm_m, down)], axis=-1)[..., None]
    Gt = np.swapaxes(G, -1, -2)
    return np.asarray((-Gt @ np.linalg.solve(G @ Gt, w)).reshape(arm.shape))


def internal_modes(arm: FloatArray) -> FloatArray:
    """Orthonormal internal forces (..., 3n − 6, n, 3): G u = 0."""
    G = grasp(arm - arm.mean(axis=-2, keepdims=True))
    _, _, Vt = np.linalg.svd(G, full_matrices=True)
    return np.asarray(Vt[..., 6:, :].reshape(*arm.shape[:-2], -1, *arm.shape[-2:]))


def internal_part(arm: FloatArray, force: FloatArray) -> FloatArray:
    """Forces (..., n, 3) less what they exert as a whole at the lever arms (..., n, 3)."""
    G = grasp(arm)
    Gt = np.swapaxes(G, -1, -2)
    flat = force.reshape(*force.shape[:-2], -1, 1)
    return np.asarray((flat - Gt @ np.linalg.solve(G @ Gt, G @ flat)).reshape(force.shape))
