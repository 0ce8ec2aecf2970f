"""Is the contact wrench known well enough at the posture that matters? (JCGM 106)

The error of the contact force is a vector with the calibration's covariance Σ; what is limited is
its length. The expanded uncertainty U is the length that it stays below with the probability that
k = 2 gives in one dimension, 95.45 %; for an error along one line it is 2σ. The decision rule is
simple acceptance behind a guard band of width U: conforming where |deviation| + U ≤ limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import gravity, sensing
from tdfscal.model.statics import wrench as lever
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.significance import EXPANDED_COVERAGE
from tdfscal.wrench.contact_wrench import covariance

_NODES = 80
#: Standard deviations beyond which nothing of a normal distribution lies, in double precision.
_FAR = 9.0
#: Variances below this share of the largest are lines and planes, not bodies.
_FLAT = 1.0e-12


@dataclass(frozen=True, slots=True)
class Limited:
    """One limited quantity, N or N·m.

    std : (3,), standard uncertainties of its components, LCS. expanded : U, of its length.
    deviation : (3,), known error. limit : stated limit, or ∞.
    exceeding : probability that the error's length exceeds the limit.
    """

    quantity: str
    unit: str
    std: FloatArray
    expanded: float
    deviation: FloatArray
    limit: float
    exceeding: float

    @property
    def conforms(self) -> bool:
        """|deviation| + U ≤ limit."""
        return bool(np.linalg.norm(self.deviation) + self.expanded <= self.limit)


@dataclass(frozen=True, slots=True)
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
        return self.force.conforms and self.torque.conforms

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it does not conform, for the quality gate; empty where it does."""
        return tuple(
            _reason(part, self.rpy) for part in (self.force, self.torque) if not part.conforms
        )


def assess_stated(given: Calibrated) -> Conformity | None:
    """Judge by the rig file's own limits of the contact wrench; None where it states none."""
    stated = given.rig.acceptance
    if stated.contact_force is None and stated.contact_torque is None:
        return None
    return assess(given)


def assess(
    given: Calibrated,
    *,
    rpy: tuple[float, float, float] | None = None,
    force: float | None = None,
    torque: float | None = None,
    deviation: FloatArray | None = None,
) -> Conformity:
    """Judge the contact wrench's uncertainty at a posture against limits.

    rpy : posture of the terminal, rad; force, torque : limits, N and N·m; all default to the rig
    file's `acceptance.contact`, a limit that is stated nowhere to ∞. deviation : (6,), known error
    of the contact wrench there, such as the mean residual of a validation; default 0.
    """
    stated = given.rig.acceptance
    at = stated.contact_rpy if rpy is None else rpy
    limits = (
        stated.contact_force if force is None else force,
        stated.contact_torque if torque is None else torque,
    )
    known = np.zeros(6) if deviation is None else deviation
    cov = covariance(given, *_standing(given, at))[0]
    parts = [
        _limited(name, unit, cov[rows, rows], known[rows], np.inf if limit is None else limit)
        for name, unit, rows, limit in zip(
            ("force", "torque"), ("N", "N·m"), np.s_[:3, 3:], limits, strict=True
        )
    ]
    return Conformity(rpy=at, force=parts[0], torque=parts[1], covariance=cov)


def _standing(given: Calibrated, rpy: tuple[float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Servo positions and readings, (1, n, 3) each, of the smallest forces at a posture."""
    state = given.state
    R = so3.from_rpy(np.array(rpy))
    arm = state.hinge @ R.T
    weight = state.mass * gravity(state, given.rig.gravity)
    grasp = np.concatenate(list(lever(arm)), axis=1)
    load = -np.concatenate([weight, np.cross(R @ state.barycentre, weight)])
    F = (np.linalg.pinv(grasp) @ load).reshape(-1, 3)
    reading = np.linalg.solve(sensing(state), F[..., None])[..., 0] + state.zero
    return (arm + state.datum)[None], reading[None]


def _limited(name: str, unit: str, cov: FloatArray, deviation: FloatArray, limit: float) -> Limited:
    std = np.sqrt(np.diagonal(cov))
    if not np.all(np.isfinite(std)):
        return Limited(name, unit, std, np.inf, deviation, limit, 0.0 if limit == np.inf else 1.0)
    return Limited(
        quantity=name,
        unit=unit,
        std=std,
        expanded=coverage_radius(cov),
        deviation=deviation,
        limit=limit,
        exceeding=exceeding(cov, deviation, limit),
    )


def coverage_radius(cov: FloatArray, coverage: float = EXPANDED_COVERAGE) -> float:
    """Length that a normal vector of covariance (3, 3) and mean 0 stays below."""
    top = float(np.sqrt(np.linalg.eigvalsh(cov)[-1].clip(0.0)))
    if top == 0.0:
        return 0.0
    unit = cov / top**2
    most = np.sqrt(special.chdtri(3, 1 - coverage))  # three directions alike; any others need less

    def short(radius: float) -> float:
        return within(unit, np.zeros(3), radius) - coverage

    from scipy.optimize import brentq  # slow to import, seldom needed

    return float(top * brentq(short, 0.0, 1.001 * most))


def exceeding(cov: FloatArray, mean: FloatArray, limit: float) -> float:
    """Probability that the length of a normal vector of covariance (3, 3) exceeds a limit."""
    return 0.0 if limit == np.inf else min(1.0, max(0.0, 1.0 - within(cov, mean, limit)))


def within(cov: FloatArray, mean: FloatArray, radius: float) -> float:
    """Probability that a normal vector of covariance (3, 3) lies in the ball about 0.

    Along the principal axes, by Gauss–Legendre quadrature over two of them; the third is exact.
    """
    values, axes = np.linalg.eigh(cov)
    std = np.sqrt(np.maximum(values, _FLAT * max(values[-1], 0.0)))
    centre = axes.T @ mean
    if std[-1] == 0.0:
        return float(np.linalg.norm(mean) <= radius)
    node, share = np.polynomial.legendre.leggauss(_NODES)
    # The widest axis is the exact one.
    x, wx = _axis(centre[0], std[0], np.array([radius]), node, share)
    rest = np.sqrt(np.maximum(radius**2 - x**2, 0.0))
    y, wy = _axis(centre[1], std[1], rest.ravel(), node, share)
    half = np.sqrt(np.maximum(rest.reshape(-1, 1) ** 2 - y**2, 0.0))
    inner = special.ndtr((half - centre[2]) / std[2]) - special.ndtr((-half - centre[2]) / std[2])
    return float(np.sum(wx.reshape(-1, 1) * wy * inner))


def _axis(
    centre: float, std: float, radius: FloatArray, node: FloatArray, share: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights (m, nodes) of a normal density over [−radius, radius], radius (m,).

    x = r sin θ takes the square root out of the ends of the ball.
    """
    low = np.clip((centre - _FAR * std) / np.maximum(radius, 1e-300), -1.0, 1.0)
    high = np.clip((centre + _FAR * std) / np.maximum(radius, 1e-300), -1.0, 1.0)
    a, b = np.arcsin(low)[:, None], np.arcsin(high)[:, None]
    angle = (a + b) / 2 + (b - a) / 2 * node
    x = radius[:, None] * np.sin(angle)
    density = np.exp(-0.5 * ((x - centre) / std) ** 2) / (std * np.sqrt(2 * np.pi))
    return x, density * radius[:, None] * np.cos(angle) * (b - a) / 2 * share


def _reason(part: Limited, rpy: tuple[float, float, float]) -> str:
    known = float(np.linalg.norm(part.deviation))
    error = f"{known:.2g} {part.unit} and " if known else ""
    posture = ", ".join(f"{angle:g}" for angle in rpy)
    return (
        f"the contact {part.quantity} at roll, pitch, yaw = {posture} rad has {error}an expanded "
        f"uncertainty of {part.expanded:.2g} {part.unit} (95.45 %), together above the limit of "
        f"{part.limit:g} {part.unit}; its error exceeds the limit with a probability of "
        f"{part.exceeding:.1g}"
    )
