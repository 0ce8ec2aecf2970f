"""The quality gate: may this result steer a machine? It judges turns about the BCS's axes.

A sensor has these however it is mounted. Roll, pitch and yaw are the same turns where its axes lie
along those of the BCS; for one that is pitched by a right angle roll and yaw are one turn, and
neither is known for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdfscal.acceptance.conformity import Conformity
from tdfscal.findings import Finding, Value
from tdfscal.numerics import so3
from tdfscal.records import ANGLES, BoolArray, FloatArray, Rig, Rotations
from tdfscal.significance import MOST_REJECTED

#: A turn goes by the angle's name where its axis is the angle's own within this, rad.
_SAME_AXIS = np.radians(20.0)
#: And only up to this pitch, rad, beyond which roll and yaw turn about much the same axis.
_LEVEL = np.radians(45.0)


def judge(
    rig: Rig,
    rotations: Rotations,
    birge: float,
    *,
    determined: BoolArray | None = None,
    used: int = 0,
    rejected: int = 0,
    suspicions: Sequence[Finding] = (),
    conformity: Conformity | None = None,
) -> tuple[Finding, ...]:
    """Reasons to reject rotations by the uncertainty of their turns about the BCS's axes.

    None that rejects: accepted. determined : (n,), sensors that are judged, by default all.
    used, rejected : numbers of postures. suspicions : harmful ones. conformity : of the contact
    wrench, where the rig file states a limit.
    """
    limits, found = rig.acceptance, list[Finding]()
    std, names = turn_std(rotations.covariance), turn_names(rotations.rotation)
    judged = np.ones(rig.n, dtype=np.bool_) if determined is None else determined
    for i, j in np.argwhere(~(std <= limits.angle_std) & judged[:, None]):
        values: dict[str, Value] = {"angle": names[i][j], "limit": limits.angle_std}
        found.append(
            Finding("angle-uncertain", (rig.supports[i],), float(std[i, j]), "rad", values=values)
        )
    if birge > limits.birge_max:
        values = {"limit": limits.birge_max}
        found.append(Finding("residuals-large", size=birge, values=values))
    if rejected > MOST_REJECTED * (used + rejected):
        values = {"postures": used + rejected, "limit": MOST_REJECTED}
        found.append(Finding("postures-rejected", size=rejected, values=values))
    found += suspicions
    reasons = tuple(replace(finding, rejects=True) for finding in found)
    return reasons if conformity is None else (*reasons, *conformity.findings)


def turn_std(covariance: FloatArray) -> FloatArray:
    """Standard uncertainty (n, 3), rad, of the turns about X, Y, Z; covariance (3n, 3n), rad²."""
    return np.sqrt(np.maximum(np.diagonal(covariance), 0.0)).reshape(-1, 3)


def turn_names(rotation: FloatArray) -> list[tuple[str, str, str]]:
    """Names of the turns about X, Y, Z of each sensor's rotation (n, 3, 3)."""
    names = []
    for R in rotation:
        axes = np.linalg.inv(so3.rpy_jacobian(R))  # columns: what roll, pitch, yaw turn about
        same = np.abs(np.diagonal(axes)) > np.cos(_SAME_AXIS)
        level = np.hypot(R[0, 0], R[1, 0]) > np.cos(_LEVEL)
        x, y, z = (ANGLES[j] if same[j] and level else f"turn about {'XYZ'[j]}" for j in range(3))
        names.append((x, y, z))
    return names


def prior_turn_std(rpy_std: FloatArray, rotation: FloatArray) -> FloatArray:
    """Standard deviation (n, 3), rad, of the turns by a prior on roll, pitch, yaw; ∞ for none."""
    axes = np.linalg.inv(so3.rpy_jacobian(rotation))
    part = np.where(np.abs(axes) > 1e-9, np.abs(axes), 0.0)
    known = np.where(np.isfinite(rpy_std), rpy_std, 0.0)
    std = np.sqrt((part**2 @ known[:, :, None] ** 2)[..., 0])
    free = (part @ np.isinf(rpy_std)[:, :, None])[..., 0] > 0
    return np.where(free, np.inf, std)


def locked_sensors(supports: Sequence[str], rotation: FloatArray) -> list[Finding]:
    """Name the sensors whose roll and yaw are one turn; rotation (n, 3, 3)."""
    return [
        Finding("angles-locked", (name,), float(np.arcsin(np.clip(-R[2, 0], -1, 1))), "rad")
        for name, R, stuck in zip(supports, rotation, so3.locked(rotation), strict=True)
        if stuck
    ]
