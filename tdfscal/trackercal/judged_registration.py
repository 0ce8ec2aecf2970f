"""One registration of a survey: from matched points to a judged fit, outlying points taken out.

Where nothing but the points themselves tells their noise, several outlying points hide one another
in the residuals of all. The order in which they are suspected comes from a fit to the better half
(least trimmed squares: Rousseeuw and Van Driessen 2006); how many of them are off from one test
after the other (generalized ESD: Rosner 1983), each against what the remaining points leave. Noise
is isotropic there, so that each fit is closed (Kabsch).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from math import comb

import numpy as np
from scipy import special

from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, TdfscalError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.numerics.registration import MirroredError, Registration, outlier_p_beside
from tdfscal.numerics.registration import register as solve
from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import OUTLYING_POINT, POINTS_AS_LIKELY, UNUSABLE_SURVEY
from tdfscal.trackercal.noise import Noise, least_noise
from tdfscal.trackercal.point_matching import (
    MatchedPoints,
    describe_relabelling,
    relabellings,
    same_distances,
    unit_mistake,
)

#: Triples of points from which the fit to the better half starts; C-steps that refine it.
_STARTS, _STEPS = 1000, 20
#: One point in so many may be off; of more not they are wrong, but what they are compared with.
_ONE_IN = 4
#: Points that a fit is left with at least: three have no residual that speaks of one of them.
_FEWEST = 4
#: Kept points that are tried in the place of those that are blamed.
_EXCHANGED = 16


def outlying_points(
    measured: FloatArray, reference: FloatArray, least: float
) -> tuple[tuple[int, float, float], ...]:
    """Return the points (N, 3), m, that do not follow the rigid motion of the others, worst first.

    Of each its index, how far it is from where the others put it, m, and that over what they allow.
    least : m per coordinate; smaller residuals say nothing. Where another choice of points to
    blame leaves about as little, none is named.
    """
    n = len(measured)
    if n <= _FEWEST:
        return ()
    order, far = _suspected(measured, reference)
    for count in range(min(n // _ONE_IN, far), 0, -1):
        off, kept = order[:count], order[count:]
        error = _left(measured, reference, kept)
        dof = 3 * len(kept) - 6
        variance = max(float(np.sum(error[kept] ** 2)) / dof, least**2)
        turned = measured - error
        statistic = np.array([_against(turned[kept], turned[j], error[j]) for j in off])
        mildest = float(statistic.min()) / 3 / variance
        p = special.fdtrc(3, dof, mildest) * (n - count + 1)
        if p < OUTLYING_POINT and _alone(measured, reference, off, kept, variance):
            worst = np.argsort(-statistic)
            return tuple(
                (
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
        distance = np.sum(_left(y, x, start) ** 2, axis=1)
        trimmed = float(np.partition(distance, half - 1)[:half].sum())
        if trimmed < least:
            best, least = np.argsort(distance), trimmed
    for _ in range(_STEPS):
        distance = np.linalg.norm(_left(y, x, best[:half]), axis=1)
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


def _left(y: FloatArray, x: FloatArray, some: IntArray) -> FloatArray:
    """What the rigid motion that takes some of x (N, 3) to y with the least squares leaves of y."""
    rotation, translation = register(x[some], y[None, some])
    return np.asarray(y - x @ rotation[0].T - translation[0])


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
    left = np.sum(_left(y, x, kept)[kept] ** 2, axis=1)
    for place, back in product(np.argsort(-left)[:_EXCHANGED], off):
        others = kept.copy()
        others[place] = back
        square = float(np.sum(_left(y, x, others)[others] ** 2))
        if dof * np.log(square / dof / variance) < POINTS_AS_LIKELY:
            return False
    return True


FEWEST_FOR_OWN_AXES = 6
"""Moves of one NCP; 12 parameters leave 6 degrees of freedom."""


@record
class RejectedPoint:
    """A point that is not used: its residual, m, and times what is allowed.

    stated : by its uncertainty, not by the other points.
    """

    name: str
    residual: float
    ratio: float
    stated: bool = True

    @property
    def finding(self) -> Finding:
        """That it is left out."""
        code = "point-left-out" if self.stated else "point-apart"
        values: dict[str, Value] = {"ratio": self.ratio}
        return Finding(code, (self.name,), self.residual, "m", values=values)


@record
class SurveyFit:
    """A registration of matched points. group : (N,), which of its translations each has."""

    points: MatchedPoints
    noise: Noise
    group: IntArray
    fit: Registration
    rejected: tuple[RejectedPoint, ...]

    @property
    def sigma(self) -> float:
        """Largest standard uncertainty of a coordinate difference of any point, m."""
        return float(np.sqrt(np.trace(np.linalg.inv(self.fit.weight), axis1=1, axis2=2).max() / 3))


def fit_survey(
    points: MatchedPoints, noise: Noise, *, common_shift: bool, least: int, what: str
) -> SurveyFit:
    """Register matched points and take out outlying ones, the worst first.

    common_shift : one translation for all points, else one per group. least : number of points
    that each translation keeps at least. what : the points in words, for messages. Without any
    noise given, its size is estimated from the residuals.

    Raises
    ------
    DataError : names, units or handedness of the points are wrong.
    NotIdentifiableError, NotConvergedError : as `numerics.registration.register`.
    """
    kept, rejected = np.arange(len(points)), list[RejectedPoint]()
    _refuse_wrong_names(points, noise, common_shift, what)
    stated = bool(noise.measured or noise.reference)
    if common_shift and not stated:
        kept, rejected = _without_outlying(points)
    while True:
        current, covs = points.take(kept), noise.take(kept)
        place = {name: 0 if common_shift else k for k, name in enumerate(current.groups)}
        index = np.array([place[name] for name in current.reference.group])
        fit = _solve(current, covs, index, what)
        p = _outlier_p(current, covs, index, fit, common_shift)
        worst = int(np.argmin(p))
        enough = np.sum(index == index[worst]) > least and fit.dof > 3
        outlies = enough and p[worst] < OUTLYING_POINT / len(kept)
        near = np.flatnonzero(fit.statistic > fit.statistic[worst] - POINTS_AS_LIKELY)
        alike = common_shift and len(near) > 1
        if outlies and alike and p[worst] < UNUSABLE_SURVEY:
            names = tuple(current.names[k] for k in near)
            off = Finding("points-alike-off", names, values={"what": what})
            raise DataError(off, where=points.measured.source)
        if alike or not outlies or not stated:
            return SurveyFit(current, covs, index, fit, tuple(rejected))
        size = np.linalg.norm(fit.residual[worst])
        ratio = np.sqrt(fit.statistic[worst] / max(fit.redundancy[worst], 1))
        rejected.append(RejectedPoint(current.names[worst], float(size), float(ratio)))
        kept = np.delete(kept, worst)


def _without_outlying(points: MatchedPoints) -> tuple[IntArray, list[RejectedPoint]]:
    """Points to keep where no noise is stated, and those that are off; no group is lost whole."""
    every = np.arange(len(points))
    off = outlying_points(points.measured.xyz, points.reference.xyz, least_noise(points))
    kept = np.setdiff1d(every, [k for k, _, _ in off])
    if points.take(kept).groups != points.groups:  # it has moved, and its points are sound
        return every, []
    names = points.names
    return kept, [RejectedPoint(names[k], away, ratio, stated=False) for k, away, ratio in off]


def _outlier_p(
    points: MatchedPoints, noise: Noise, index: IntArray, fit: Registration, common_shift: bool
) -> FloatArray:
    """Probability of each point's misfit by chance.

    A move is judged beside the other moves of its NCP, with axes of the NCP's own: what they
    explain is a fault of the axes and no outlying point.
    """
    p = fit.outlier_p.copy()
    if common_shift:
        return p
    for g in range(index.max() + 1):
        here = np.flatnonzero(index == g)
        if len(here) < FEWEST_FOR_OWN_AXES:
            continue
        C, D = noise.take(here).totals(len(here))
        try:
            own = solve(points.measured.xyz[here], points.reference.xyz[here], C, D)
        except TdfscalError:
            continue  # moves along one line, say: the joint fit judges them
        servo = points.reference.xyz[here]
        servo = servo - servo.mean(axis=0)
        columns = np.einsum("ij,njq->niq", own.rotation, affine_columns(servo))
        p[here] = outlier_p_beside(own, columns)
    return p


def affine_columns(servo: FloatArray) -> FloatArray:
    """Displacement (N, 3, 6), m per unit, of points servo (N, 3), m, about their origin.

    Columns: relative scale of x, y, z; squareness s of yz, zx, xy in rad, the angle between the
    two axes being 90° + s, which is a symmetric shear of −s/2 on either side.
    """
    columns = np.zeros((len(servo), 3, 6))
    for k in range(3):
        columns[:, k, k] = servo[:, k]
        i, j = (k + 1) % 3, (k + 2) % 3
        columns[:, i, 3 + k] = -servo[:, j] / 2
        columns[:, j, 3 + k] = -servo[:, i] / 2
    return columns


def _solve(points: MatchedPoints, noise: Noise, index: IntArray, what: str) -> Registration:
    C, D = noise.totals(len(points))
    given = noise.measured or noise.reference
    if given:
        size = np.linalg.eigvalsh(C + D)
        if np.any(size[:, 0] <= 1e-12 * size[:, 2]):
            certain = Finding("points-certain", values={"what": what})
            raise DataError(certain, where=points.measured.source)
    try:
        if given:
            return solve(points.measured.xyz, points.reference.xyz, C, D, index)
        least = least_noise(points)
        return solve(points.measured.xyz, points.reference.xyz, group=index, least=least)
    except (NotIdentifiableError, NotConvergedError) as error:
        kind = DataError if isinstance(error, MirroredError) else type(error)
        where = f"{points.measured.source}, {what}"
        raise kind(error.finding, where=where, hint=error.hint) from error


def _refuse_wrong_names(points: MatchedPoints, noise: Noise, common_shift: bool, what: str) -> None:
    """Where distances within a group are out of the question, say which units or names mend them.

    Distances need no fit, which wrong names could lead anywhere. Without any noise given, a
    hundredth of the set's size is out of the question.
    """
    C, D = noise.totals(len(points))
    variance = np.trace(C + D, axis1=1, axis2=2).max(initial=0.0) / 3
    size = np.ptp(points.measured.xyz, axis=0).max() if len(points) else 0.0
    sigma = float(np.sqrt(variance) if variance > 0 else 1e-3 * size)
    sets = [points]
    if not common_shift:
        sets = [points.take(points.indices(name)) for name in points.groups]
    for here in sets:
        if mistake := unit_mistake(here):
            fault = Finding("points-rescaled", values={"what": what, "mistake": mistake})
        elif same_distances(here.measured, here.reference, sigma):
            continue
        elif orders := relabellings(here, sigma):
            values: dict[str, Value] = {
                "what": what,
                "order": describe_relabelling(here.names, orders[0]),
            }
            fault = Finding("points-misnamed", values=values)
        elif others := [
            there.groups[0]
            for there in sets
            if there.reference.point == here.reference.point
            and same_distances(there.measured, here.reference, sigma)
        ]:
            values = {"what": what, "other": others[0]}
            fault = Finding("groups-misnamed", here.groups[:1], values=values)
        else:
            continue
        raise DataError(fault, where=points.measured.source)
