"""One registration of a survey: from matched points to a judged fit, outlying points taken out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, TdfscalError
from tdfscal.findings import Finding, Value
from tdfscal.numerics.registration import MirroredError, Registration, outlier_p_beside
from tdfscal.numerics.registration import register as solve
from tdfscal.records import FloatArray, Instrument, IntArray, PointSet
from tdfscal.significance import OUTLYING_POINT, POINTS_AS_LIKELY, UNUSABLE_SURVEY
from tdfscal.trackercal.instrument import angle_covariance, range_covariance
from tdfscal.trackercal.outlying_points import outlying_points
from tdfscal.trackercal.point_matching import (
    MatchedPoints,
    describe_relabelling,
    relabellings,
    same_distances,
    unit_mistake,
)

FEWEST_FOR_OWN_AXES = 6
"""Moves of one NCP; 12 parameters leave 6 degrees of freedom."""
INSTRUMENT = ("instrument range", "instrument angles")
MEASURED_FILE, REFERENCE_FILE = "measured points' file", "reference points' file"
LAST_DIGIT = "last digit of the coordinates"
ROUNDING = 1 / np.sqrt(12)
"""Standard uncertainty of a number that is rounded, over the worth of its last digit."""
FINEST = 1e-9
"""m; no instrument resolves less of a coordinate, whatever digits a file writes."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Covariances of N matched points by their source.

    measured : source → (N, 3, 3), m², in the measured frame. reference : the same of the
    reference points, in theirs.
    """

    measured: Mapping[str, FloatArray]
    reference: Mapping[str, FloatArray]

    def totals(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Sum over the sources, (N, 3, 3) each."""
        zero = np.zeros((count, 3, 3))
        return sum(self.measured.values(), zero), sum(self.reference.values(), zero)

    def take(self, which: IntArray) -> Noise:
        """The points with these indices only."""
        return Noise(
            {name: cov[which] for name, cov in self.measured.items()},
            {name: cov[which] for name, cov in self.reference.items()},
        )


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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


def point_noise(
    points: MatchedPoints, instrument: Instrument | None, reference: Mapping[str, float]
) -> Noise:
    """Covariances of matched points: the files' or the instrument's, isotropic ones, rounding.

    reference : source → m, standard uncertainty per coordinate of the reference points. What a
    file states of a point stands in the place of both; a point of which it states none has the
    instrument's or, without one, the largest that the file states.
    """
    seen = {}
    std = points.measured.std
    if instrument is not None and (std is None or np.isnan(std).any()):
        seen[INSTRUMENT[0]] = range_covariance(points.measured.xyz, instrument)
        seen[INSTRUMENT[1]] = angle_covariance(points.measured.xyz, instrument)
    stated = np.ones((len(points), 1, 1)) * np.eye(3)
    known = {name: size**2 * stated for name, size in reference.items() if size > 0}
    measured = _beside_file(points.measured, seen, MEASURED_FILE)
    isotropic = _beside_file(points.reference, known, REFERENCE_FILE)
    # Where nothing is stated the residuals show the rounding among the rest. A stated uncertainty
    # of the reference points is that of the points themselves: it covers how they are written.
    if (measured or isotropic) and points.measured.resolution > 0:
        measured[LAST_DIGIT] = (points.measured.resolution * ROUNDING) ** 2 * stated
    if measured and not isotropic and points.reference.resolution > 0:
        isotropic[LAST_DIGIT] = (points.reference.resolution * ROUNDING) ** 2 * stated
    return Noise(measured, isotropic)


def _beside_file(
    points: PointSet, known: Mapping[str, FloatArray], file: str
) -> dict[str, FloatArray]:
    """Covariances by source: what a file states of its points, in the place of what is known."""
    std = np.full_like(points.xyz, np.nan) if points.std is None else points.std
    given = np.isfinite(std)
    by_file = np.all(given, axis=1, keepdims=True)
    found = {}
    if not by_file.all():
        found = {name: np.where(by_file[..., None], 0.0, cov) for name, cov in known.items()}
    if by_file.any():
        own = np.where(given, std, 0.0 if known else np.nanmax(std, axis=0))
        found[file] = own[:, :, None] ** 2 * np.eye(3)
    return found


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
    off = outlying_points(points.measured.xyz, points.reference.xyz, _least(points))
    kept = np.setdiff1d(every, [point.index for point in off])
    if points.take(kept).groups != points.groups:  # it has moved, and its points are sound
        return every, []
    return kept, [
        RejectedPoint(points.names[point.index], point.distance, point.ratio, stated=False)
        for point in off
    ]


def _least(points: MatchedPoints) -> float:
    """Noise per coordinate that residuals show at least, m: of the digits, and of repetition."""
    sets = (points.measured, points.reference)
    digits = float(ROUNDING * np.linalg.norm([p.resolution for p in sets]))
    repetition = float(np.linalg.norm([p.repeatability for p in sets]))
    return max(float(FINEST), digits, repetition)


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
        least = _least(points)
        return solve(points.measured.xyz, points.reference.xyz, group=index, least=least)
    except (NotIdentifiableError, NotConvergedError) as error:
        kind = DataError if isinstance(error, MirroredError) else type(error)
        said = error.finding or error.what
        raise kind(said, where=f"{points.measured.source}, {what}", hint=error.hint) from error


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
