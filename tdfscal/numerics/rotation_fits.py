"""Rotations fitted for many problems at once: rigid alignment of points, descents on SO(3)ⁿ.

Alignment is the maximum-likelihood one, without judgement. A descent minimises over SO(3)ⁿ

    cost(X) = |A y(X)|²,    y(X) = (vec X₁, …, vec Xₙ, 1), vec by rows:

what is left of the balance when all other parameters are eliminated. A may be common to all
starts, or differ between them.
"""

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


_DAMPING, _UP, _DOWN, _GIVEN_UP = 1e-6, 10.0, 0.1, 1e12
_HATS = so3.hat(np.eye(3))  # [e_j]×


@record
class Descent:
    """Ends of T descents.

    rotation : (T, n, 3, 3). cost : (T,). settled : (T,), the last step was below the tolerance.
    """

    rotation: FloatArray
    cost: FloatArray
    settled: BoolArray


def stacked(rotation: FloatArray) -> FloatArray:
    """Y (..., 9n + 1) of rotations (..., n, 3, 3)."""
    batch = rotation.shape[:-3]
    return np.concatenate([rotation.reshape(*batch, -1), np.ones((*batch, 1))], axis=-1)


def costs(root: FloatArray, rotation: FloatArray) -> FloatArray:
    """|A y|² (T,) of rotations (T, n, 3, 3); root A (m, 9n + 1) or (T, m, 9n + 1)."""
    residual = (root @ stacked(rotation)[..., None])[..., 0]
    return np.asarray(np.sum(residual**2, axis=-1))


def crossed(rotation: FloatArray, slope: FloatArray) -> FloatArray:
    """X Gᵀ (T, n, 3, 3), G = ½ ∂cost/∂X, of the slope ½ ∂cost/∂y (T, 9n + 1)."""
    G = slope[:, :-1].reshape(rotation.shape)
    return np.asarray(rotation @ np.swapaxes(G, -1, -2))


def descend(
    root: FloatArray,
    start: FloatArray,
    *,
    iterations: int,
    tolerance: float,
    curved: bool = False,
) -> Descent:
    """Minimise each cost from its start (T, n, 3, 3) by damped Gauss–Newton or Newton steps.

    Parameters
    ----------
    root : A, (m, 9n + 1), or (T, m, 9n + 1) for a problem of its own per start.
    tolerance : change of |A y| by a step, in the units of the rows, below which it has settled.
    curved : Newton's steps, with the second order of exp: fast near a minimum, but far from one
        they run to saddles.

    Notes
    -----
    A step that does not descend is taken back and damped (Levenberg), problem by problem, so that
    no trial can diverge and none slows the others down.
    """
    rotation, T = start.copy(), len(start)
    cost = costs(root, rotation)
    damping = np.full(T, 0.0)
    open_ = np.arange(T)
    gram = root[:, :-1].T @ root[:, :-1] if root.ndim == 2 else None
    for _ in range(iterations):
        own = root if root.ndim == 2 else root[open_]
        hessian, gradient, normal = _expansion(own, gram, rotation[open_], curved=curved)
        scale = np.einsum("tii->ti", normal)
        lifted = hessian.copy()
        np.einsum("tii->ti", lifted)[:] += damping[open_, None] * scale + np.finfo(float).tiny
        step = -_solve(lifted, gradient)
        trial = so3.exp(step.reshape(len(open_), -1, 3)) @ rotation[open_]
        new = costs(own, trial)
        size = np.sqrt(np.maximum(np.einsum("ti,tij,tj->t", step, normal, step), 0.0))
        lower = new <= cost[open_]
        down = open_[lower]
        rotation[down], cost[down] = trial[lower], new[lower]
        small = size < tolerance
        damping[open_] = np.where(
            lower, damping[open_] * _DOWN, np.maximum(_UP * damping[open_], _DAMPING)
        )
        open_ = open_[~small & (damping[open_] < _GIVEN_UP)]
        if len(open_) == 0:
            break
    settled = np.ones(T, dtype=bool)
    settled[open_] = False
    return Descent(rotation, cost, settled & (damping < _GIVEN_UP))


def _expansion(
    root: FloatArray, gram: FloatArray | None, rotation: FloatArray, *, curved: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Half the Hessian (T, 3n, 3n) and gradient (T, 3n) by left turns, and JᵀJ.

    gram : AᵀA (9n, 9n) of the rotations' columns, of a root that all starts share.
    """
    T, n = rotation.shape[:2]
    turned = _HATS @ rotation[:, :, None]  # (T, n, 3, 3, 3): [e_j]× X_i
    columns = np.swapaxes(turned.reshape(T, n, 3, 9), 2, 3)  # (T, n, 9, 3)
    if gram is None:
        blocks = [root[..., 9 * i : 9 * i + 9] @ columns[:, i] for i in range(n)]
        J = np.concatenate(blocks, axis=-1)
        normal = np.swapaxes(J, 1, 2) @ J
    else:
        normal, across = np.empty((T, 3 * n, 3 * n)), np.swapaxes(columns, 2, 3)
        for i in range(n):
            seen = (gram[:, 9 * i : 9 * i + 9] @ columns[:, i]).reshape(T, n, 9, 3)
            normal[:, :, 3 * i : 3 * i + 3] = (across @ seen).reshape(T, 3 * n, 3)
    residual = root @ stacked(rotation)[..., None]
    pulled = crossed(rotation, (np.swapaxes(root, -1, -2) @ residual)[..., 0])
    gradient = so3.axial(pulled).reshape(T, -1)  # <G, [e_j]× X> = (Σ_b x_b × g_b)_j
    if not curved:
        return normal, gradient, normal
    # Second order of exp: X → ½ [δ]×² X = ½ (δδᵀ − |δ|²) X.
    bend = (pulled + np.swapaxes(pulled, -1, -2)) / 2
    bend = bend - np.trace(pulled, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    hessian = normal.copy()
    for i in range(n):
        hessian[:, 3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += bend[:, i]
    return hessian, gradient, normal


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve (T, p, p) x = (T, p); a singular one takes no step."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrix, hermitian=True) @ right[..., None])[..., 0])
