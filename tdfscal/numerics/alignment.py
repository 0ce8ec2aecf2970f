"""Maximum-likelihood rigid alignment of many point sets at once, without judgement."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray, IntArray

_MAX_ITERATIONS = 60
#: Relative rounding error that a sum of products of 3×3 matrices may have.
PRODUCT_ROUNDING = 16 * np.finfo(np.float64).eps


@record
class Alignment:
    """Result of `align`, batched over leading axes.

    rotation : (..., 3, 3). translation : (..., G, 3), m. residual : (..., N, 3), m, y − R x − t.
    chi2 : (...). converged : (...).
    """

    rotation: FloatArray
    translation: FloatArray
    residual: FloatArray
    chi2: FloatArray
    converged: BoolArray


def align(
    measured: npt.ArrayLike,
    reference: npt.ArrayLike,
    measured_cov: FloatArray,
    reference_cov: FloatArray,
    group: IntArray | None = None,
    *,
    start: FloatArray | None = None,
    tolerance: float = 1e-16,
) -> Alignment:
    """Maximum-likelihood registration of many sets at once, without statistics or checks.

    measured, reference : (..., N, 3), m. measured_cov, reference_cov : (N, 3, 3), m², with a
    positive definite sum. group : (N,), 0 … G − 1. start : (..., 3, 3), else the SVD's answer.
    tolerance : relative fall of χ² that a further step would bring, at which to stop.
    """
    y, x = np.asarray(measured, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    index = np.zeros(y.shape[-2], dtype=np.int64) if group is None else group
    member = (np.arange(index.max() + 1)[:, None] == index).astype(np.float64)  # (G, N)
    share = member / member.sum(axis=1, keepdims=True)
    y_mean, x_mean = share @ y, share @ x
    # Centred coordinates: metres away, the rotation and the translation would be one direction.
    yc, xc = y - y_mean[..., index, :], x - x_mean[..., index, :]
    trace = np.trace(measured_cov + reference_cov, axis1=-2, axis2=-1)
    if start is None:
        start = so3.project(np.einsum("n,...ni,...nj->...ij", trace.min() / trace, yc, xc))
    R = start
    isotropic = _isotropic(reference_cov)
    largest = max(np.abs(y).max(), np.abs(x).max())
    rounding = 8 * np.finfo(np.float64).eps * (largest or 1.0)
    for _ in range(_MAX_ITERATIONS):
        D = (
            reference_cov
            if isotropic
            else R[..., None, :, :] @ reference_cov @ transposed(R)[..., None, :, :]
        )
        W = np.linalg.inv(measured_cov + D)
        rotated = xc @ transposed(R)
        group_weight = np.einsum("gn,...nij->...gij", member, W)
        misclosure = np.einsum("gn,...nij,...nj->...gi", member, W, yc - rotated)
        t = np.linalg.solve(group_weight, misclosure[..., None])[..., 0]
        e = yc - rotated - t[..., index, :]
        We = (W @ e[..., None])[..., 0]
        chi2 = np.sum(e * We, axis=(-2, -1))
        # With the adjusted points in place of x, this gradient is that of χ² with S(R) varying.
        A = so3.hat(rotated + (D @ We[..., None])[..., 0])
        WA = W @ A
        gradient = np.einsum("...nji,...nj->...i", A, We)
        B = np.einsum("gn,...nij->...gij", member, WA)
        by_shift = transposed(B) @ np.linalg.solve(group_weight, B)
        turn = np.sum(transposed(A) @ WA, axis=-3)
        H = turn - np.sum(by_shift, axis=-3)
        floor = np.sum(np.trace(W, axis1=-2, axis2=-1), axis=-1) * rounding**2
        # Points on a line leave H singular but for rounding; a ridge above H's own rounding (or
        # that of the coordinates, where the points coincide) keeps the solution regular.
        ridge = floor + PRODUCT_ROUNDING * np.trace(turn, axis1=-2, axis2=-1)
        ridge = ridge[..., None, None] * np.eye(3)
        step = np.linalg.solve(H + ridge, -gradient[..., None])[..., 0]
        decrement = -np.sum(gradient * step, axis=-1)
        R = so3.exp(step) @ R
        converged = np.asarray(decrement <= tolerance * chi2 + floor)
        if converged.all():
            break
    R = so3.project(R)
    translation = y_mean + t - x_mean @ transposed(R)
    residual = y - x @ transposed(R) - translation[..., index, :]
    return Alignment(R, translation, residual, np.asarray(chi2), converged)


def transposed(m: FloatArray) -> FloatArray:
    """Matrices with rows and columns swapped."""
    return np.asarray(np.swapaxes(m, -1, -2))


def _isotropic(cov: FloatArray) -> bool:
    return bool(np.all(cov == cov[:, :1, :1] * np.eye(3)))
