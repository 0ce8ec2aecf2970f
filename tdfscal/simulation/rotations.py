"""Rotations as the simulator needs them; written apart from `numerics` on purpose."""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray

#: [e_x]×, [e_y]×, [e_z]× in rows, (3, 9).
_GENERATORS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


def hat(v: FloatArray) -> FloatArray:
    """[v]×, (..., 3, 3), of v, (..., 3)."""
    return np.asarray((v @ _GENERATORS).reshape(*v.shape, 3))


def vee(m: FloatArray) -> FloatArray:
    """v, (..., 3), with [v]× = m − mᵀ, of m (..., 3, 3)."""
    return np.asarray(m.reshape(*m.shape[:-2], 9) @ _GENERATORS.T)


def exp(v: FloatArray) -> FloatArray:
    """Rotation matrix (..., 3, 3) of a rotation vector (..., 3), rad (Rodrigues)."""
    half = 0.5 * np.sqrt(np.sum(v * v, axis=-1))[..., None, None]
    # sinc keeps both coefficients exact to rounding down to angle 0.
    share = np.sinc(half / np.pi)
    k = hat(v)
    return np.asarray(np.eye(3) + share * (np.cos(half) * k + 0.5 * share * (k @ k)))


def log(R: FloatArray) -> FloatArray:
    """Rotation vector (..., 3), rad, of R (..., 3, 3); for angles well below π."""
    sine = 0.5 * vee(R)
    length = np.linalg.norm(sine, axis=-1)
    angle = np.arctan2(length, 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0))
    ratio = np.divide(angle, length, out=np.ones_like(length), where=length > 0.0)
    return np.asarray(sine * ratio[..., None], dtype=np.float64)


def from_rpy(rpy: FloatArray) -> FloatArray:
    """Rz(yaw)·Ry(pitch)·Rx(roll), (..., 3, 3), of roll, pitch, yaw (..., 3), rad (Eq. 8)."""
    x, y, z = np.eye(3)
    return exp(rpy[..., 2:] * z) @ exp(rpy[..., 1:2] * y) @ exp(rpy[..., :1] * x)


def fit_rotation(body: FloatArray, world: FloatArray) -> FloatArray:
    """Rotation (..., 3, 3) that turns centred points body (..., n, 3) best onto world."""
    u, _, vt = np.linalg.svd(np.swapaxes(world, -1, -2) @ body)
    d = np.zeros((*u.shape[:-2], 3))
    d[..., :2] = 1.0
    d[..., 2] = np.sign(np.linalg.det(u @ vt))
    return np.asarray((u * d[..., None, :]) @ vt, dtype=np.float64)


def fit(body: FloatArray, world: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rigid transform that takes points body (n, 3) best to world (..., n, 3): R, T."""
    middle, centre = body.mean(axis=0), world.mean(axis=-2)
    R = fit_rotation(body - middle, world - centre[..., None, :])
    return R, centre - R @ middle


def to_rpy(R: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (..., 3), rad, of R (..., 3, 3)."""
    pitch = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 0, 0], R[..., 1, 0]))
    roll = np.arctan2(R[..., 2, 1], R[..., 2, 2])
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    return np.stack([roll, pitch, yaw], axis=-1)
