"""Points that are off, where nothing but the points themselves tells their noise.

Several outlying points hide one another in the residuals of all. The order in which they are
suspected comes from a fit to the better half (least trimmed squares: Rousseeuw and Van Driessen
2006); how many of them are off from one test after the other (generalized ESD: Rosner 1983), each
against what the remaining points leave. Noise is isotropic, so that each fit is closed (Kabsch).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product
from math import comb

import numpy as np
from scipy import special

from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import OUTLYING_POINT, POINTS_AS_LIKELY

#: Triples of points from which the fit to the better half starts; C-steps that refine it.
_STARTS, _STEPS = 1000, 20
#: One point in so many may be off; of more not they are wrong, but what they are compared with.
_ONE_IN = 4
#: Points that a fit is left with at least: three have no residual that speaks of one of them.
_FEWEST = 4
#: Kept points that are tried in the place of those that are blamed.
_EXCHANGED = 16


@dataclass(frozen=True, slots=True)
class Outlying:
    """A point that is off. distance : m, from where the others put it. ratio : of its error
    to what they allow.
    """

    index: int
    distance: float
    ratio: float


def outlying_points(
    measured: FloatArray, reference: FloatArray, least: float
) -> tuple[Outlying, ...]:
    """Return the points (N, 3), m, that do not follow the rigid motion of the others, worst first.

    least : m per coordinate; smaller residuals say nothing. Where another choice of points to
    blame leaves about as little, none is named.
    """
    n = len(measured)
    if n <= _FEWEST:
        return ()
    order, far = _suspected(measured, reference)
    for count in range(min(n // _ONE_IN, far), 0, -1):
        off, kept = order[:count], order[count:]
        rotation, translation = _rigid(measured[kept], reference[kept])
        error = measured - reference @ rotation.T - translation
        dof = 3 * len(kept) - 6
        variance = max(float(np.sum(error[kept] ** 2)) / dof, least**2)
        turned = reference @ rotation.T
        statistic = np.array([_against(turned[kept], turned[j], error[j]) for j in off])
        mildest = float(statistic.min()) / 3 / variance
        p = special.fdtrc(3, dof, mildest) * (n - count + 1)
        if p < OUTLYING_POINT and _alone(measured, reference, off, kept, variance):
            worst = np.argsort(-statistic)
            return tuple(
                Outlying(
                    int(off[k]),
                    float(np.linalg.norm(error[off[k]])),
                    float(np.sqrt(statistic[k] / 3 / variance)),
                )
                for k in worst
            )
    return ()


def _suspected(y: FloatArray, x: FloatArray) -> tuple[IntArray, int]:
    """Points (N,), the farthest first from the fit that leaves the better half least.

    And how many are farther than twice the middle one, three standard deviations.
    """
    half = (len(y) + 4) // 2
    best, least = np.arange(len(y)), np.inf
    for start in np.array(list(_triples(len(y)))):
        rotation, translation = _rigid(y[start], x[start])
        distance = np.sum((y - x @ rotation.T - translation) ** 2, axis=1)
        trimmed = float(np.partition(distance, half - 1)[:half].sum())
        if trimmed < least:
            best, least = np.argsort(distance), trimmed
    for _ in range(_STEPS):
        rotation, translation = _rigid(y[best[:half]], x[best[:half]])
        distance = np.linalg.norm(y - x @ rotation.T - translation, axis=1)
        order = np.argsort(distance, kind="stable")
        if set(order[:half]) == set(best[:half]):
            break
        best = order
    return np.asarray(order[::-1]), int(np.sum(distance > 2 * np.median(distance)))


def _triples(n: int) -> Iterator[tuple[int, ...]]:
    if comb(n, 3) <= _STARTS:
        yield from combinations(range(n), 3)
        return
    rng = np.random.default_rng(0)
    for _ in range(_STARTS):
        yield tuple(rng.choice(n, 3, replace=False).tolist())


def _rigid(y: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) that take x (N, 3) to y with the least squares."""
    centre_y, centre_x = y.mean(axis=0), x.mean(axis=0)
    rotation = so3.project((y - centre_y).T @ (x - centre_x))
    return rotation, centre_y - rotation @ centre_x


def _against(kept: FloatArray, point: FloatArray, error: FloatArray) -> float:
    """Squared error of a point that a fit to others predicts, over its own covariance, m².

    All in the frame of the errors.
    """
    levers = kept - kept.mean(axis=0)
    spread = np.sum(levers**2) * np.eye(3) - levers.T @ levers
    turn = so3.hat(point - kept.mean(axis=0))
    allowed = (1 + 1 / len(kept)) * np.eye(3) + turn @ np.linalg.pinv(spread) @ turn.T
    return float(error @ np.linalg.solve(allowed, error))


def _alone(y: FloatArray, x: FloatArray, off: IntArray, kept: IntArray, variance: float) -> bool:
    """Whether each other choice, a blamed point exchanged for a kept one, leaves far more.

    variance : m², of what the kept points leave; their worst are the ones to exchange.
    """
    dof = 3 * len(kept) - 6
    rotation, translation = _rigid(y[kept], x[kept])
    left = np.sum((y[kept] - x[kept] @ rotation.T - translation) ** 2, axis=1)
    for place, back in product(np.argsort(-left)[:_EXCHANGED], off):
        others = kept.copy()
        others[place] = back
        rotation, translation = _rigid(y[others], x[others])
        square = float(np.sum((y[others] - x[others] @ rotation.T - translation) ** 2))
        if dof * np.log(square / dof / variance) < POINTS_AS_LIKELY:
            return False
    return True
