"""Rotations: batched over leading axes, perturbed on the left, R_true = exp([δ]×) R.

Vectors have shape (..., 3), matrices (..., 3, 3). Angles are roll, pitch, yaw with
R = Rz(yaw) Ry(pitch) Rx(roll) (the paper's Eq. 8, URDF's rpy). Every function accepts complex
perturbations where it is analytic, so that Jacobians can be checked by complex step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tdfscal.records import BoolArray, FloatArray


def hat(v: npt.ArrayLike) -> FloatArray:
    """Skew matrix [v]× of v (..., 3), so that hat(a) @ b = a × b (Eq. 7)."""
    v = np.asarray(v)
    m = np.zeros((*v.shape, 3), dtype=np.result_type(v, np.float64))
    m[..., 0, 1], m[..., 0, 2] = -v[..., 2], v[..., 1]
    m[..., 1, 0], m[..., 1, 2] = v[..., 2], -v[..., 0]
    m[..., 2, 0], m[..., 2, 1] = -v[..., 1], v[..., 0]
    return m


def axial(M: FloatArray) -> FloatArray:
    """Σ_j x_j × e_j (..., 3) of the columns x_j of M (..., 3, 3): −2 v of [v]×."""
    parts = [M[..., a, b] - M[..., b, a] for a, b in ((1, 2), (2, 0), (0, 1))]
    return np.stack(parts, axis=-1)


def information_of_crossing(weight: FloatArray, covariance: FloatArray) -> FloatArray:
    """E([ν]×ᵀ W [ν]×) (..., 3, 3) of vectors ν with a covariance and W, (..., 3, 3), symmetric.

    What noise ν in levers fakes of information on turns.
    """
    product = weight @ covariance
    mixed = product + np.swapaxes(product, -1, -2)
    traces = (np.trace(each, axis1=-2, axis2=-1) for each in (weight, covariance, product))
    w, c, wc = (trace[..., None, None] for trace in traces)
    return np.asarray((w * c - wc) * np.eye(3) - w * covariance - c * weight + mixed)


def _angle(v: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Length of v by √(v·v), which unlike a norm is analytic in v."""
    return np.asarray(np.sqrt(np.sum(v * v, axis=-1)))[..., None, None]


def _matrix(*rows: Sequence[npt.NDArray[Any]]) -> FloatArray:
    """Matrices (..., 3, 3) of rows of entries (...)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def exp(v: npt.ArrayLike) -> FloatArray:
    """Rotation by the vector v (..., 3) in rad: that of its unit quaternion, exact at 0."""
    v = np.asarray(v)
    half = _angle(v)[..., 0, 0] / 2
    w = np.cos(half)
    x, y, z = np.moveaxis(0.5 * np.sinc(half / np.pi)[..., None] * v, -1, 0)  # sin(πx)/(πx)
    return _matrix(
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    )


def log(R: npt.ArrayLike) -> FloatArray:
    """Rotation vector (..., 3) in rad of R (..., 3, 3), of length at most π."""
    q = to_quaternion(R)
    v, w = q[..., :3], q[..., 3]
    s = np.linalg.norm(v, axis=-1)
    half = np.arctan2(s, w)  # w ≥ 0, so half ≤ π/2
    # half/s → 1/w at s → 0
    scale = 2 * np.where(s > 1e-150, half / np.where(s > 1e-150, s, 1.0), 1.0)
    return np.asarray(scale[..., None] * v)


def left_jacobian(v: npt.ArrayLike) -> FloatArray:
    """J (..., 3, 3) with exp(v + dv) = exp(J dv) exp(v) to first order."""
    v = np.asarray(v)
    a, k = _angle(v), hat(v)
    near = np.abs(a) < 1e-2
    safe = np.where(near, 1.0, a)
    # (a − sin a)/a³ cancels near 0; its series there is exact to 1e-17.
    b = np.where(near, 1 / 6 - a**2 / 120 + a**4 / 5040, (safe - np.sin(safe)) / safe**3)
    return np.asarray(np.eye(3) + 0.5 * np.sinc(a / (2 * np.pi)) ** 2 * k + b * (k @ k))


def project(M: npt.ArrayLike) -> FloatArray:
    """Nearest rotation to M (..., 3, 3) in the Frobenius norm, det = +1 always."""
    U, _, Vt = np.linalg.svd(np.asarray(M, dtype=np.float64))
    sign = np.linalg.det(U @ Vt)
    U = U.copy()
    U[..., :, 2] *= np.where(sign < 0, -1.0, 1.0)[..., None]
    return np.asarray(U @ Vt)


def from_rpy(rpy: npt.ArrayLike) -> FloatArray:
    """Rz(yaw) Ry(pitch) Rx(roll) of rpy (..., 3) in rad (Eq. 8)."""
    rpy = np.asarray(rpy, dtype=np.float64)
    (sr, sp, sy), (cr, cp, cy) = (np.moveaxis(t, -1, 0) for t in (np.sin(rpy), np.cos(rpy)))
    return _matrix(
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    )


def to_rpy(R: npt.ArrayLike) -> FloatArray:
    """Roll, pitch, yaw (..., 3) in rad of R (..., 3, 3); pitch in [−π/2, π/2]."""
    R = np.asarray(R, dtype=np.float64)
    cp = np.hypot(R[..., 0, 0], R[..., 1, 0])
    return np.stack(
        [
            np.arctan2(R[..., 2, 1], R[..., 2, 2]),
            np.arctan2(-R[..., 2, 0], cp),
            np.arctan2(R[..., 1, 0], R[..., 0, 0]),
        ],
        axis=-1,
    )


#: Cosine of the pitch below which roll and yaw are not separable: 1.1° from ±90°. There they are
#: one turn, and noise of a milliradian turns the one into the other.
LOCKED = 0.02


def locked(R: npt.ArrayLike) -> BoolArray:
    """Whether roll and yaw of R (..., 3, 3) are not separable."""
    R = np.asarray(R, dtype=np.float64)
    return np.asarray(np.hypot(R[..., 0, 0], R[..., 1, 0]) < LOCKED)


def deviations(R: npt.ArrayLike, base: npt.ArrayLike) -> FloatArray:
    """Roll, pitch, yaw (..., 3) of R less those of base, less whole turns, rad.

    Where base is locked: the turns about the axes of the BCS from base to R.
    """
    R, base = np.asarray(R, dtype=np.float64), np.asarray(base, dtype=np.float64)
    angles = wrapped(to_rpy(R) - to_rpy(base))
    stuck = locked(base)
    if not stuck.any():
        return angles
    turns = log(R @ np.swapaxes(base, -1, -2))
    return np.asarray(np.where(stuck[..., None], turns, angles))


def rpy_jacobian(R: npt.ArrayLike) -> FloatArray:
    """J (..., 3, 3) with d(roll, pitch, yaw) = J δ for exp([δ]×) R.

    Where R is locked roll and yaw are the same turn: there it is the identity, and stands for the
    turns about the axes of the BCS.
    """
    R = np.asarray(R, dtype=np.float64)
    stuck = locked(R)
    _, pitch, yaw = np.moveaxis(to_rpy(R), -1, 0)
    cy, sy, cp, tp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.tan(pitch)
    zero, one = np.zeros_like(cy), np.ones_like(cy)
    jacobian = _matrix([cy / cp, sy / cp, zero], [-sy, cy, zero], [cy * tp, sy * tp, one])
    return np.where(stuck[..., None, None], np.eye(3), jacobian)


def entry_std(R: npt.ArrayLike, covariance: FloatArray) -> FloatArray:
    """Standard uncertainties (n, 3, 3) of the entries of R (n, 3, 3): δR = [δ]× R.

    covariance : (3n, 3n), rad², of the left perturbations δ of all of them.
    """
    R = np.asarray(R, dtype=np.float64)
    own = np.arange(len(R))
    blocks = covariance.reshape(len(R), 3, len(R), 3)[own, :, own]
    slopes = np.cross(np.eye(3)[:, None], np.swapaxes(R, 1, 2)[:, None])  # of δ, column, row
    variance = np.einsum("najr,nab,nbjr->nrj", slopes, blocks, slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def rpy_covariance(R: npt.ArrayLike, covariance: FloatArray) -> FloatArray:
    """Covariance (n, 3, 3), rad², of roll, pitch, yaw of each of R (n, 3, 3).

    covariance : (3n, 3n), rad², of the left perturbations δ of all of them.
    """
    J = rpy_jacobian(R)
    own = np.arange(len(J))
    blocks = covariance.reshape(len(J), 3, len(J), 3)[own, :, own]
    return np.asarray(J @ blocks @ np.swapaxes(J, 1, 2))


def rpy_variance(R: npt.ArrayLike, covariance: FloatArray) -> FloatArray:
    """Variance (n, 3), rad², of roll, pitch, yaw; see `rpy_covariance`."""
    return np.asarray(np.diagonal(rpy_covariance(R, covariance), axis1=1, axis2=2))


def wrapped(angle: npt.ArrayLike) -> FloatArray:
    """Angles (...) in rad, less whole turns: in [−π, π)."""
    return np.asarray((np.asarray(angle, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi)


def to_quaternion(R: npt.ArrayLike) -> FloatArray:
    """Unit quaternion (..., 4) as x, y, z, w with w ≥ 0 of R (..., 3, 3)."""
    R = np.asarray(R, dtype=np.float64)
    d = np.diagonal(R, axis1=-2, axis2=-1)
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    # Each row is 4 q_j q for one component j: the largest |q_j| loses no digits.
    sum_, dif = R + np.swapaxes(R, -1, -2), R - np.swapaxes(R, -1, -2)
    xy, xz, yz = sum_[..., 0, 1], sum_[..., 0, 2], sum_[..., 1, 2]
    wx, wy, wz = dif[..., 2, 1], dif[..., 0, 2], dif[..., 1, 0]
    candidates = np.stack(
        [
            np.stack([1 + x - y - z, xy, xz, wx], axis=-1),
            np.stack([xy, 1 - x + y - z, yz, wy], axis=-1),
            np.stack([xz, yz, 1 - x - y + z, wz], axis=-1),
            np.stack([wx, wy, wz, 1 + x + y + z], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(candidates, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., 3:] < 0, -q, q))


def from_directions(
    nominal_rpy: Sequence[float], directions: dict[Any, tuple[float, float, float]]
) -> FloatArray:
    """Rotation (3, 3) next to the nominal mounting whose measured axes point along directions.

    What no axis shows stays as it is nominally: readings turned by it are the same.
    """
    R = from_rpy(np.array(nominal_rpy))
    if len(directions) != 1:
        columns = [directions.get(axis, np.zeros(3)) for axis in "xyz"]
        return project(np.stack(columns, axis=1)) if directions else R
    ((axis, towards),) = directions.items()
    own, beside = R.T["xyz".index(axis)], R.T["yzx".index(axis)]
    about = np.cross(own, towards)
    sine, cosine = np.linalg.norm(about), float(own @ np.array(towards))
    if sine < 1e-9:
        return R if cosine > 0 else exp(np.pi * beside) @ R
    return np.asarray(exp(np.arctan2(sine, cosine) * about / sine) @ R)
