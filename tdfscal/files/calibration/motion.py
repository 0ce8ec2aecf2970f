"""What only samples in motion add to the calibration file."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from tdfscal.files.field_types import (
    Count,
    Matrix3,
    NotNegative,
    Number,
    Positive,
    Probability,
    Strict,
    Text,
    from_numpy,
)
from tdfscal.model.dynamics import DELAY, FRICTION, INERTIA
from tdfscal.model.parameters import symmetric
from tdfscal.motioncal.halves import HeldOut
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.records import FloatArray

#: Frequencies of the spectrum in the file.
_LINES = 24
Density = Annotated[tuple[NotNegative, ...], BeforeValidator(from_numpy), Field(min_length=2)]


class LeftOutStretch(Strict):
    """A stretch of the log that was not used, s in the log's time."""

    begin: Number
    end: Number
    reason: Text


class MotionValue(Strict):
    """A number with its standard uncertainty."""

    value: Number
    std: NotNegative


class InertiaValue(Strict):
    """Inertia about the LCS origin, kg m²."""

    value: Matrix3
    std: Matrix3


class MotionSpectrum(Strict):
    """Residual of the balance: square roots of two-sided spectral densities.

    frequency in Hz; before, after : N/√Hz, of the three forces together, with the nominal mounting
    and with the calibration; force_noise : N/√Hz, of a force component, and position_noise :
    m/√Hz, of a servo coordinate, as the estimate weighs by them.
    """

    frequency: Density
    before: Density
    after: Density
    force_noise: Density
    position_noise: Density


Course = Annotated[tuple[Number, ...], BeforeValidator(from_numpy), Field(min_length=1)]


class MotionResidual(Strict):
    """Lengths of the residual wrench over time, in means of a second or more.

    time : s, in the log's time, of their middles. force in N, moment about the barycentre in N·m;
    before with the nominal mounting and the stated zeros, after with the calibration.
    """

    time: Course
    force_before: Course
    force_after: Course
    moment_before: Course
    moment_after: Course


class MotionResult(Strict):
    """Samples in motion: from when, how long, what was left out, and what they tell besides.

    begin : s, in the log's time. seconds : of the log that went in. dwells : rests that
    were found in it. delay : s, force stamps minus position stamps. friction : N·m, of each hinge.
    halves_p_value : that the halves of the log differ by chance as they do.
    """

    begin: Number
    seconds: Positive
    dwells: Count = 0
    rejected: tuple[LeftOutStretch, ...] = ()
    delay: MotionValue
    inertia: InertiaValue
    friction: MotionValue
    halves_p_value: Probability
    spectrum: MotionSpectrum
    residual: MotionResidual | None = None


def motion_document(result: MotionCalibration) -> dict[str, Any]:
    """Return the `motion` block of a calibration in motion."""
    moving, std = result.fit.state.moving, result.uncertainty.moving_std
    return {
        "begin": result.begin,
        "seconds": result.seconds,
        "dwells": result.dwells,
        "rejected": [{"begin": s.begin, "end": s.end, "reason": s.reason} for s in result.rejected],
        "delay": {"value": moving.delay, "std": std[DELAY]},
        "inertia": {"value": symmetric(moving.inertia), "std": symmetric(std[INERTIA])},
        "friction": {"value": moving.friction, "std": std[FRICTION]},
        "halves_p_value": result.halves.p_value,
        "spectrum": _spectrum(result),
        "residual": {
            "time": result.residual.time,
            "force_before": result.residual.before[:, 0],
            "force_after": result.residual.after[:, 0],
            "moment_before": result.residual.before[:, 1],
            "moment_after": result.residual.after[:, 1],
        },
    }


def held_out_document(check: HeldOut | None) -> dict[str, Any] | None:
    """Return the `validation` block of stretches held out in turn."""
    if check is None:
        return None
    force, moment = (
        {
            "rms_before": check.before[k],
            "rms_after": check.after[k],
            "max_before": check.before_max[k],
            "max_after": check.after_max[k],
        }
        for k in range(2)
    )
    return {
        "method": "leave one stretch of the motion out",
        "postures": check.stretches,
        "force": force,
        "moment": moment,
    }


def _spectrum(result: MotionCalibration) -> dict[str, Any]:
    f = np.geomspace(np.exp(result.fit.noise.knot[0]), np.exp(result.fit.noise.knot[-1]), _LINES)
    force, place = result.fit.noise.density(f)
    at, before, after = result.residual_power
    return {
        "frequency": f,
        "before": _binned(f, at, before),
        "after": _binned(f, at, after),
        "force_noise": np.sqrt(force),
        "position_noise": np.sqrt(place),
    }


def _binned(frequency: FloatArray, at: FloatArray, power: FloatArray) -> FloatArray:
    """Mean of a power between the geometric middles of the frequencies, as a square root."""
    edge = np.sqrt(frequency[1:] * frequency[:-1])
    place = np.searchsorted(edge, at)
    count = np.bincount(place, minlength=len(frequency))
    total = np.bincount(place, power, minlength=len(frequency))
    filled = count > 0
    mean = total[filled] / count[filled]
    return np.asarray(np.sqrt(np.interp(frequency, frequency[filled], mean)))
