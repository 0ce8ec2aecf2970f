"""Best-fit rigid transform between two point files, with its uncertainty (`tdfscal register`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np

from tdfscal.errors import NotConvergedError, NotIdentifiableError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.numerics import registration, so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.registration import MirroredError, Registration, extend
from tdfscal.records import FloatArray, Instrument, PointSet
from tdfscal.significance import SCALE_DIFFERS
from tdfscal.trackercal.judged_registration import RejectedPoint, SurveyFit, fit_survey
from tdfscal.trackercal.noise import MEASURED_FILE, point_noise
from tdfscal.trackercal.point_matching import LISTED, Match, match_points, relabellings, unmatched


@record
class PointRegistration:
    """measured = rotation · reference + translation.

    rotation : (3, 3), det = +1. rpy, rpy_std : (3,), rad. translation, translation_std : (3,), m.
    covariance : (6, 6) of (d, t), R_true = exp([d]×) · rotation, d in the measured frame; rad, m.
    noise_dof : degrees of freedom that tell the noise, ∞ as stated.
    chi2, p_value : None where no uncertainty was stated; sigma : m per coordinate, estimated from
    the residuals then, else None. residual : (N, 3), m, of the points `names`.
    scale : that of the reference that would fit best, with its standard uncertainty; not applied.
    coplanar : handedness unchecked.
    """

    names: tuple[str, ...]
    rotation: FloatArray
    rpy: FloatArray
    rpy_std: FloatArray
    translation: FloatArray
    translation_std: FloatArray
    covariance: FloatArray
    noise_dof: float
    chi2: float | None
    dof: int
    p_value: float | None
    sigma: float | None
    residual: FloatArray
    rms: float
    scale: float
    scale_std: float
    coplanar: bool
    rejected: tuple[RejectedPoint, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    findings: tuple[Finding, ...]


def register(
    measured: PointSet,
    reference: PointSet,
    *,
    instrument: Instrument | None = None,
    match: Match = "name",
    groups: Mapping[str, str] | None = None,
) -> PointRegistration:
    """Register the points that two sets have in common, reference → measured.

    instrument : of the measured points, which are in its frame then. Without it, and without
    uncertainties in the files, the noise is estimated from the residuals. match, groups : as
    `match_points`.

    Raises
    ------
    DataError : no common names, wrong names, units or handedness.
    NotIdentifiableError : the points do not determine a rotation.
    """
    matched = match_points(measured, reference, match, groups)
    noise = point_noise(matched, instrument, {})
    try:
        survey = fit_survey(matched, noise, common_shift=True, least=3, what="points")
    except NotIdentifiableError as error:
        if len(matched.groups) < 2:
            raise
        raise error.restated(hint=Finding("groups-apart", matched.groups)) from error
    fit, moved = survey.fit, _groups_moved(survey)
    ratio, ratio_std = _scale_beside(fit)
    grown = 1.0 if moved else _grown(survey, (ratio / ratio_std) ** 2)
    covariance, ratio_std = grown * fit.covariance, np.sqrt(grown) * ratio_std
    found = [*unmatched(matched), *_doubts(survey)]
    if (misfit := moved or _scale_differs(ratio, ratio_std)) is not None:
        found.append(misfit)
    if grown > 1.0:
        found.append(Finding("survey-scatters", ("points",), float(np.sqrt(grown))))
    if instrument is not None and MEASURED_FILE in noise.measured:
        found.append(Finding("uncertainty-from-file"))
    J = so3.rpy_jacobian(fit.rotation)
    return PointRegistration(
        names=survey.points.names,
        rotation=fit.rotation,
        rpy=so3.to_rpy(fit.rotation),
        rpy_std=np.sqrt(np.diag(J @ covariance[:3, :3] @ J.T)),
        translation=fit.translation[0],
        translation_std=np.sqrt(np.diag(covariance)[3:]),
        covariance=covariance,
        noise_dof=fit.dof if grown > 1.0 or fit.sigma is not None else np.inf,
        chi2=None if fit.sigma is not None else fit.chi2,
        dof=fit.dof,
        p_value=fit.p_value,
        sigma=fit.sigma,
        residual=fit.residual,
        rms=float(np.sqrt(np.mean(np.sum(fit.residual**2, axis=1)))),
        scale=1 + ratio,
        scale_std=ratio_std,
        coplanar=not fit.handed,
        rejected=survey.rejected,
        missing=matched.missing,
        extra=matched.extra,
        findings=tuple(found),
    )


def _grown(survey: SurveyFit, by_scale: float) -> float:
    """How many times as large as stated the noise's variance is, by the residuals; 1 as stated.

    by_scale : by how much a scale of the reference would lower χ².

    Raises NotIdentifiableError where by such residuals the points determine no rotation: they are
    of no one body.
    """
    fit = survey.fit
    rest, dof = fit.chi2 - by_scale, fit.dof - 1
    if fit.p_value is None or dof < 1 or chi2_sf(rest, dof) >= SCALE_DIFFERS:
        return 1.0
    measured, reference = survey.points.measured.xyz, survey.points.reference.xyz
    with suppress(MirroredError, NotConvergedError):
        registration.register(measured, reference)
    return float(rest / dof)


def _doubts(survey: SurveyFit) -> Iterator[Finding]:
    """What the fit cannot vouch for, and what was left out of it."""
    lost = survey.rejected
    yield from (point.finding for point in lost[:LISTED])
    if len(lost) > LISTED:
        yield Finding("points-left-out", size=len(lost) - LISTED)
    if not survey.fit.handed:
        yield Finding("points-coplanar")
    if relabellings(survey.points, survey.sigma):
        yield Finding("points-symmetric")


def _scale_differs(ratio: float, std: float) -> Finding | None:
    """A scale of the reference that fits better; less 1, as it and its uncertainty are given."""
    if chi2_sf((ratio / std) ** 2, 1) >= SCALE_DIFFERS:
        return None
    values: dict[str, Value] = {"ppm": 1e6 * ratio, "ppm_std": 1e6 * std}
    return Finding("scale-fits-better", size=ratio, values=values)


def _groups_moved(survey: SurveyFit) -> Finding | None:
    """Groups that lie apart from where one body would have them, and the largest shift, m."""
    groups = survey.points.groups
    own = np.array(groups)[1:] == np.array(survey.points.reference.group)[:, None]
    columns = (own[:, None, :, None] * np.eye(3)[:, None, :]).reshape(len(own), 3, -1)
    shifts = extend(survey.fit, columns) if len(groups) > 1 else None
    if shifts is None:
        return None
    chi2 = float(shifts.value @ np.linalg.solve(shifts.covariance, shifts.value))
    if (p := float(chi2_sf(chi2, columns.shape[2]))) >= SCALE_DIFFERS:
        return None
    each = np.vstack([np.zeros(3), shifts.value.reshape(-1, 3)])
    size = float(np.linalg.norm(each - each.mean(axis=0), axis=1).max())
    return Finding("groups-moved", groups, size, "m", p_value=p)


def _scale_beside(fit: Registration) -> tuple[float, float]:
    """Scale of the reference less 1 that the residuals ask for, and its standard uncertainty."""
    lever = (fit.adjusted - fit.adjusted.mean(axis=0)) @ fit.rotation.T
    beside = extend(fit, lever[:, :, None])
    if beside is None:
        return 0.0, np.inf
    return float(beside.value[0]), float(beside.covariance[0, 0] ** 0.5)
