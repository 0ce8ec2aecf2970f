"""May this result steer a machine: the quality gate, and conformity of the contact wrench.

The gate judges turns about the BCS's axes. A sensor has these however it is mounted. Roll, pitch
and yaw are the same turns where its axes lie along those of the BCS; for one that is pitched by a
right angle roll and yaw are one turn, and neither is known for itself.

The error of the contact force is a vector with the calibration's covariance Σ; what is limited is
its length. The expanded uncertainty U is the length that it stays below with the probability that
k = 2 gives in one dimension, 95.45 %; for an error along one line it is 2σ. The decision rule is
guarded acceptance with a guard band of width U (JCGM 106): conforming where U ≤ limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy import special

from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import gravity, sensing
from tdfscal.model.statics import carrying
from tdfscal.numerics import so3
from tdfscal.records import ANGLES, BoolArray, FloatArray, Rig, Rotations
from tdfscal.significance import EXPANDED_COVERAGE, MOST_REJECTED

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
    # What explains the misfit before the misfit, which widens the uncertainties.
    limits, found = rig.acceptance, list(suspicions)
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


#: Directions of an octant along each of its coordinates.
_NODES = 48


@record
class Limited:
    """One limited quantity, N or N·m.

    std : (3,), standard uncertainties of its components, LCS. expanded : U, of its length.
    limit : stated limit, or ∞. exceeding : probability that the error's length exceeds it.
    """

    quantity: str
    unit: str
    std: FloatArray
    expanded: float
    limit: float
    exceeding: float

    @property
    def within_limit(self) -> bool:
        """U ≤ limit."""
        return self.expanded <= self.limit


@record
class Conformity:
    """Contact force and torque at one posture, at rest without internal forces.

    rpy : roll, pitch, yaw of the terminal, rad. covariance : (6, 6), of the contact wrench in the
    LCS about its origin, from the calibration; N and N·m.
    """

    rpy: tuple[float, float, float]
    force: Limited
    torque: Limited
    covariance: FloatArray

    @property
    def conforms(self) -> bool:
        """Both quantities conform."""
        return self.force.within_limit and self.torque.within_limit

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What does not conform, for the quality gate."""
        parts = self.force, self.torque
        return tuple(_finding(part, self.rpy) for part in parts if not part.within_limit)


def assess_stated(given: Calibrated) -> Conformity | None:
    """Judge by the rig file's own limits of the contact wrench; None where it states none."""
    return assess(given) if given.rig.acceptance.states_contact else None


def assess(given: Calibrated) -> Conformity:
    """Judge the contact wrench's uncertainty at the posture of the rig file's limits.

    A limit that is stated nowhere is ∞.
    """
    from tdfscal.wrench.contact_wrench import covariance  # where limits of it are stated

    stated = given.rig.acceptance
    cov = covariance(given, *at_rest(given, stated.contact_rpy))[0]
    force, torque = (
        _limited(quantity, unit, cov[rows, rows], np.inf if limit is None else limit)
        for quantity, unit, rows, limit in stated.contact_limits
    )
    return Conformity(stated.contact_rpy, force, torque, cov)


def at_rest(given: Calibrated, rpy: tuple[float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Servo positions and readings, (1, n, 3) each, of the smallest forces at a posture."""
    state = given.state
    R = so3.from_rpy(np.array(rpy))
    arm, weight = state.hinge @ R.T, state.mass * gravity(state, given.rig.gravity)
    force = carrying(arm, R @ state.barycentre, weight)
    reading = np.linalg.solve(sensing(state), force[..., None])[..., 0] + state.zero
    return (arm + state.datum)[None], reading[None]


def _limited(quantity: str, unit: str, cov: FloatArray, limit: float) -> Limited:
    std = np.sqrt(np.diagonal(cov))
    known = bool(np.isfinite(std).all())
    expanded = coverage_radius(cov) if known else np.inf
    inside = within(cov, limit) if known else float(limit == np.inf)
    return Limited(quantity, unit, std, expanded, limit, 1.0 - inside)


def coverage_radius(cov: FloatArray, coverage: float = EXPANDED_COVERAGE) -> float:
    """Length that a normal vector of covariance (3, 3) and mean 0 stays below."""
    top = float(np.sqrt(np.linalg.eigvalsh(cov)[-1].clip(0.0)))
    if top == 0.0:
        return 0.0
    unit = cov / top**2
    most = np.sqrt(special.chdtri(3, 1 - coverage))  # three directions alike; any others need less

    def short(radius: float) -> float:
        return within(unit, radius) - coverage

    from scipy.optimize import brentq  # slow to import, seldom needed

    return float(top * brentq(short, 0.0, 1.001 * most))


def within(cov: FloatArray, radius: float) -> float:
    """Probability that a normal vector of covariance (3, 3) and mean 0 is no longer than this.

    It is √(Σᵢ σᵢ² uᵢ²) · √χ²₃ in a direction u that is uniform on the sphere, whose octants are
    alike.
    """
    square, share = _octant()
    length = np.maximum(square @ np.linalg.eigvalsh(cov).clip(0.0), 1e-300)
    return float(min(1.0, share @ special.gammainc(1.5, 0.5 * radius**2 / length)))


@cache
def _octant() -> tuple[FloatArray, FloatArray]:
    """Squares (N, 3) of directions in an octant and their shares (N,) of its surface.

    Gauss–Legendre along the axis of the largest variance, equal steps about it.
    """
    node, share = np.polynomial.legendre.leggauss(_NODES)
    about = (np.arange(_NODES) + 0.5) * np.pi / (2 * _NODES)
    along, turn = np.meshgrid(0.5 * (1.0 + node), about, indexing="ij")
    across = 1.0 - along**2
    square = np.stack([across * np.cos(turn) ** 2, across * np.sin(turn) ** 2, along**2], axis=-1)
    return square.reshape(-1, 3), np.repeat(0.5 * share / _NODES, _NODES)


def _finding(part: Limited, rpy: tuple[float, float, float]) -> Finding:
    values: dict[str, Value] = {
        "rpy": [f"{angle:g}" for angle in rpy],
        "limit": part.limit,
        "exceeding": part.exceeding,
    }
    return Finding(
        "contact-uncertain", (part.quantity,), part.expanded, part.unit, values=values, rejects=True
    )
