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
    key,
)
from tdfscal.model.dynamics import DELAY, FRICTION, INERTIA
from tdfscal.model.parameters import symmetric
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.records import FloatArray

#: Frequencies of the spectrum in the file.
_LINES = 24
Density = Annotated[tuple[NotNegative, ...], BeforeValidator(from_numpy), Field(min_length=2)]


class LeftOutStretch(Strict):
    """A stretch of the log that was not used, s in the log's time."""

    begin: Number = key("s in the log's time")
    end: Number = key("s in the log's time")
    reason: Text = key("contact, a frozen channel, a sensor at its capacity")


class MotionValue(Strict):
    """A number with its standard uncertainty."""

    value: Number = key("s of a delay, N·m of a friction")
    std: NotNegative = key("standard uncertainty, in the unit of the value")


class InertiaValue(Strict):
    """Inertia about the LCS origin, kg m²."""

    value: Matrix3 = key("kg m²: about the LCS origin, 3 × 3")
    std: Matrix3 = key("kg m²: standard uncertainty of each entry, 3 × 3")


class MotionSpectrum(Strict):
    """Residual of the balance: square roots of two-sided spectral densities.

    frequency in Hz; before, after : N/√Hz, of the three forces together, with the nominal mounting
    and with the calibration; force_noise : N/√Hz, of a force component, and position_noise :
    m/√Hz, of a servo coordinate, as the estimate weighs by them.
    """

    frequency: Density = key("Hz")
    before: Density = key("N/√Hz: residual force with the nominal mounting")
    after: Density = key("N/√Hz: residual force, calibrated")
    force_noise: Density = key("N/√Hz: of a force component, as the estimate weighs by it")
    position_noise: Density = key("m/√Hz: of a servo coordinate, as the estimate weighs by it")


Course = Annotated[tuple[Number, ...], BeforeValidator(from_numpy), Field(min_length=1)]


class MotionResidual(Strict):
    """Lengths of the residual wrench over time, in means of a second or more.

    time : s, in the log's time, of their middles. force in N, moment about the barycentre in N·m;
    before with the nominal mounting and the stated zeros, after with the calibration.
    """

    time: Course = key("s in the log's time: middles of the means")
    force_before: Course = key("N: with the nominal mounting and the stated zeros")
    force_after: Course = key("N: calibrated")
    moment_before: Course = key("N·m: about the barycentre, with the nominal mounting")
    moment_after: Course = key("N·m: calibrated")


class MotionResult(Strict):
    """Samples in motion: from when, how long, what was left out, and what they tell besides.

    begin : s, in the log's time. seconds : of the log that went in. dwells : rests that
    were found in it. delay : s, force stamps minus position stamps. friction : N·m, of each hinge.
    halves_p_value : that the halves of the log differ by chance as they do.
    """

    begin: Number = key("s in the log's time: first sample")
    seconds: Positive = key("s: length of what went in")
    dwells: Count = key("number of static postures that went in too", 0)
    rejected: tuple[LeftOutStretch, ...] = key("stretches of the log that were left out", ())
    delay: MotionValue = key("s: force stamps minus position stamps")
    inertia: InertiaValue = key("kg m²: of the terminal, about the LCS origin")
    friction: MotionValue = key("N·m: Coulomb friction of each hinge")
    halves_p_value: Probability = key("that the log's two halves differ by chance as they do")
    spectrum: MotionSpectrum = key("of the residual: square roots of two-sided densities")
    residual: MotionResidual | None = key(
        "lengths of the residual wrench over time, short means", None
    )


def motion_document(result: MotionCalibration) -> dict[str, Any]:
    """Return the `motion` block of a calibration in motion."""
    moving, std = result.fit.state.moving, result.uncertainty.moving_std
    return {
        "begin": result.begin,
        "seconds": result.seconds,
        "dwells": result.dwells,
        "rejected": result.rejected,
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
