"""What lies behind a result, as models: optional parts of a calibration file, for its report.

Postures, dwells, loads and trials; zeros that move and supports that give; samples in motion.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from tdfscal.files.field_types import (
    Count,
    Matrix3,
    Name,
    NotNegative,
    Number,
    Numbers,
    OpenRows,
    OpenStd,
    OpenStdRows,
    Positive,
    Probability,
    Strict,
    Text,
    Vector,
    Vectors,
    fault,
    from_numpy,
    key,
)

Counts = Annotated[tuple[Count, ...], BeforeValidator(from_numpy)]


class Stretch(Strict):
    """A stretch of the log in s that is no posture, and why."""

    start: Number = key("s in the log's time")
    end: Number = key("s in the log's time")
    reason: Text = key("in words")


class PostureTable(Strict):
    """The postures in the fit, column by column: the contact wrench that remains, in LCS axes.

    Moments are about the LCS origin; before: nominal mounting and stated zeros, after: calibrated
    without the posture.
    """

    index: Counts = key("number of the dwell, from 0")
    start: Numbers = key("s in the log's time")
    end: Numbers = key("s in the log's time")
    force_before: Vectors = key("N: residual force with the nominal mounting")
    force_after: Vectors = key("N: residual force, calibrated")
    moment_before: Vectors = key("N·m: residual moment with the nominal mounting")
    moment_after: Vectors = key("N·m: residual moment about the LCS origin, calibrated")
    left_out: tuple[Stretch, ...] | None = key("stretches of rest that are no posture", None)
    force_std: Vectors | None = key(
        "N: standard uncertainty of force_after, each axis, as stated", None
    )
    moment_std: Vectors | None = key(
        "N·m: standard uncertainty of moment_after, each axis, as stated", None
    )

    @model_validator(mode="after")
    def _aligned(self) -> Self:
        for name in type(self).model_fields.keys() - {"index", "left_out"}:
            column = getattr(self, name)
            if column is not None and len(column) != len(self.index):
                raise fault("has not one entry per posture", name)
        return self


class DwellTable(Strict):
    """All dwells, column by column, and their mean readings, as tdfscal's sign has them."""

    start: Numbers = key("s: begin of each dwell, as the log counts")
    end: Numbers = key("s: end of each dwell")
    force: tuple[Vectors, ...] = key("N: per support the mean reading of each dwell, sensor frame")
    temperature: Numbers | None = key(
        "°C: mean of each dwell and of all sensors, where it was recorded", None
    )

    @model_validator(mode="after")
    def _aligned(self) -> Self:
        columns = [("end", self.end), *(("force", force) for force in self.force)]
        for name, column in (*columns, ("temperature", self.temperature or self.start)):
            if len(column) != len(self.start):
                raise fault("has not one entry per dwell", name)
        return self


class SensorLoad(Strict):
    """Where the loads on a sensor point; quadratic means of what lies about it."""

    support: Name = key("name of the support")
    axis: Vector = key("mean line of action, unit vector, BCS")
    spread: NotNegative = key("rad: how far the loads spread about it")
    across: NotNegative = key("N: load across the mean line of action")


class MethodAngles(Strict):
    """What one method alone says: roll, pitch, yaw per support with standard uncertainties, rad."""

    method: Literal["self", "tracker"] = key("self or tracker")
    rpy: Vectors = key("rad: roll, pitch, yaw of each support")
    rpy_std: Vectors = key("rad: their standard uncertainties")


class Slopes(Strict):
    """How the zeros moved by one cause; a walk has only its share."""

    value: OpenRows | None = key("per support, of each axis; null where not measured", None)
    std: OpenStdRows | None = key("standard uncertainties, in the same unit; null where open", None)
    share: OpenRows = key("part of the variance of roll, pitch, yaw that knowing it takes away")


class Give(Strict):
    """A compliance between encoder and hinge, m/N."""

    value: Number = key("m/N")
    std: OpenStd = key("m/N: its standard uncertainty; null where open", None)
    share: OpenRows = key("part of the variance of roll, pitch, yaw that knowing it takes away")


Density = Annotated[tuple[NotNegative, ...], BeforeValidator(from_numpy), Field(min_length=2)]


class LeftOutStretch(Strict):
    """A stretch of the log that was not used, s in the log's time."""

    begin: Number = key("s in the log's time")
    end: Number = key("s in the log's time")
    code: Text | None = key("of the finding about it", None)
    reason: Text = key("contact, a frozen channel, a sensor at its capacity")


class MotionValue(Strict):
    """A number with its standard uncertainty."""

    value: Number = key("s of a delay, N·m of a friction, none of a rate")
    std: NotNegative = key("standard uncertainty, in the unit of the value")


class InertiaValue(Strict):
    """Inertia about the LCS origin, kg m²."""

    value: Matrix3 = key("kg m²: about the LCS origin, 3 × 3")
    std: Matrix3 = key("kg m²: standard uncertainty of each entry, 3 × 3")


class MotionSpectrum(Strict):
    """Residual of the balance, its three forces together: roots of two-sided densities."""

    frequency: Density = key("Hz")
    before: Density = key("N/√Hz: residual force with the nominal mounting")
    after: Density = key("N/√Hz: residual force, calibrated")
    force_noise: Density = key("N/√Hz: of a force component, as the estimate weighs by it")
    position_noise: Density = key("m/√Hz: of a servo coordinate, as the estimate weighs by it")


Course = Annotated[tuple[Number, ...], BeforeValidator(from_numpy), Field(min_length=1)]


class MotionResidual(Strict):
    """Lengths of the residual wrench over time, in means of a second or more."""

    time: Course = key("s in the log's time: middles of the means")
    force_before: Course = key("N: with the nominal mounting and the stated zeros")
    force_after: Course = key("N: calibrated")
    moment_before: Course = key("N·m: about the barycentre, with the nominal mounting")
    moment_after: Course = key("N·m: calibrated")


class MotionResult(Strict):
    """Samples in motion: from when, how long, what was left out, and what they tell besides."""

    begin: Number = key("s in the log's time: first sample")
    seconds: Positive = key("s: length of what went in")
    dwells: Count = key("number of static postures that went in too", 0)
    rejected: tuple[LeftOutStretch, ...] = key("stretches of the log that were left out", ())
    delay: MotionValue = key("s: force stamps minus position stamps, in the middle of the log")
    rate: MotionValue | None = key(
        "growth of that delay, relative, of clocks that run apart; null where the log does not say",
        None,
    )
    inertia: InertiaValue = key("kg m²: of the terminal, about the LCS origin")
    friction: MotionValue = key("N·m: Coulomb friction of each hinge")
    halves_p_value: Probability = key("that the log's two halves differ by chance as they do")
    spectrum: MotionSpectrum = key("of the residual: square roots of two-sided densities")
    residual: MotionResidual | None = key(
        "lengths of the residual wrench over time, short means", None
    )
