"""The parts of the calibration file `tdfscal-calibration/1` as models.

Everything is finite; None stands for a standard uncertainty that does not exist because the data
and the rig leave the quantity open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import AfterValidator, BeforeValidator, JsonValue, model_validator

from tdfscal.files.calibration.evidence_model import Histogram, SensorLoad
from tdfscal.files.field_types import (
    Correlation,
    Count,
    Coverage,
    Flag,
    FreeText,
    Matrix,
    Matrix3,
    Name,
    NotNegative,
    Number,
    Positive,
    PositiveCount,
    Probability,
    Sha256,
    Strict,
    Text,
    Vector,
    Vectors,
    fault,
    finite_json,
    from_numpy,
)
from tdfscal.records import InputFile, Integrity

CALIBRATION_FORMAT: Literal["tdfscal-calibration/1"] = "tdfscal-calibration/1"

Convention = Literal[
    "F_bcs = rotation · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
    "F_bcs = rotation · sensitivity⁻¹ · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
]
CONVENTION, CONVENTION_WITH_SENSITIVITY = get_args(Convention)
CovarianceDefinition = Literal["R_true = exp([d]x) · rotation, d in the BCS, rad"]
(COVARIANCE_DEFINITION,) = get_args(CovarianceDefinition)


def none_where_open(value: Any) -> Any:
    """Return the ∞ of a record's arrays as None; ∞ in a file stays what it is, an error."""
    if isinstance(value, np.ndarray):
        return [none_where_open(v) for v in value]
    if isinstance(value, np.generic):
        return None if value == np.inf else value.item()
    return value


Angle = Literal["roll", "pitch", "yaw"]
#: A turn about an axis of the BCS goes by the angle's name where it is that angle.
Turn = Literal["roll", "pitch", "yaw", "turn about X", "turn about Y", "turn about Z"]
OpenStd = Annotated[NotNegative | None, BeforeValidator(none_where_open)]
OpenStds = Annotated[tuple[OpenStd, OpenStd, OpenStd], BeforeValidator(none_where_open)]
OpenAngles = Annotated[
    tuple[Number | None, Number | None, Number | None], BeforeValidator(from_numpy)
]
Quaternion = Annotated[tuple[Number, Number, Number, Number], BeforeValidator(from_numpy)]
Texts = tuple[Text, ...]


class Software(Strict):
    """The program that wrote the file."""

    name: Text
    version: Text


class Input(Strict):
    """A file that went into the result."""

    path: FreeText
    sha256: Sha256
    bytes: Count
    integrity: Integrity
    note: Text | None = None

    def record(self) -> InputFile:
        """Return it as a record."""
        return InputFile(self.path, self.sha256, self.bytes, self.integrity, self.note)


class Interval(Strict):
    """Coverage interval of roll, pitch, yaw, rad."""

    coverage: Coverage
    low: Vector
    high: Vector

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            raise fault("an interval's low end is above its high end")
        return self


@dataclass(frozen=True, slots=True)
class Mounting:
    """The angles of a sensor that is determined, as `SupportResult` has them."""

    name: str
    rotation: tuple[tuple[float, float, float], ...]
    rpy: tuple[float, float, float]
    rpy_std: tuple[float, float, float]
    turn_std: tuple[float, ...] | None
    interval: Interval
    quaternion: tuple[float, float, float, float]


class SupportResult(Strict):
    """One sensor: rotation to the BCS, roll, pitch, yaw in rad, zero offset in N.

    turn_std, of the turns about the axes of the BCS, is what the gate judges; rpy_std is null where
    roll and yaw are not separable (pitch ±90°). A sensor that lacks an axis and whose mounting the
    data do not determine has no rotation and no angles, only the directions (unit vectors, BCS) of
    the axes that it measures. An axis that is not measured has no zero.
    """

    name: Name
    rotation: Matrix3 | None
    rpy: OpenAngles
    rpy_std: OpenStds
    turn_std: OpenStds | None = None
    rpy_interval: Interval | None
    quaternion_xyzw: Quaternion | None
    zero: OpenAngles
    zero_std: OpenStds
    sensitivity: Matrix3 | None = None
    directions: dict[Literal["x", "y", "z"], Vector] | None = None

    @property
    def determined(self) -> bool:
        """It has a rotation."""
        return self.rotation is not None

    @property
    def offset(self) -> tuple[float, float, float]:
        """Its zero, N; 0 for an axis that is not measured."""
        x, y, z = (0.0 if value is None else value for value in self.zero)
        return x, y, z

    @property
    def stated_std(self) -> OpenStds:
        """Of roll, pitch, yaw; where roll and yaw are not separable, of the turns about X, Y, Z."""
        return self.turn_std if self.turn_std and None in self.rpy_std else self.rpy_std

    @property
    def mounting(self) -> Mounting | None:
        """Its angles, where the data determine them."""
        if self.rotation is None or self.rpy_interval is None or self.quaternion_xyzw is None:
            return None
        rpy, std = ([v for v in values if v is not None] for values in (self.rpy, self.stated_std))
        return Mounting(
            self.name,
            self.rotation,
            (rpy[0], rpy[1], rpy[2]),
            (std[0], std[1], std[2]),
            None if self.turn_std is None else tuple(v for v in self.turn_std if v is not None),
            self.rpy_interval,
            self.quaternion_xyzw,
        )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        angles = (*self.rpy, *self.stated_std, self.rpy_interval, self.quaternion_xyzw)
        absent = [value is None for value in angles]
        if any(absent) != (not self.determined) or all(absent) != (not self.determined):
            raise fault("has some of its angles and lacks others", "rotation")
        if self.determined != (self.directions is None):
            raise fault("belongs to a sensor without rotation, and to no other", "directions")
        return self


class Covariance(Strict):
    """Covariance (3n, 3n) in rad² of the rotations of all supports together."""

    parameters: Texts
    definition: CovarianceDefinition
    matrix: Matrix


class MassResult(Strict):
    """kg."""

    value: Positive
    std: OpenStd = None


class BarycenterResult(Strict):
    """m, LCS."""

    value: Vector
    std: OpenStds


class TerminalResult(Strict):
    """Mass and barycentre after the adjustment."""

    mass: MassResult
    barycenter: BarycenterResult


class RejectedPosture(Strict):
    """A posture left out of the fit, with its time in s."""

    index: Count
    start: Number | None = None
    end: Number | None = None
    reason: Text


class FitResult(Strict):
    """How the model fits: rms_force in N, rms_moment in N·m.

    channel_noise : of each channel over what is stated, where the residuals show it unequal.
    kurtosis : of leave-one-out residuals over that of normal ones; more: heavy tails.
    """

    postures: Count
    rejected: tuple[RejectedPosture, ...] = ()
    chi2: NotNegative
    dof: Count
    p_value: Probability
    birge: NotNegative
    rms_force: NotNegative
    rms_moment: NotNegative
    iterations: Count
    converged: Flag
    channel_noise: Vectors | None = None
    kurtosis: NotNegative | None = None


class AngleSeen(Strict):
    """What the data say of one angle, rad; prior_std None where there is no prior.

    std None of an angle of a sensor that lacks an axis and stays undetermined.
    """

    support: Name
    angle: Turn
    std: OpenStd = None
    prior_std: OpenStd = None
    identified: Flag


class WeakestAngle(Strict):
    """The angle with the largest standard uncertainty, rad."""

    name: Text
    std: OpenStd = None
    cause: Text


class WeakAngle(WeakestAngle):
    """An angle that the data do not determine, and what to do."""

    advice: Text


class CloseCouple(Strict):
    """Two angles whose errors go together."""

    a: Text
    b: Text
    value: Correlation


class ObservabilityResult(Strict):
    """The verdict in words and numbers."""

    verdict: Text
    weakest: WeakestAngle | None = None
    angles: tuple[AngleSeen, ...]
    weak: tuple[WeakAngle, ...] = ()
    correlations: tuple[CloseCouple, ...] = ()
    loads: tuple[SensorLoad, ...] | None = None


class AngleBudget(Strict):
    """Variance of one angle by source, rad²."""

    support: Name
    angle: Angle
    variance: dict[Text, NotNegative]


class Budget(Strict):
    """Contribution of each source to each angle's variance."""

    sources: Texts
    angles: tuple[AngleBudget, ...]

    @model_validator(mode="after")
    def _complete(self) -> Self:
        for index, angle in enumerate(self.angles):
            if set(angle.variance) != set(self.sources):
                raise fault("does not name the sources listed", "angles", index, "variance")
        return self


class ExactEffect(Strict):
    """By how much a typical error of a quantity would turn a sensor, rad."""

    name: Name
    turn: Vector
    rpy: Vector | None = None


class ExactQuantityResult(Strict):
    """A quantity that was taken as exact, and a typical error of each of its components."""

    name: Text
    error: NotNegative
    unit: Text
    supports: tuple[ExactEffect, ...]


class MonteCarloResult(Strict):
    """Standard deviation and interval ends of roll, pitch, yaw per support, rad."""

    trials: PositiveCount
    seed: Count
    rpy_std: Vectors
    low: Vectors
    high: Vectors
    tolerance: NotNegative
    linear_interval_validated: Flag
    histogram: Histogram | None = None


class ResidualWrench(Strict):
    """Residual of held-out postures without and with the calibration: N or N·m."""

    rms_before: NotNegative
    rms_after: NotNegative
    max_before: NotNegative
    max_after: NotNegative


class ValidationResult(Strict):
    """Cross-validation: residual contact wrench of leave-one-out postures."""

    method: Text
    postures: Count
    force: ResidualWrench
    moment: ResidualWrench


class ChangeResult(Strict):
    """A change of the unexplained wrench, N and N·m, and the chance that it is noise."""

    force: NotNegative
    moment: NotNegative
    p_value: Probability


class StabilityResult(Strict):
    """Drift over the campaign; repeatability and hysteresis where postures were visited again."""

    drift: ChangeResult
    returns: Count
    repeat: ChangeResult | None = None
    hysteresis: ChangeResult | None = None


class LimitedResult(Strict):
    """A contact force or torque, N or N·m: expanded uncertainty (k = 2), limit, and their verdict.

    Decision rule: guard band, |deviation| + U ≤ limit (JCGM 106).
    """

    expanded_uncertainty: NotNegative
    limit: OpenStd = None
    probability_exceeding: Probability
    conforms: Flag


class ConformityResult(Strict):
    """The contact wrench's uncertainty at a posture against the rig file's limits."""

    rpy: Vector
    force: LimitedResult
    torque: LimitedResult


class QualityResult(Strict):
    """Why the gate rejects the result; no reason where it accepts.

    advice: cures of what the residuals say, harmful or not, that of the surest finding first.
    """

    reasons: Texts = ()
    advice: Texts = ()


def _finite(given: dict[str, Any]) -> dict[str, Any]:
    if not finite_json(given):
        raise fault("holds a number that is not finite")
    return given


TrackerStatistics = Annotated[
    dict[str, JsonValue],
    BeforeValidator(lambda given: dict(given) if isinstance(given, dict) else given),
    AfterValidator(_finite),
]
"""χ², degrees of freedom, p-value, Birge ratio, number of points … of the tracker's survey."""
