"""One registration of a survey: from matched points to a judged fit, outlying points taken out.

The worst point goes first, then the worst of the others, as long as its misfit is no chance. Where
nothing but the points themselves tells their noise several outlying points hide one another in the
residuals of all: there some more are taken out on trial, and all up to the last one whose misfit is
no chance beside those that remain are off (generalized ESD: Rosner 1983).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.numerics.registration import MirroredError, Registration
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

#: Without any noise given one point in so many may be off; of more not they are wrong, but what
#: they are compared with. Points taken out on trial beyond the last one that is off.
_ONE_IN, _ON_TRIAL = 4, 8


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
    """A registration of matched points. group : (N,), which of its translations each has.

    scale : by which the noise is larger than stated.
    """

    points: MatchedPoints
    noise: Noise
    group: IntArray
    fit: Registration
    rejected: tuple[RejectedPoint, ...]
    scale: float = 1.0

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
    _refuse_wrong_names(points, noise, common_shift, what)
    stated = bool(noise.measured or noise.reference)
    most = len(points) if stated else len(points) // _ONE_IN if common_shift else 0
    kept, out, ratios = np.arange(len(points)), list[int](), list[float]()
    whole = best = current = _survey(points, noise, kept, common_shift, what)
    while len(out) < most and len(out) - len(best.rejected) < (1 if stated else _ON_TRIAL):
        fit, index = current.fit, current.group
        p = fit.outlier_p
        worst = int(np.argmin(p))
        if np.sum(index == index[worst]) <= least or fit.dof <= 3:
            break
        near = np.flatnonzero(_likelier(fit, worst) < POINTS_AS_LIKELY)
        alike = common_shift and len(near) > 1
        outlies = p[worst] < OUTLYING_POINT / len(kept)
        if stated and outlies and alike and p[worst] < UNUSABLE_SURVEY:
            names = tuple(current.points.names[k] for k in near)
            off = Finding("points-alike-off", names, values={"what": what})
            raise DataError(off, where=points.measured.source)
        if stated and (alike or not outlies):
            break
        ratios.append(float(np.sqrt(fit.statistic[worst] / max(fit.redundancy[worst], 1))))
        out.append(int(kept[worst]))
        kept = np.delete(kept, worst)
        current = _survey(points, noise, kept, common_shift, what)
        if not stated and current.points.groups != points.groups:
            return whole  # a group that is lost whole has moved, and its points are sound
        if outlies and not alike:
            best = replace(current, rejected=_rejected(points, current, out, ratios, stated))
    return best


def _survey(
    points: MatchedPoints, noise: Noise, kept: IntArray, common_shift: bool, what: str
) -> SurveyFit:
    current, covs = points.take(kept), noise.take(kept)
    place = {name: 0 if common_shift else k for k, name in enumerate(current.groups)}
    index = np.array([place[name] for name in current.reference.group])
    return SurveyFit(current, covs, index, _solve(current, covs, index, what), ())


def _likelier(fit: Registration, worst: int) -> FloatArray:
    """Twice the log-likelihood (N,) by which the worst point is likelier off than each."""
    if fit.sigma is None:
        return np.asarray(fit.statistic[worst] - fit.statistic)
    left = np.maximum(fit.chi2 - fit.statistic, 1e-300)
    return np.asarray((fit.dof - fit.redundancy[worst]) * np.log(left / left[worst]))


def _rejected(
    points: MatchedPoints, fit: SurveyFit, out: Sequence[int], ratios: Sequence[float], stated: bool
) -> tuple[RejectedPoint, ...]:
    """Points that are off, each with how far it is from where the others put it."""
    y, x = (side.xyz[list(out)] for side in (points.measured, points.reference))
    group = dict(zip(fit.points.reference.group, fit.group, strict=True))
    shift = fit.fit.translation[[group.get(points.reference.group[k], 0) for k in out]]
    away = np.linalg.norm(y - x @ fit.fit.rotation.T - shift, axis=1)
    each = zip(out, away, ratios, strict=True)
    return tuple(RejectedPoint(points.names[k], float(d), ratio, stated) for k, d, ratio in each)


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
