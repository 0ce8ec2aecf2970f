"""What a calibration is worth at the contact: the error without it, and what it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.studies.sensitivity import rms_error


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
    R = so3.from_rpy(np.asarray(rpy, dtype=np.float64))
    off = so3.wrapped(angles - rig.nominal_rpy)
    alone = rms_error(rig, R, so3.from_rpy(single), rotation, internal)
    together = rms_error(rig, R, so3.exp(steps) @ rotation, rotation, internal)
    return Stake(
        rpy=np.asarray(rpy, dtype=np.float64),
        internal=internal,
        off=off,
        std=std,
        force=alone[..., 0],
        torque=alone[..., 1],
        before=rms_error(rig, R, so3.from_rpy(rig.nominal_rpy), rotation, internal),
        after=np.sqrt(np.sum(together**2, axis=0)),
    )
