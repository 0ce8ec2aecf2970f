"""What lies behind a result, as models: optional parts of a calibration file, for its report."""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import BeforeValidator, model_validator

from tdfscal.files.field_types import (
    Count,
    Name,
    NotNegative,
    Number,
    Numbers,
    Strict,
    Text,
    Vector,
    Vectors,
    fault,
    from_numpy,
    key,
)

PosturesDefinition = Literal[
    "contact wrench that remains, N and N·m, LCS axes, moment about the LCS origin; "
    "before: nominal mounting and stated zeros, after: calibrated without the posture"
]
(POSTURES_DEFINITION,) = get_args(PosturesDefinition)
HistogramDefinition = Literal[
    "trials per bin of (angle − estimate) / rpy_std; those beyond the edges are not counted"
]
(HISTOGRAM_DEFINITION,) = get_args(HistogramDefinition)

Counts = Annotated[tuple[Count, ...], BeforeValidator(from_numpy)]


class Stretch(Strict):
    """A stretch of the log in s that is no posture, and why."""

    start: Number = key("s in the log's time")
    end: Number = key("s in the log's time")
    reason: Text = key("in words")


class PostureTable(Strict):
    """The postures in the fit, column by column.

    index counts all dwells from 0; start, end in s as the log counts them. left_out: stretches
    that the search for dwells refused. force_std, moment_std: standard uncertainties of force_after
    and moment_after, each axis, by what is stated.
    """

    definition: PosturesDefinition = key("what the columns are")
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
        for name in type(self).model_fields.keys() - {"definition", "index", "left_out"}:
            column = getattr(self, name)
            if column is not None and len(column) != len(self.index):
                raise fault("has not one entry per posture", name)
        return self


class DwellTable(Strict):
    """All dwells, column by column: start, end in s as the log counts them, and the mean readings.

    force: per support, per dwell; N, sensor frame, as tdfscal's sign has it. temperature: °C.
    """

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
    """Where the loads on a sensor point.

    axis: mean line of action in the BCS, a unit vector. spread: angle in rad about it within which
    the loads stay (quadratic mean). across: quadratic mean of the load across it, N.
    """

    support: Name = key("name of the support")
    axis: Vector = key("mean line of action, unit vector, BCS")
    spread: NotNegative = key("rad: how far the loads spread about it")
    across: NotNegative = key("N: load across the mean line of action")


class Histogram(Strict):
    """Monte Carlo trials in bins, per support and angle (roll, pitch, yaw)."""

    definition: HistogramDefinition = key("what is counted")
    edges: Numbers = key("rad: edges of the bins, per angle")
    counts: tuple[tuple[Counts, Counts, Counts], ...] = key("trials between two edges, per angle")

    @model_validator(mode="after")
    def _binned(self) -> Self:
        if any(low >= high for low, high in zip(self.edges, self.edges[1:], strict=False)):
            raise fault("must ascend", "edges")
        for angles in self.counts:
            if any(len(angle) != len(self.edges) - 1 for angle in angles):
                raise fault("must have one number per bin", "counts")
        return self


class MethodAngles(Strict):
    """What one method alone says: roll, pitch, yaw per support with standard uncertainties, rad."""

    method: Literal["self", "tracker"] = key("self or tracker")
    rpy: Vectors = key("rad: roll, pitch, yaw of each support")
    rpy_std: Vectors = key("rad: their standard uncertainties")
