"""Forces that nobody measures: free parameters of a posture, eliminated posture by posture.

e = e_0 + N u + noise, with a column of N (K, 6, m) per component that no sensor gives. Whatever
u is, the rows of the whitened e across N's columns do not see it; along them they say nothing
else. So a missing reading costs equations and adds no parameter, however many postures there are.
"""

from __future__ import annotations

import numpy as np

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
