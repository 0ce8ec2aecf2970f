"""The blocks of the calibration file `tdfscal-calibration/1` that say what was found, and of what.

Everything is finite; None stands for a standard uncertainty that does not exist because the data
and the rig leave the quantity open. Tables of evidence are in `evidence`.
"""

import re
from contextlib import suppress
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, WithJsonSchema, model_validator

from tdfscal.files import field_types as kind
from tdfscal.files.field_types import Known, Strict, fault, key
from tdfscal.frozen import record
from tdfscal.records import InputFile, Integrity, Measured

CALIBRATION_FORMAT: Literal["tdfscal-calibration/1"] = "tdfscal-calibration/1"

Convention = Literal[
    "F_bcs = rotation · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
    "F_bcs = rotation · sensitivity⁻¹ · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
]
CONVENTIONS = get_args(Convention)
"""Without and with sensitivities."""
CovarianceDefinition = Literal["R_true = exp([d]x) · rotation, d in the BCS, rad"]
(COVARIANCE_DEFINITION,) = get_args(CovarianceDefinition)

Status = Literal["accepted", "provisional", "rejected"]
Method = Literal["self", "tracker", "joint"]
Angle = Literal["roll", "pitch", "yaw"]
Texts = tuple[kind.Text, ...]
_INSTANT = r"^\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2}(\.\d{1,6})?Z$"


def _instant(value: Any) -> str:
    with suppress(TypeError, ValueError):
        if re.match(_INSTANT, value):
            datetime.fromisoformat(value)
            return str(value)
    raise fault(f"is no instant: {value!r:.40}", hint="write it as 2026-11-21T08:30:00Z, UTC")


Instant = Annotated[
    str, BeforeValidator(_instant), WithJsonSchema({"type": "string", "pattern": _INSTANT})
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

    name: kind.Text = key("of the program")
    version: kind.Text = key("of the program")


class Input(Strict):
    """A file that went into the result."""

    path: kind.FreeText = key("as it was given")
    sha256: kind.Sha256 = key("of the file's bytes")
    bytes: kind.Count = key("size of the file")
    integrity: Integrity = key("verified by checksums, or unverified")

    def record(self) -> InputFile:
        """Return it as a record."""
        return InputFile(self.path, self.sha256, self.bytes, self.integrity)


class MeasuredResult(Strict):
    """When the data were recorded, and whether the log, the rig file or the file's date says so."""

    begin: Instant = key("UTC: first sample")
    end: Instant = key("UTC: last sample")
    source: Literal["log", "rig", "file"] = key("what says so; rig: campaign.date")

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

    @classmethod
    def of(cls, when: Measured) -> Self:
        """Write a record, in seconds since 1970, to the second."""
        return cls(begin=instant(when.begin), end=instant(when.end), source=when.source)

    def record(self) -> Measured:
        """Return it in seconds since 1970."""
        return Measured(seconds(self.begin), seconds(self.end), self.source)


class Interval(Strict):
    """Coverage interval of roll, pitch, yaw, rad; null for an angle whose `rpy_std` is null."""

    coverage: kind.Coverage = key("probability that the interval holds the value")
    low: kind.OpenAngles = key("rad: lower ends of roll, pitch, yaw; null where rpy_std is")
    high: kind.OpenAngles = key("rad: upper ends of roll, pitch, yaw; null where rpy_std is")


@record
class Mounting:
    """The angles of a sensor that is determined, as `SupportResult` has them."""

    name: str
    rpy: tuple[float, float, float]
    rpy_std: tuple[float, float, float]
    interval: Interval


class SupportResult(Strict):
    """One sensor: rotation to the BCS, roll, pitch, yaw in rad, zero offset in N.

    turn_std, of the turns about the axes of the BCS, is what the gate judges; rpy_std is null where
    roll and yaw are not separable (pitch ±90°). A sensor that lacks an axis and whose mounting the
    data do not determine has no rotation and no angles, only the directions (unit vectors, BCS) of
    the axes that it measures. An axis that is not measured has no zero.
    """

    name: kind.Name = key("of the support, as in the rig file")
    rotation: kind.Matrix3 | None = key("3 × 3, sensor frame to BCS, determinant +1", None)
    rpy: kind.OpenAngles = key("rad: roll, pitch, yaw of Rz(yaw)·Ry(pitch)·Rx(roll)")
    rpy_std: kind.OpenStds = key("rad: standard uncertainties; null where pitch is ±90°")
    turn_std: kind.OpenStds | None = key("rad: of the turns about the BCS axes", None)
    rpy_interval: Interval | None = key("coverage interval of each angle", None)
    quaternion_xyzw: kind.Quaternion | None = key("the same rotation, scalar last", None)
    zero: kind.OpenAngles = key("N: zero of each axis, sensor frame; null where not measured")
    zero_std: kind.OpenStds = key("N: its standard uncertainty; null where open")
    sensitivity: kind.Matrix3 | None = key("I + S, where the rig declares force_sensitivity", None)
    directions: dict[Literal["x", "y", "z"], kind.Vector] | None = key(
        "unit vectors, BCS: axes of a sensor without rotation", None
    )

    @property
    def determined(self) -> bool:
        """It has a rotation."""
        return self.rotation is not None

    @property
    def stated_std(self) -> kind.OpenStds:
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
        ends, alone = self.rpy_interval, (self.quaternion_xyzw,)
        angles = {"rpy": self.rpy, "rpy_std": self.stated_std, "quaternion_xyzw": alone}
        for name, stated in (angles | {"rpy_interval": (ends,)}).items():
            if {value is None for value in stated} != {not self.determined}:
                raise fault(f"has a rotation without all of `{name}`, or the reverse", name)
        for low, high, std in zip(ends.low, ends.high, self.rpy_std, strict=True) if ends else ():
            if not (low is None) == (high is None) == (std is None):
                raise fault("lacks an end where the other, or rpy_std, is stated", "rpy_interval")
            if low is not None and high is not None and low > high:
                raise fault("has its low end above its high end", "rpy_interval")
        if self.determined != (self.directions is None):
            raise fault("belongs to a sensor without rotation, and to no other", "directions")
        return self


class Covariance(Strict):
    """Covariance (3n, 3n) in rad² of the rotations of all supports together."""

    parameters: Texts = key("names of rows and columns")
    definition: CovarianceDefinition = key("what the parameters are")
    matrix: kind.Matrix = key("rad²: 3n × 3n, symmetric")


Slopes = Known[kind.OpenRows, kind.OpenStdRows]
BarycenterResult = Known[kind.Vector, kind.OpenStds]


class Mass(Known[kind.Positive, kind.OpenStd]):
    """The estimate of a mass, kg."""

    std: kind.OpenStd = key("kg: standard uncertainty; null where open", None)


class TerminalResult(Strict):
    """Mass and barycentre after the adjustment, with what the terminal carries."""

    mass: Mass = key("kg")
    barycenter: BarycenterResult = key("m, LCS")


class Stretch(Strict):
    """A stretch of the log that is no posture, and why."""

    start: kind.Number = key("s in the log's time")
    end: kind.Number = key("s in the log's time")
    reason: kind.Text = key("in words")


class RejectedPosture(Stretch):
    """A posture left out of the fit."""

    index: kind.Count = key("number of the dwell, from 0")
    code: kind.Text = key("of the finding about it")


class Agreement(Strict):
    """How residuals stand against what is stated of them."""

    chi2: kind.NotNegative = key("weighted sum of squared residuals, χ²")
    dof: kind.Count = key("degrees of freedom")
    p_value: kind.Probability = key("probability of a larger χ² by chance")
    birge: kind.NotNegative = key("Birge ratio, √(χ²/dof)")


class FitResult(Agreement):
    """How the model fits."""

    postures: kind.Count = key("number of postures used")
    rejected: tuple[RejectedPosture, ...] = key("postures left out, with the reason", ())
    rms_force: kind.NotNegative = key("N: root mean square of the residual force")
    rms_moment: kind.NotNegative = key("N·m: of the residual moment about the barycentre")


class ForecastResult(Strict):
    """What a change of the campaign would bring."""

    change: Literal["postures", "squeeze", "tare", "seconds"] = key("what is changed")
    amount: kind.NotNegative = key("postures more; N, internal force; N, of a zero; s, of motion")
    worst_std: kind.NotNegative = key("rad: largest standard uncertainty of an angle to expect")


class ObservabilityResult(Strict):
    """The verdict in words and numbers."""

    verdict: kind.Text = key("one sentence")
    angles: tuple[dict[kind.Name, kind.Flag | kind.Number | kind.Text | None], ...] | None = key(
        "of release 1.0, which wrote what `supports` says a second time", None
    )
    with_moves: kind.NotNegative | None = key("rad: mean to expect with --samples all", None)
    forecasts: tuple[ForecastResult, ...] = key("what changes would bring", ())


class FindingResult(Strict):
    """Something that was found; by its severity and code the status follows."""

    code: kind.Text = key("what it is; the catalogue lists all codes")
    severity: Literal["refuses", "rejects", "warns", "notes"] = key("how grave it is")
    subject: tuple[kind.FreeText, ...] = key("supports, channels, files, lines", ())
    size: kind.Number | None = key("how much, in `unit`", None)
    unit: kind.FreeText | None = key("of the size", None)
    p_value: kind.Probability | None = key("probability that chance alone shows as much", None)
    harm: kind.NotNegative | None = key("rad: by how much it would move the worst angle", None)
    text: kind.Text = key("what was found, in words")
    cure: kind.FreeText | None = key("what to do about it, where something is", None)

    @property
    def told(self) -> str:
        """What was found, and what to do about it."""
        return f"{self.text}: {self.cure}" if self.cure else self.text


class HistoryEntry(Strict):
    """A calibration that this one stands on, by the hash of its file; the oldest first."""

    created: Instant = key("UTC: when it was computed")
    measured: MeasuredResult = key("when its data were recorded")
    method: Method = key("self, tracker or joint")
    sha256: kind.Sha256 = key("of the calibration's file")
