"""What lies behind a result, as models: optional parts of a calibration file, for its report."""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import BeforeValidator, model_validator

from tdfscal.files.field_types import (
    Count,
    Name,
    NotNegative,
    Number,
    Strict,
    Text,
    Vector,
    Vectors,
    fault,
    from_numpy,
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
Numbers = Annotated[tuple[Number, ...], BeforeValidator(from_numpy)]


class Stretch(Strict):
    """A stretch of the log in s that is no posture, and why."""

    start: Number
    end: Number
    reason: Text


class PostureTable(Strict):
    """The postures in the fit, column by column.

    index counts all dwells from 0; start, end in s as the log counts them. left_out: stretches
    that the search for dwells refused. force_std, moment_std: standard uncertainties of force_after
    and moment_after, each axis, by what is stated.
    """

    definition: PosturesDefinition
    index: Counts
    start: Numbers
    end: Numbers
    force_before: Vectors
    force_after: Vectors
    moment_before: Vectors
    moment_after: Vectors
    left_out: tuple[Stretch, ...] | None = None
    force_std: Vectors | None = None
    moment_std: Vectors | None = None

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

    start: Numbers
    end: Numbers
    force: tuple[Vectors, ...]
    temperature: Numbers | None = None

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

    support: Name
    axis: Vector
    spread: NotNegative
    across: NotNegative


class Histogram(Strict):
    """Monte Carlo trials in bins, per support and angle (roll, pitch, yaw)."""

    definition: HistogramDefinition
    edges: Numbers
    counts: tuple[tuple[Counts, Counts, Counts], ...]

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

    method: Literal["self", "tracker"]
    rpy: Vectors
    rpy_std: Vectors
