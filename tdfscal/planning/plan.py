"""A plan and what was asked of it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tdfscal.acceptance.gate import coverage_radius
from tdfscal.frozen import record
from tdfscal.planning.candidates import Candidates, Limits
from tdfscal.planning.predicted_information import Forecast
from tdfscal.records import FloatArray, IntArray, Rig

Objective = Literal["angles", "wrench"]


@record
class Request:
    """What is asked for.

    noise : N per axis, expected standard uncertainty of a posture's mean force, beyond what the
    rig declares. at : roll, pitch, yaw, rad, posture at which the contact wrench is wanted.
    """

    limits: Limits
    noise: float = 1.0
    candidates: int = 2000
    objective: Objective = "angles"


@record
class Plan:
    """Postures in the order to drive them, K rows.

    approach : (K,), ±1, side to come from. returns : rows that repeat the first posture. given :
    postures recorded before. before : what these alone promise, None without any. expected : of all
    together. random : of as many random postures within the same limits.
    """

    rig: Rig
    request: Request
    postures: Candidates
    approach: IntArray
    returns: IntArray
    given: int
    before: Forecast | None
    expected: Forecast
    random: Forecast

    def __len__(self) -> int:
        return len(self.postures)

    @property
    def position(self) -> FloatArray:
        """Hinge centres (K, n, 3) to command, m, BCS: with the displacements that squeeze where a
        stiffness is known, else the forces postures.squeeze are to be servoed to.
        """
        return self.postures.position(self.request.limits)

    @property
    def improvement(self) -> float:
        """Mean standard uncertainty of random postures over that of the plan."""
        if self.request.objective == "wrench":
            return wrench_size(self.rig, self.random) / wrench_size(self.rig, self.expected)
        return self.random.mean / self.expected.mean

    @property
    def tour(self) -> float:
        """Way of the slowest axis over the whole plan, m."""
        between = np.diff(self.position, axis=0)
        return float(np.max(np.abs(between), axis=(1, 2)).sum()) if len(self) > 1 else 0.0


def contact_expanded(of: Forecast) -> tuple[float, float] | None:
    """Expanded uncertainties of contact force, N, and torque, N·m; None where none was asked for.

    As the quality gate has them, their components taken as uncorrelated.
    """
    if of.contact_force is None or of.contact_torque is None:
        return None
    force, torque = (coverage_radius(np.diag(v**2)) for v in (of.contact_force, of.contact_torque))
    return force, torque


def contact_conforms(rig: Rig, of: Forecast) -> bool:
    """Whether the contact wrench is to be expected within the limits that the rig file states."""
    limits, expected = rig.acceptance.contact_limits, contact_expanded(of)
    return expected is None or all(
        limit is None or size <= limit for size, (*_, limit) in zip(expected, limits, strict=True)
    )


def hinge_radius(rig: Rig) -> float:
    """Mean distance of the hinges from their middle, m."""
    return float(np.linalg.norm(rig.hinge - rig.hinge.mean(axis=0), axis=1).mean())


def wrench_size(rig: Rig, of: Forecast) -> float:
    """Root of the objective `wrench`, N."""
    if of.contact_force is None or of.contact_torque is None:
        return np.nan
    variances = [*of.contact_force**2, *(of.contact_torque / hinge_radius(rig)) ** 2]
    return float(np.sqrt(np.mean(variances)))
