"""Forces that nobody measures: free parameters of a posture, eliminated posture by posture.

e = e_0 + N u + noise, with a column of N (K, 6, m) per component that no sensor gives. Whatever
u is, the rows of the whitened e across N's columns do not see it; along them they say nothing
else. So a missing reading costs equations and adds no parameter, however many postures there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray

#: A direction whose share of the columns is below this is rounding.
_ROUNDING = 1e-9


def whitener(cov: FloatArray, columns: FloatArray) -> tuple[FloatArray, IntArray]:
    """V (K, 6, 6) with V cov Vᵀ a projector on what the columns do not reach, and its rank (K,).

    cov : (K, 6, 6). columns : (K, 6, m).
    """
    inverse_root = np.linalg.inv(np.linalg.cholesky(cov))
    rows = np.full(len(cov), cov.shape[-1])
    if not columns.shape[2]:
        return inverse_root, rows
    U, s, _ = np.linalg.svd(inverse_root @ columns, full_matrices=False)
    reached = s > _ROUNDING * s.max(axis=1, keepdims=True)
    U = np.where(reached[:, None], U, 0.0)
    return inverse_root - U @ (np.swapaxes(U, 1, 2) @ inverse_root), rows - reached.sum(axis=1)


def least_squares(
    cov: FloatArray, columns: FloatArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Smallest free forces u (K, m) that the residual (K, 6) asks for, and their covariance."""
    inverse_root = np.linalg.inv(np.linalg.cholesky(cov))
    white = inverse_root @ columns
    inverse = np.linalg.pinv(white, rcond=_ROUNDING)
    value = -(inverse @ (inverse_root @ residual[..., None]))[..., 0]
    return value, np.asarray(inverse @ np.swapaxes(inverse, 1, 2))


def from_directions(
    nominal_rpy: Sequence[float], directions: dict[Any, tuple[float, float, float]]
) -> FloatArray:
    """Rotation (3, 3) next to the nominal mounting whose measured axes point along directions.

    What no axis shows stays as it is nominally: readings turned by it are the same.
    """
    R = so3.from_rpy(np.array(nominal_rpy))
    if len(directions) != 1:
        columns = [directions.get(axis, np.zeros(3)) for axis in "xyz"]
        return so3.project(np.stack(columns, axis=1)) if directions else R
    ((axis, towards),) = directions.items()
    own, beside = R.T["xyz".index(axis)], R.T["yzx".index(axis)]
    about = np.cross(own, towards)
    sine, cosine = np.linalg.norm(about), float(own @ np.array(towards))
    if sine < 1e-9:
        return R if cosine > 0 else so3.exp(np.pi * beside) @ R
    return np.asarray(so3.exp(np.arctan2(sine, cosine) * about / sine) @ R)
