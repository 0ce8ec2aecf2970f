"""What a wrong angle costs at the contact (Sect. 2.3, Fig. 4), and what a calibration is worth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig


@dataclass(frozen=True, slots=True)
class Sweep:
    """Error of the contact wrench against each angle of each sensor, at one posture.

    rpy : (3,), rad, of the terminal. internal : N, standard deviation of the internal forces per
    orthonormal mode; 0 for the smallest forces that carry the weight. deviation : (D,), rad, from
    the nominal mounting. force, torque : (n, 3, D), N and N·m about the LCS origin, lengths of
    ΔF_e[:3] and ΔF_e[3:]; with internal forces their quadratic mean.
    """

    rpy: FloatArray
    internal: float
    deviation: FloatArray
    force: FloatArray
    torque: FloatArray


def sensitivity(
    rig: Rig,
    rpy: FloatArray,
    *,
    internal: float = 0.0,
    span: float = 0.05,
    points: int = 101,
) -> Sweep:
    """Sweep roll, pitch and yaw of one sensor after the other by ±span about the nominal mounting.

    The sensors' forces balance the weight over the true mounting J′, the controller assumes the
    nominal one J: F = −J′ᵀ(J′J′ᵀ)⁻¹ R_g G + U c and ΔF_e = (J − J′) F (Eq. 16–19 corrected), U the
    null space of J′ and c ~ N(0, internal²). The mean square over c is summed in closed form.

    Raises UsageError for numbers that make no sweep.
    """
    if not 0.0 < span < np.pi or points < 2:
        raise UsageError(f"a sweep of ±{span:g} rad in {points} points is none")
    if not 0.0 <= internal < np.inf:
        raise UsageError(f"the internal forces are {internal:g} N", hint="give 0 or more")
    R = so3.from_rpy(rpy)
    deviation = np.linspace(-span, span, points)
    angles = np.broadcast_to(rig.nominal_rpy, (rig.n, 3, points, rig.n, 3)).copy()
    for i in range(rig.n):
        for j in range(3):
            angles[i, j, :, i, j] += deviation
    error = rms_error(rig, R, so3.from_rpy(rig.nominal_rpy), so3.from_rpy(angles), internal)
    return Sweep(rpy, internal, deviation, force=error[..., 0], torque=error[..., 1])


def rms_error(
    rig: Rig, R: FloatArray, assumed: FloatArray, true: FloatArray, internal: float
) -> FloatArray:
    """Force (N) and torque (N·m) error (..., 2) of the contact wrench at the posture R (3, 3).

    assumed, true : (..., n, 3, 3), mountings that broadcast. internal : N, see `Sweep`.
    """
    J, J_true = np.broadcast_arrays(jacobian(rig, R, assumed), jacobian(rig, R, true))
    down = R.T @ (rig.mass.value * rig.gravity * np.array([0.0, 0.0, -1.0]))
    load = np.concatenate([down, np.cross(rig.barycentre.value, down)])  # R_g G
    across = np.swapaxes(J_true, -1, -2)
    each = np.broadcast_to(load, J_true.shape[:-1])[..., None]
    F = -across @ np.linalg.solve(J_true @ across, each)
    U = np.swapaxes(np.linalg.svd(J_true, full_matrices=True)[2][..., 6:, :], -1, -2)
    # ΔF_e of the smallest forces, and of each unit internal force.
    error, spread = ((J - J_true) @ forces for forces in (F, U))
    square = error[..., 0] ** 2 + internal**2 * np.sum(spread**2, axis=-1)
    return np.asarray(np.sqrt(square.reshape(*square.shape[:-1], 2, 3).sum(axis=-1)))


def jacobian(rig: Rig, R: FloatArray, X: FloatArray) -> FloatArray:
    """J (..., 6, 3n) of Eq. 11 corrected: rows Rᵀ X_i and r̂_i Rᵀ X_i; X (..., n, 3, 3)."""
    force = R.T @ X
    blocks = np.concatenate([force, so3.hat(rig.hinge) @ force], axis=-2)  # (..., n, 6, 3)
    blocks = np.moveaxis(blocks, -3, -2)
    return np.asarray(blocks.reshape(*blocks.shape[:-2], 3 * rig.n))


@dataclass(frozen=True, slots=True)
class Stake:
    """Error of the contact wrench from the angles of one calibration, at one posture.

    rpy : (3,), rad, of the terminal. internal : N, as in `Sweep`. off, std : (n, 3), rad, the
    calibrated angles less the nominal ones, and their standard uncertainties. force, torque :
    (n, 3), N and N·m, standard uncertainty of the contact wrench from that angle alone.
    before : (2,), force (N) and torque (N·m) error with the nominal mounting. after : (2,), their
    standard uncertainty with the calibrated one, all angles together with their correlations.
    """

    rpy: FloatArray
    internal: float
    off: FloatArray
    std: FloatArray
    force: FloatArray
    torque: FloatArray
    before: FloatArray
    after: FloatArray


def stake(
    rig: Rig,
    rotation: FloatArray,
    covariance: FloatArray,
    rpy: FloatArray,
    *,
    internal: float = 0.0,
) -> Stake:
    """The sensors are mounted as `rotation` (n, 3, 3) says, and its errors are those of
    `covariance` (3n, 3n), rad², left perturbations in the BCS; rpy (3,), rad, of the terminal.
    """
    n = rig.n
    angles = so3.to_rpy(rotation)
    std = np.sqrt(so3.rpy_variance(rotation, covariance))
    single = np.broadcast_to(angles, (n, 3, n, 3)).copy()
    for i in range(n):
        single[i, :, i] += np.diag(std[i])
    values, vectors = np.linalg.eigh(covariance)
    steps = (vectors * np.sqrt(np.maximum(values, 0.0))).T.reshape(3 * n, n, 3)
    R = so3.from_rpy(rpy)
    alone = rms_error(rig, R, so3.from_rpy(single), rotation, internal)
    together = rms_error(rig, R, so3.exp(steps) @ rotation, rotation, internal)
    return Stake(
        rpy,
        internal,
        off=so3.wrapped(angles - rig.nominal_rpy),
        std=std,
        force=alone[..., 0],
        torque=alone[..., 1],
        before=rms_error(rig, R, so3.from_rpy(rig.nominal_rpy), rotation, internal),
        after=np.sqrt(np.sum(together**2, axis=0)),
    )
