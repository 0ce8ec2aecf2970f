"""A calibration file says the same thing several times; these checks compare."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from typing import Any

import numpy as np

from tdfscal.files.calibration.parts import Mounting
from tdfscal.files.field_types import fault
from tdfscal.numerics import so3
from tdfscal.records import FloatArray

SAME = 1e-9
"""Two statements of one rotation agree within this, per matrix element."""
SAME_STD = 1e-6
"""Two statements of one standard uncertainty agree within this, relative."""
ALTERED = (
    "for new zeros or another load run `tdfscal update CALIBRATION CAMPAIGN -o FILE`; else take "
    "the file as it was written, with all digits, or calibrate again"
)
"""What to do with a calibration file that was edited."""


def check_covariance(matrix: FloatArray, place: tuple[str, str] = ("covariance", "matrix")) -> None:
    """Refuse a matrix that is not symmetric and positive semidefinite to rounding."""
    unit = matrix / (np.abs(matrix).max() or 1.0)
    if not np.allclose(unit, unit.T, rtol=0, atol=1e-12):
        raise fault("is not symmetric", *place, hint=ALTERED)
    if np.linalg.eigvalsh(unit)[0] < -1e-12:
        raise fault("is not positive semidefinite", *place, hint=ALTERED)


@np.errstate(over="ignore", invalid="ignore")
def check_rotation(support: Mounting, covariance: FloatArray, index: int) -> None:
    """Refuse a support whose rotation, angles, quaternion and uncertainties disagree.

    covariance : (3, 3), rad², of the support's rotation, perturbed in the BCS.
    """
    place = ("supports", index)
    R = np.array(support.rotation)
    if not np.allclose(R @ R.T, np.eye(3), rtol=0, atol=SAME) or np.linalg.det(R) < 0:
        raise fault(
            "is not a rotation: not orthonormal, or det ≠ +1", *place, "rotation", hint=ALTERED
        )
    if not np.allclose(so3.from_rpy(support.rpy), R, rtol=0, atol=SAME):
        raise fault("is not the angles of `rotation`", *place, "rpy", hint=ALTERED)
    if not np.allclose(_from_quaternion(support.quaternion), R, rtol=0, atol=SAME):
        raise fault("is not the quaternion of `rotation`", *place, "quaternion_xyzw", hint=ALTERED)
    if support.turn_std is not None:
        own = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
        if not np.allclose(support.turn_std, own, rtol=SAME_STD, atol=0):
            raise fault("does not follow from the covariance", *place, "turn_std", hint=ALTERED)
    if not so3.locked(R):
        J = so3.rpy_jacobian(R)
        std = np.sqrt(np.maximum(np.diagonal(J @ covariance @ J.T), 0.0))
        if not np.allclose(support.rpy_std, std, rtol=SAME_STD, atol=0):
            raise fault("does not follow from the covariance", *place, "rpy_std", hint=ALTERED)


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
    if sine < SAME:
        return R if cosine > 0 else so3.exp(np.pi * beside) @ R
    return np.asarray(so3.exp(np.arctan2(sine, cosine) * about / sine) @ R)


def check_shape(rows: Sized, n: int, name: str, *place: str | int) -> None:
    """Refuse a table, of the Monte Carlo or at another place, that has not one row per support."""
    if len(rows) != n:
        where = place or ("monte_carlo",)
        raise fault(f"must have a row per support, {n}, got {len(rows)}", *where, name)


def _from_quaternion(q: tuple[float, float, float, float]) -> FloatArray:
    """Rotation of q = (x, y, z, w); no rotation where q is not of unit length."""
    v, w = np.array(q[:3]), np.float64(q[3])
    return np.asarray((w**2 - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * so3.hat(v))
