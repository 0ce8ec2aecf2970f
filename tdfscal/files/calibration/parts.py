"""The blocks of the calibration file `tdfscal-calibration/1` that say what was found, and of what.

Everything is finite; None stands for a standard uncertainty that does not exist because the data
and the rig leave the quantity open. Tables of evidence are in `evidence`.
"""

from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, StringConstraints, model_validator

from tdfscal.files.field_types import (
    Count,
    Coverage,
    Flag,
    FreeText,
    Matrix,
    Matrix3,
    Name,
    NotNegative,
    Number,
    OpenAngles,
    OpenRows,
    OpenStd,
    OpenStdRows,
    OpenStds,
    Positive,
    Probability,
    Sha256,
    Strict,
    Text,
    Vector,
    fault,
    from_numpy,
    key,
)
from tdfscal.frozen import record
from tdfscal.records import InputFile, Integrity, Measured
from tdfscal.significance import COVERAGE_FACTOR

CALIBRATION_FORMAT: Literal["tdfscal-calibration/1"] = "tdfscal-calibration/1"

Convention = Literal[
    "F_bcs = rotation · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
    "F_bcs = rotation · sensitivity⁻¹ · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
]
CONVENTION, CONVENTION_WITH_SENSITIVITY = get_args(Convention)
CovarianceDefinition = Literal["R_true = exp([d]x) · rotation, d in the BCS, rad"]
(COVARIANCE_DEFINITION,) = get_args(CovarianceDefinition)

Status = Literal["accepted", "provisional", "rejected"]
Method = Literal["self", "tracker", "joint"]
Angle = Literal["roll", "pitch", "yaw"]
#: A turn about an axis of the BCS goes by the angle's name where it is that angle.
Turn = Literal["roll", "pitch", "yaw", "turn about X", "turn about Y", "turn about Z"]
Quaternion = Annotated[tuple[Number, Number, Number, Number], BeforeValidator(from_numpy)]
Texts = tuple[Text, ...]
Instant = Annotated[
    str,
    StringConstraints(strict=True, pattern=r"^\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2}(\.\d{1,6})?Z$"),
]
"""UTC, ISO 8601."""


def instant(time: float) -> str:
    """Write seconds since 1970 as an instant, to the second."""
    return datetime.fromtimestamp(round(time), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def seconds(text: str) -> float:
    """Read an instant as seconds since 1970."""
    return datetime.fromisoformat(text).timestamp()


class Software(Strict):
    """The program that wrote the file."""

    name: Text = key("of the program")
    version: Text = key("of the program")


class Input(Strict):
    """A file that went into the result."""

    path: FreeText = key("as it was given")
    sha256: Sha256 = key("of the file's bytes")
    bytes: Count = key("size of the file")
    integrity: Integrity = key("verified by checksums, or unverified")

    def record(self) -> InputFile:
        """Return it as a record."""
        return InputFile(self.path, self.sha256, self.bytes, self.integrity)


class MeasuredResult(Strict):
    """When the data were recorded, and whether the log, the rig file or the file's date says so."""

    begin: Instant = key("UTC: first sample")
    end: Instant = key("UTC: last sample")
    source: Literal["log", "rig", "file"] = key("what says so; rig: campaign.date")

    @model_validator(mode="before")
    @classmethod
    def _written(cls, given: Any) -> Any:
        if not isinstance(given, Measured):
            return given
        begin, end = instant(given.begin), instant(given.end)
        return {"begin": begin, "end": end, "source": given.source}

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if seconds(self.begin) > seconds(self.end):
            raise fault("ends before it begins", "end")
        return self

    @property
    def told(self) -> tuple[str, str]:
        """Begin and end as a reader is told them: days, where the rig file states a day alone."""
        if self.begin.endswith("T00:00:00Z") and self.end.endswith("T23:59:59Z"):
            return self.begin[:10], self.end[:10]
        return self.begin, self.end

    def record(self) -> Measured:
        """Return it in seconds since 1970."""
        return Measured(seconds(self.begin), seconds(self.end), self.source)


class Interval(Strict):
    """Coverage interval of roll, pitch, yaw, rad; null for an angle whose `rpy_std` is null."""

    coverage: Coverage = key("probability that the interval holds the value")
    low: OpenAngles = key("rad: lower ends of roll, pitch, yaw; null where rpy_std is")
    high: OpenAngles = key("rad: upper ends of roll, pitch, yaw; null where rpy_std is")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for low, high in zip(self.low, self.high, strict=True):
            if low is not None and high is not None and low > high:
                raise fault("an interval's low end is above its high end")
        return self


@record
class Mounting:
    """The angles of a sensor that is determined, as `SupportResult` has them."""

    name: str
    rpy: tuple[float, float, float]
    rpy_std: tuple[float, float, float]
    interval: Interval

    @property
    def half_widths(self) -> list[float]:
        """Half of each angle's interval, rad, by the farther end; without one, of its turn."""
        ends = zip(self.interval.low, self.rpy, self.interval.high, self.rpy_std, strict=True)
        return [
            COVERAGE_FACTOR * std if low is None or high is None else max(value - low, high - value)
            for low, value, high, std in ends
        ]


class SupportResult(Strict):
    """One sensor: rotation to the BCS, roll, pitch, yaw in rad, zero offset in N.

    turn_std, of the turns about the axes of the BCS, is what the gate judges; rpy_std is null where
    roll and yaw are not separable (pitch ±90°). A sensor that lacks an axis and whose mounting the
    data do not determine has no rotation and no angles, only the directions (unit vectors, BCS) of
    the axes that it measures. An axis that is not measured has no zero.
    """

    name: Name = key("of the support, as in the rig file")
    rotation: Matrix3 | None = key("3 × 3, sensor frame to BCS, determinant +1")
    rpy: OpenAngles = key("rad: roll, pitch, yaw of Rz(yaw)·Ry(pitch)·Rx(roll)")
    rpy_std: OpenStds = key("rad: standard uncertainties; null where pitch is ±90°")
    turn_std: OpenStds | None = key("rad: of the turns about the BCS axes", None)
    rpy_interval: Interval | None = key("coverage interval of each angle")
    quaternion_xyzw: Quaternion | None = key("the same rotation, scalar last")
    zero: OpenAngles = key("N: zero of each axis, sensor frame; null where not measured")
    zero_std: OpenStds = key("N: its standard uncertainty; null where open")
    sensitivity: Matrix3 | None = key("I + S, where the rig declares force_sensitivity", None)
    directions: dict[Literal["x", "y", "z"], Vector] | None = key(
        "unit vectors, BCS: axes of a sensor without rotation", None
    )

    @property
    def determined(self) -> bool:
        """It has a rotation."""
        return self.rotation is not None

    @property
    def stated_std(self) -> OpenStds:
        """Of roll, pitch, yaw; where roll and yaw are not separable, of the turns about X, Y, Z."""
        return self.turn_std if self.turn_std and None in self.rpy_std else self.rpy_std

    @property
    def mounting(self) -> Mounting | None:
        """Its angles, where the data determine them."""
        if not self.determined:
            return None
        own: Any = self  # nothing of it is missing then
        return Mounting(own.name, own.rpy, own.stated_std, own.rpy_interval)

    @model_validator(mode="after")
    def _whole(self) -> Self:
        angles = (*self.rpy, *self.stated_std, self.rpy_interval, self.quaternion_xyzw)
        if {value is None for value in angles} != {not self.determined}:
            raise fault("has some of its angles and lacks others", "rotation")
        if self.rpy_interval is not None:
            low, high = self.rpy_interval.low, self.rpy_interval.high
            each = [[value is None for value in three] for three in (low, high, self.rpy_std)]
            if each[0] != each[1] or any(
                a and not b for a, b in zip(each[0], each[2], strict=True)
            ):
                raise fault("lacks an end where the other, or rpy_std, is stated", "rpy_interval")
        if self.determined != (self.directions is None):
            raise fault("belongs to a sensor without rotation, and to no other", "directions")
        return self


class Covariance(Strict):
    """Covariance (3n, 3n) in rad² of the rotations of all supports together."""

    parameters: Texts = key("names of rows and columns")
    definition: CovarianceDefinition = key("what the parameters are")
    matrix: Matrix = key("rad²: 3n × 3n, symmetric")


class MassResult(Strict):
    """kg."""

    value: Positive = key("kg")
    std: OpenStd = key("kg: standard uncertainty; null where open", None)


class BarycenterResult(Strict):
    """m, LCS."""

    value: Vector = key("m, LCS")
    std: OpenStds = key("m: standard uncertainty of each coordinate; null where open")


class TerminalResult(Strict):
    """Mass and barycentre after the adjustment."""

    mass: MassResult = key("of the terminal and its load")
    barycenter: BarycenterResult = key("of the terminal and its load")


class Slopes(Strict):
    """How the zeros moved by one cause, per support and axis."""

    value: OpenRows = key("per support, of each axis; null where not measured")
    std: OpenStdRows = key("standard uncertainties, in the same unit; null where open")


class RejectedPosture(Strict):
    """A posture left out of the fit, with its time in s."""

    index: Count = key("number of the dwell, from 0")
    start: Number = key("s in the log's time")
    end: Number = key("s in the log's time")
    code: Text = key("of the finding about it")
    reason: Text = key("in words")


class FitResult(Strict):
    """How the model fits: its residuals against what is stated."""

    postures: Count = key("number of postures used")
    rejected: tuple[RejectedPosture, ...] = key("postures left out, with the reason", ())
    chi2: NotNegative = key("weighted sum of squared residuals, χ²")
    dof: Count = key("degrees of freedom")
    p_value: Probability = key("probability of a larger χ² by chance")
    birge: NotNegative = key("Birge ratio, √(χ²/dof)")
    rms_force: NotNegative = key("N: root mean square of the residual force")
    rms_moment: NotNegative = key("N·m: of the residual moment about the barycentre")


class AngleSeen(Strict):
    """What the data say of one angle."""

    support: Name = key("name of the support")
    angle: Turn = key("roll, pitch or yaw")
    std: OpenStd = key("rad: standard uncertainty; missing where undetermined", None)
    prior_std: OpenStd = key("rad: before the data; null without a prior", None)
    identified: Flag = key("whether the data determine it")


class ForecastResult(Strict):
    """What a change of the campaign would bring."""

    change: Literal["postures", "squeeze", "tare", "seconds"] = key("what is changed")
    amount: NotNegative = key("postures more; N, internal force; N, of a zero; s, of motion")
    worst_std: NotNegative = key("rad: largest standard uncertainty of an angle to expect")


class ObservabilityResult(Strict):
    """The verdict in words and numbers."""

    verdict: Text = key("one sentence")
    angles: tuple[AngleSeen, ...] = key("every angle with what is known of it")
    with_moves: NotNegative | None = key("rad: mean to expect with --samples all", None)
    forecasts: tuple[ForecastResult, ...] = key("what changes would bring", ())


class FindingResult(Strict):
    """Something that was found; by its severity and code the status follows."""

    code: Text = key("what it is; the catalogue lists all codes")
    severity: Literal["refuses", "rejects", "warns", "notes"] = key("how grave it is")
    subject: tuple[FreeText, ...] = key("supports, channels, files or lines that it is about", ())
    size: Number | None = key("how much, in `unit`", None)
    unit: FreeText | None = key("of the size", None)
    p_value: Probability | None = key("probability that chance alone shows as much", None)
    harm: NotNegative | None = key("rad: by how much it would move the worst angle", None)
    text: Text = key("what was found, in words")
    cure: FreeText | None = key("what to do about it, where something is", None)

    @property
    def told(self) -> str:
        """What was found, and what to do about it."""
        return f"{self.text}: {self.cure}" if self.cure else self.text


class HistoryEntry(Strict):
    """A calibration that this one stands on, by the hash of its file; the oldest first."""

    created: Instant = key("UTC: when it was computed")
    measured: MeasuredResult = key("when its data were recorded")
    method: Method = key("self, tracker or joint")
    sha256: Sha256 = key("of the calibration's file")
