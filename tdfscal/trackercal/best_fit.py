"""Best-fit rigid transform between two point files, with its uncertainty (`tdfscal register`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.errors import NotConvergedError, NotIdentifiableError, TdfscalError
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.registration import Extension, extend
from tdfscal.records import FloatArray, Instrument, PointSet
from tdfscal.significance import SCALE_DIFFERS
from tdfscal.trackercal.group_motion import fit_one_by_one, moved_apart
from tdfscal.trackercal.judged_registration import (
    MEASURED_FILE,
    Noise,
    RejectedPoint,
    SurveyFit,
    fit_survey,
    point_noise,
)
from tdfscal.trackercal.point_matching import (
    Match,
    MatchedPoints,
    describe_unmatched,
    match_points,
    relabellings,
)

_SCALE_STEPS = 30
_LISTED = 8
_INSTEAD = ("the uncertainties stated in the file stand in place of the instrument's",)


@dataclass(frozen=True, slots=True)
class PointRegistration:
    """measured = rotation · reference + translation; or, `scaled`, scale · rotation · reference …

    rotation : (3, 3), det = +1. rpy, rpy_std : (3,), rad. translation, translation_std : (3,), m.
    covariance : (6, 6) of (d, t), R_true = exp([d]×) · rotation, d in the measured frame; rad, m.
    chi2, p_value : None where no uncertainty was stated; sigma : m per coordinate, estimated from
    the residuals then, else None. residual, normalised : (N, 3), m and 1, of the points `names`.
    scale : best scale of the reference with its standard uncertainty; applied where it was to be
    estimated (`scaled`), else a check.
    scale_p : probability of a scale this far from 1 by chance. coplanar : handedness unchecked.
    """

    names: tuple[str, ...]
    rotation: FloatArray
    rpy: FloatArray
    rpy_std: FloatArray
    translation: FloatArray
    translation_std: FloatArray
    covariance: FloatArray
    chi2: float | None
    dof: int
    p_value: float | None
    sigma: float | None
    residual: FloatArray
    normalised: FloatArray
    rms: float
    scale: float
    scale_std: float
    scale_p: float
    scaled: bool
    coplanar: bool
    rejected: tuple[RejectedPoint, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    warnings: tuple[str, ...]


def register(
    measured: PointSet,
    reference: PointSet,
    *,
    instrument: Instrument | None = None,
    drawing: float = 0.0,
    match: Match = "name",
    groups: Mapping[str, str] | None = None,
    scale: bool = False,
) -> PointRegistration:
    """Register the points that two sets have in common, reference → measured.

    instrument : of the measured points, which are in its frame then. drawing : m, standard
    uncertainty per coordinate of the reference points. With neither, and none in the files, the
    noise is estimated from the residuals. match, groups : as `match_points`. scale : estimate a
    scale of the reference too.

    Raises
    ------
    DataError : no common names, wrong names, units or handedness.
    NotIdentifiableError : the points do not determine a rotation.
    """
    matched = match_points(measured, reference, match, groups)
    noise = point_noise(matched, instrument, {"drawing": drawing})
    applied, survey, scaled = _scaled(matched, noise) if scale else _unscaled(matched, noise)
    fit, covariance = survey.fit, survey.fit.covariance
    fewer = fit.dof / (fit.dof - 1) if scale and fit.sigma is not None else 1.0
    ratio, ratio_std = applied - 1, np.inf
    if scaled is not None:
        ratio, ratio_std = ratio + float(scaled.value[0]), float(scaled.covariance[0, 0] ** 0.5)
    if scale and scaled is not None:
        # One parameter more, taken from the residuals that tell the noise.
        covariance, ratio_std = scaled.rigid_covariance * fewer, ratio_std * fewer**0.5
    scale_p = float(chi2_sf((ratio / ratio_std) ** 2, 1))
    J = so3.rpy_jacobian(fit.rotation)
    return PointRegistration(
        names=survey.points.names,
        rotation=fit.rotation,
        rpy=so3.to_rpy(fit.rotation),
        rpy_std=np.sqrt(np.diag(J @ covariance[:3, :3] @ J.T)),
        translation=fit.translation[0],
        translation_std=np.sqrt(np.diag(covariance)[3:]),
        covariance=covariance,
        chi2=None if fit.sigma is not None else fit.chi2,
        dof=fit.dof - scale,
        p_value=None if fit.p_value is None else float(chi2_sf(fit.chi2, fit.dof - scale)),
        sigma=None if fit.sigma is None else fit.sigma * fewer**0.5,
        residual=fit.residual,
        normalised=fit.normalised,
        rms=float(np.sqrt(np.mean(np.sum(fit.residual**2, axis=1)))),
        scale=1 + ratio,
        scale_std=ratio_std,
        scale_p=scale_p,
        scaled=scale,
        coplanar=not fit.handed,
        rejected=survey.rejected,
        missing=matched.missing,
        extra=matched.extra,
        warnings=(
            *describe_unmatched(matched),
            *_doubts(matched, noise, survey),
            *(_scale_doubt(ratio, ratio_std) if scale_p < SCALE_DIFFERS and not scale else ()),
            *(_INSTEAD if instrument is not None and MEASURED_FILE in noise.measured else ()),
        ),
    )


def _doubts(matched: MatchedPoints, noise: Noise, survey: SurveyFit) -> Iterator[str]:
    """What the fit cannot vouch for, and what was left out of it."""
    lost = survey.rejected
    yield from (f"{r.name} is left out: {r.reason}" for r in lost[:_LISTED])
    if len(lost) > _LISTED:
        yield f"{len(lost) - _LISTED} more points are left out"
    if not survey.fit.handed:
        yield (
            "the points lie in one plane within their uncertainty: a mirrored frame would not be "
            "noticed"
        )
    if apart := moved_apart(matched, noise, survey):
        yield apart
    if relabellings(survey.points.measured, survey.points.reference, survey.sigma):
        yield "the points are symmetric: they would fit under other names too"


def _scale_doubt(ratio: float, std: float) -> tuple[str]:
    return (
        f"a scale of {ratio * 1e6:+.0f} ± {std * 1e6:.0f} ppm fits significantly better: check "
        "temperature and units, or let --scale estimate it",
    )


def _unscaled(points: MatchedPoints, noise: Noise) -> tuple[float, SurveyFit, Extension | None]:
    """The fit, and the scale that it would take beside."""
    survey = _together(points, noise)
    return 1.0, survey, _scale_beside(survey)


def _scaled(points: MatchedPoints, noise: Noise) -> tuple[float, SurveyFit, Extension]:
    """The fit to a reference of the best scale, that scale, and what remains to it."""
    scale = 1.0
    for _ in range(_SCALE_STEPS):
        larger = replace(points, reference=scale * points.reference)
        grown = {name: scale**2 * cov for name, cov in noise.reference.items()}
        survey = _together(larger, Noise(noise.measured, grown))
        step = _scale_beside(survey)
        if step is None or survey.fit.dof < 2:
            raise NotIdentifiableError(
                "the points do not determine a scale", where=points.source, hint="measure more"
            )
        move = float(step.value[0])
        if abs(move) <= 1e-6 * float(step.covariance[0, 0] ** 0.5):
            return scale, survey, step
        scale *= 1 + move
    raise NotConvergedError("the scale found no minimum", where=points.source)


def _scale_beside(survey: SurveyFit) -> Extension | None:
    fit = survey.fit
    lever = (fit.adjusted - fit.adjusted.mean(axis=0)) @ fit.rotation.T
    return extend(fit, lever[:, :, None])


def _together(points: MatchedPoints, noise: Noise) -> SurveyFit:
    """One transform for all points; where only the single groups have one, the error says so."""
    try:
        return fit_survey(points, noise, common_shift=True, least=3, what="points")
    except TdfscalError as error:
        if not fit_one_by_one(points, noise):
            raise
        raise error.restated(
            hint=f"each of the groups {', '.join(dict.fromkeys(points.group))} fits by itself: "
            "register one at a time, or calibrate sensors with targets by --method tracker",
        ) from error
