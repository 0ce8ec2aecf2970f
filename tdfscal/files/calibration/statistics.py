"""How well a result stands, and the evidence behind it, as the file states them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.catalogue import sentence
from tdfscal.checks.shared_data import Readings, readings
from tdfscal.files.calibration.evidence import CampaignResult, ResidualWrench
from tdfscal.files.calibration.parameters import finite, zeros_and_load
from tdfscal.files.field_types import measured_only
from tdfscal.files.rig.reading import HOUR
from tdfscal.findings import Finding
from tdfscal.model.dynamics import DELAY, FRICTION, INERTIA, RATE
from tdfscal.model.parameters import State, layout, symmetric
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import ANGLES, BoolArray, FloatArray
from tdfscal.selfcal.pipeline import SelfCalibration

if TYPE_CHECKING:
    from tdfscal.acceptance import Conformity
    from tdfscal.motioncal.pipeline import MotionCalibration
    from tdfscal.trackercal.pipeline import TrackerCalibration

#: Dwells that a file keeps for a figure, at most.
_LOOKED_AT = 2000
#: What a slope per second is multiplied by for the file.
_UNITS = {"time": HOUR, "temperature": 1.0, "parabola": HOUR**2}


def fit(
    result: SelfCalibration | MotionCalibration, campaigns: Sequence[CampaignResult]
) -> dict[str, Any]:
    """Residuals, rejected postures; χ² of all campaigns, where there are several."""
    said = {**vars(result.quality)}
    if isinstance(result, SelfCalibration):
        start, end = result.dwells.start, result.dwells.end
        said["postures"] = len(start) - len(result.rejected)
        said["rejected"] = [
            {"index": k, "start": start[k], "end": end[k], **_why(reason)}
            for k, reason in sorted(result.rejected.items())
        ]
    else:
        said["postures"] = result.dwells
    if campaigns:
        chi2, dof = sum(one.chi2 for one in campaigns), sum(one.dof for one in campaigns)
        said |= {"postures": sum(one.postures for one in campaigns), "chi2": chi2, "dof": dof}
        said["p_value"] = float(chi2_sf(chi2, dof)) if dof else 1.0
        said["birge"] = float(np.sqrt(chi2 / dof)) if dof else 1.0
    return said


def _why(reason: Finding) -> dict[str, str]:
    return {"code": reason.code, "reason": sentence(reason)}


def validation(result: SelfCalibration | MotionCalibration) -> dict[str, Any] | None:
    """Residual wrench where postures, or stretches of a motion, were left out, before and after."""
    if (check := result.validation) is None:
        return None
    left_out = "stretch of the motion" if result.fit.moving else "posture"
    said = {"postures": len(check.before), "method": f"leave one {left_out} out"}
    return said | ResidualWrench.of(check.before, check.after)


def budget(
    names: Sequence[str], shares: Mapping[str, FloatArray], determined: BoolArray
) -> dict[str, Any]:
    """Variances by source of the angles that are determined; sources without any are left out."""
    kept = {s: np.maximum(v, 0.0) for s, v in shares.items() if np.any(v[determined] > 0)}
    angles = [
        {"support": name, "angle": angle, "variance": {s: v[i, j] for s, v in kept.items()}}
        for i, name in enumerate(names)
        if determined[i]
        for j, angle in enumerate(ANGLES)
    ]
    return {"sources": list(kept), "angles": angles}


def conformity(found: Conformity | None) -> dict[str, Any] | None:
    """Of the contact wrench, against the rig file's limits."""
    if found is None:
        return None
    limited = {"force": found.force, "torque": found.torque}
    names = ("expanded", "limit", "exceeding")
    said = {n: {key: getattr(one, key) for key in names} for n, one in limited.items()}
    return {"rpy": found.rpy, **said}


def tracker_statistics(result: TrackerCalibration) -> dict[str, Any]:
    """Points of a survey, and their residuals: m in the tracker's frame, and over their std."""
    names = [name for survey in result.surveys for name in survey.points.names]
    residuals = {
        name: np.concatenate([getattr(survey.fit, name) for survey in result.surveys])
        for name in ("residual", "normalised")
    }
    return {
        **{name: getattr(result, name) for name in ("chi2", "dof", "p_value", "birge")},
        "points": len(names),
        "rejected": [point.name for point in result.rejected],
        "residuals": {"points": names, **residuals},
    }


def postures(result: SelfCalibration) -> dict[str, Any]:
    """Time and residual wrench of each posture in the fit."""
    dwells = result.dwells
    used = [k for k in range(len(dwells)) if k not in result.rejected]
    out = [{**vars(each), "reason": sentence(each.reason)} for each in dwells.left_out]
    times = {"start": dwells.start[used], "end": dwells.end[used]}
    return {"index": used, **times, **vars(result.validation), "left_out": out}


def dwells(result: SelfCalibration) -> dict[str, Any] | None:
    """Mean readings of all dwells, where they are few enough to be looked at."""
    found = result.dwells
    if len(found) > _LOOKED_AT:
        return None
    warm = None if found.temperature is None else found.temperature.mean(axis=1)
    times = {"start": found.start, "end": found.end, "temperature": warm}
    return {**times, **vars(readings(result.rig, found))}


def campaign(
    state: State, std: State, axes: BoolArray, means: Readings | None, **more: Any
) -> CampaignResult:
    """One campaign of several; std : standard uncertainties, ∞ where there is none.

    axes : (n, 3), which it measured. means : None of a survey. more : its other keys.
    """
    kept = None if means is None or len(means.force) > _LOOKED_AT else means
    return CampaignResult.model_validate(
        finite({**more, **zeros_and_load(state, std, axes), "readings": kept})
    )


def drift(result: SelfCalibration) -> dict[str, Any] | None:
    """Slopes of the zeros that the rig file declares; the modes of a walk say nothing each."""
    slopes, held = result.fit.state.drift, result.fit.postures.motion
    if held is None or result.estimator == "linear":
        return None
    place = layout(result.rig.n, len(slopes))["drift"]
    std = result.uncertainty.parameter_std[place].reshape(slopes.shape)
    found: dict[str, Any] = {}
    for kind, value, own in zip(held.kind, slopes, std, strict=True):
        if kind in _UNITS:
            columns = {"value": _UNITS[kind] * value, "std": _UNITS[kind] * own}
            found[kind] = {n: measured_only(v, result.rig.axes) for n, v in columns.items()}
    return found or None


def motion(result: MotionCalibration, in_clock: bool) -> dict[str, Any]:
    """Return the `motion` block of a calibration in motion.

    in_clock : the other recorder's clock holds delay and rate already.
    """
    moving, std = result.fit.state.moving, result.moving_std
    told = result.rate_told and not in_clock
    return {
        **{name: getattr(result, name) for name in ("begin", "seconds", "dwells", "residual")},
        "rejected": [{"begin": s.begin, "end": s.end, **_why(s.reason)} for s in result.rejected],
        "delay": {"value": 0.0 if in_clock else moving.delay, "std": std[DELAY]},
        "rate": {"value": moving.rate, "std": std[RATE]} if told else None,
        "inertia": {"value": symmetric(moving.inertia), "std": symmetric(std[INERTIA])},
        "friction": {"value": moving.friction, "std": std[FRICTION]},
    }
