"""One registration of a survey: from matched points to a judged fit, outlying points taken out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, TdfscalError
from tdfscal.numerics.registration import MirroredError, Registration, outlier_p_beside
from tdfscal.numerics.registration import register as solve
from tdfscal.records import FloatArray, Instrument, IntArray
from tdfscal.significance import OUTLYING_POINT, POINTS_AS_LIKELY, UNUSABLE_SURVEY
from tdfscal.trackercal.instrument import angle_covariance, range_covariance
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
    """A point that is not used: its name, and why in words."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class SurveyFit:
    """A registration of matched points. group : (N,), 0 … G − 1, into `groups`."""

    points: MatchedPoints
    noise: Noise
    groups: tuple[str, ...]
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
    measured: dict[str, FloatArray] = {}
    by_file = np.isfinite(points.measured_std).all(axis=1)
    if instrument is not None and not by_file.all():
        left = np.where(by_file, 0.0, 1.0)[:, None, None]
        for name, covariance in zip(INSTRUMENT, (range_covariance, angle_covariance), strict=True):
            measured[name] = left * covariance(points.measured, instrument)
    if by_file.any():
        std = _filled(points.measured_std, 0.0 if instrument is not None else None)
        measured[MEASURED_FILE] = _diagonal(std)
    isotropic = {}
    by_file = np.isfinite(points.reference_std).all(axis=1)
    for name, size in reference.items():
        if size > 0 and not by_file.all():
            isotropic[name] = np.where(by_file, 0.0, size**2)[:, None, None] * np.eye(3)
    if by_file.any():
        std = _filled(points.reference_std, 0.0 if isotropic else None)
        isotropic[REFERENCE_FILE] = _diagonal(std)
    return _with_rounding(points, measured, isotropic)


def _filled(std: FloatArray, unstated: float | None) -> FloatArray:
    """Rows of NaN become `unstated`, or where it is None the largest of each column."""
    fill = np.nanmax(std, axis=0) if unstated is None else np.full(3, unstated)
    return np.where(np.isfinite(std), std, fill)


def _with_rounding(
    points: MatchedPoints, measured: dict[str, FloatArray], isotropic: dict[str, FloatArray]
) -> Noise:
    """Add what the last digits of the files leave open, where any uncertainty is stated.

    Without any, the residuals show the rounding among the rest. A stated uncertainty of the
    reference points is that of the points themselves: it covers how they are written.
    """
    if measured or isotropic:
        for digit, sources in (
            (points.measured_digit, measured),
            (points.reference_digit if not isotropic else 0.0, isotropic),
        ):
            if digit > 0:
                std = np.full((len(points), 3), digit * ROUNDING)
                sources[LAST_DIGIT] = _diagonal(std)
    return Noise(measured, isotropic)


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
    while True:
        current, covs = points.take(kept), noise.take(kept)
        groups = ("",) if common_shift else tuple(dict.fromkeys(current.group))
        index = np.array([0 if common_shift else groups.index(g) for g in current.group])
        fit = _solve(current, covs, index, what)
        p = _outlier_p(current, covs, index, fit, common_shift)
        worst = int(np.argmin(p))
        enough = np.sum(index == index[worst]) > least and fit.dof > 3
        if p[worst] >= OUTLYING_POINT / len(kept) or not enough:
            return SurveyFit(current, covs, groups, index, fit, tuple(rejected))
        suspects = [
            name
            for name, statistic in zip(current.names, fit.statistic, strict=True)
            if statistic > fit.statistic[worst] - POINTS_AS_LIKELY
        ]
        if common_shift and len(suspects) > 1:
            if p[worst] < UNUSABLE_SURVEY:
                raise DataError(
                    f"the {what} do not fit their reference points, and any of "
                    f"{', '.join(suspects)} may be the one that is off",
                    where=points.source,
                    hint="measure them again; a fifth or sixth target would tell which one it is",
                )
            return SurveyFit(current, covs, groups, index, fit, tuple(rejected))
        size = np.linalg.norm(fit.residual[worst])
        ratio = np.sqrt(fit.statistic[worst] / max(fit.redundancy[worst], 1))
        reason = f"residual {size * 1e3:.3g} mm, {ratio:.3g} times what its uncertainty allows"
        rejected.append(RejectedPoint(current.names[worst], reason))
        kept = np.delete(kept, worst)


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
            own = solve(points.measured[here], points.reference[here], C, D)
        except TdfscalError:
            continue  # moves along one line, say: the joint fit judges them
        servo = points.reference[here] - points.reference[here].mean(axis=0)
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
            raise DataError(
                f"some {what} have an uncertainty of zero in some direction",
                where=points.source,
                hint="state a range and an angle uncertainty of the instrument above zero",
            )
    try:
        if given:
            return solve(points.measured, points.reference, C, D, index)
        digits = np.hypot(points.measured_digit, points.reference_digit)
        least = max(FINEST, float(digits) * ROUNDING)
        return solve(points.measured, points.reference, group=index, least=least)
    except MirroredError as error:
        raise DataError(error.what, where=f"{points.source}, {what}", hint=error.hint) from error
    except (NotIdentifiableError, NotConvergedError) as error:
        kind = type(error)
        raise kind(error.what, where=f"{points.source}, {what}", hint=error.hint) from error


def _refuse_wrong_names(points: MatchedPoints, noise: Noise, common_shift: bool, what: str) -> None:
    """Where distances within a group are out of the question, say which units or names mend them.

    Distances need no fit, which wrong names could lead anywhere. Without any noise given, a
    hundredth of the set's size is out of the question.
    """
    C, D = noise.totals(len(points))
    variance = np.trace(C + D, axis1=1, axis2=2).max(initial=0.0) / 3
    size = np.ptp(points.measured, axis=0).max() if len(points) else 0.0
    sigma = float(np.sqrt(variance) if variance > 0 else 1e-3 * size)
    names = ("",) if common_shift else tuple(dict.fromkeys(points.group))
    sets = {name: points if common_shift else points.take(points.indices(name)) for name in names}
    for name, here in sets.items():
        mistake = unit_mistake(here.measured, here.reference)
        if mistake:
            raise DataError(
                f"the {what} differ in size: {mistake}",
                where=points.source,
                hint="correct the length unit",
            )
        if same_distances(here.measured, here.reference, sigma):
            continue
        for order in relabellings(here.measured, here.reference, sigma)[:1]:
            raise DataError(
                f"the names of the {what} do not fit the distances between them; they fit if "
                f"{describe_relabelling(here.names, order)}",
                where=points.source,
                hint="correct the names of these points",
            )
        for other, there in sets.items():
            if there.point == here.point and same_distances(there.measured, here.reference, sigma):
                raise DataError(
                    f"the {what} of {name} do not fit its reference points, those of {other} do",
                    where=points.source,
                    hint="correct the group names",
                )


def _diagonal(std: FloatArray) -> FloatArray:
    return np.asarray(std[:, :, None] ** 2 * np.eye(3))
