"""The parts of the calibration file `tdfscal-calibration/1` as models.

Everything is finite; None stands for a standard uncertainty that does not exist because the data
and the rig leave the quantity open.
"""

import json
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    JsonValue,
    StringConstraints,
    model_validator,
)

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
    Numbers,
    OpenAngles,
    OpenRows,
    OpenStd,
    OpenStdRows,
    OpenStds,
    Positive,
    PositiveCount,
    Probability,
    Sha256,
    Strict,
    Text,
    Vector,
    Vectors,
    fault,
    from_numpy,
    key,
)
from tdfscal.frozen import record
from tdfscal.numerics.distributions import trials_decide
from tdfscal.records import FloatArray, InputFile, Integrity, Measured
from tdfscal.significance import COVERAGE_FACTOR

CALIBRATION_FORMAT: Literal["tdfscal-calibration/1"] = "tdfscal-calibration/1"

Convention = Literal[
    "F_bcs = rotation · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
    "F_bcs = rotation · sensitivity⁻¹ · (F_sensor − zero); rotation = Rz(yaw)·Ry(pitch)·Rx(roll)",
]
CONVENTION, CONVENTION_WITH_SENSITIVITY = get_args(Convention)
CovarianceDefinition = Literal["R_true = exp([d]x) · rotation, d in the BCS, rad"]
(COVARIANCE_DEFINITION,) = get_args(CovarianceDefinition)


Method = Literal["self", "tracker", "joint"]
Angle = Literal["roll", "pitch", "yaw"]
#: A turn about an axis of the BCS goes by the angle's name where it is that angle.
Turn = Literal["roll", "pitch", "yaw", "turn about X", "turn about Y", "turn about Z"]
Quaternion = Annotated[tuple[Number, Number, Number, Number], BeforeValidator(from_numpy)]
Texts = tuple[Text, ...]
Counts = Annotated[tuple[Count, ...], BeforeValidator(from_numpy)]
#: Edges of the bins of Monte Carlo trials, in standard uncertainties: normally one trial in 16 000
#: lies beyond.
EDGES = np.linspace(-4.0, 4.0, 33)
Bins = Annotated[Counts, Field(min_length=len(EDGES) - 1, max_length=len(EDGES) - 1)]


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
    note: Text | None = key("what is odd about where it lies", None)

    def record(self) -> InputFile:
        """Return it as a record."""
        return InputFile(self.path, self.sha256, self.bytes, self.integrity, self.note)


class Interval(Strict):
    """Coverage interval of roll, pitch, yaw, rad; null for an angle whose `rpy_std` is null."""

    coverage: Coverage = key("probability that the interval holds the value")
    low: OpenAngles = key("rad: lower ends of roll, pitch, yaw; null where rpy_std is")
    high: OpenAngles = key("rad: upper ends of roll, pitch, yaw; null where rpy_std is")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ends = list(zip(self.low, self.high, strict=True))
        if any((low is None) != (high is None) for low, high in ends):
            raise fault("an interval has one of its ends and lacks the other")
        if any(low > high for low, high in ends if low is not None and high is not None):
            raise fault("an interval's low end is above its high end")
        return self


@record
class Mounting:
    """The angles of a sensor that is determined, as `SupportResult` has them."""

    name: str
    rotation: tuple[tuple[float, float, float], ...]
    rpy: tuple[float, float, float]
    rpy_std: tuple[float, float, float]
    turn_std: tuple[float, ...] | None
    interval: Interval

    @property
    def half_widths(self) -> list[float]:
        """Half of each angle's interval, rad, by the farther end; without one, of its turn."""
        turns = self.turn_std or self.rpy_std
        ends = zip(self.interval.low, self.rpy, self.interval.high, turns, strict=True)
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
        if not self.determined:
            return None
        own: Any = self  # nothing of it is missing then
        return Mounting(
            name=own.name,
            rotation=own.rotation,
            rpy=own.rpy,
            rpy_std=own.stated_std,
            turn_std=own.turn_std,
            interval=own.rpy_interval,
        )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        angles = (*self.rpy, *self.stated_std, self.rpy_interval, self.quaternion_xyzw)
        absent = [value is None for value in angles]
        if any(absent) != (not self.determined) or all(absent) != (not self.determined):
            raise fault("has some of its angles and lacks others", "rotation")
        if self.rpy_interval is not None:
            ends = zip(self.rpy_interval.low, self.rpy_std, strict=True)
            if any(low is None and std is not None for low, std in ends):
                raise fault("lacks an interval whose rpy_std is stated", "rpy_interval")
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


class RejectedPosture(Strict):
    """A posture left out of the fit, with its time in s."""

    index: Count = key("number of the dwell, from 0")
    start: Number | None = key("s in the log's time", None)
    end: Number | None = key("s in the log's time", None)
    code: Text | None = key("of the finding about it", None)
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
    channel_noise: Vectors | None = key("over the stated one, where channels differ", None)
    kurtosis: NotNegative | None = key("of the residuals; above 1: heavy tails", None)


class AngleSeen(Strict):
    """What the data say of one angle."""

    support: Name = key("name of the support")
    angle: Turn = key("roll, pitch or yaw")
    std: OpenStd = key("rad: standard uncertainty; missing where undetermined", None)
    prior_std: OpenStd = key("rad: before the data; null without a prior", None)
    identified: Flag = key("whether the data determine it")


class SensorLoad(Strict):
    """Where the loads on a sensor point; quadratic means of what lies about it."""

    support: Name = key("name of the support")
    axis: Vector = key("mean line of action, unit vector, BCS")
    spread: NotNegative = key("rad: how far the loads spread about it")
    across: NotNegative = key("N: load across the mean line of action")


class ForecastResult(Strict):
    """What a change of the campaign would bring."""

    change: Literal["postures", "squeeze", "tare", "seconds"] = key("what is changed")
    amount: NotNegative = key("postures more; N, internal force; N, of a zero; s, of motion")
    worst_std: NotNegative = key("rad: largest standard uncertainty of an angle to expect")


class ObservabilityResult(Strict):
    """The verdict in words and numbers."""

    verdict: Text = key("one sentence")
    angles: tuple[AngleSeen, ...] = key("every angle with what is known of it")
    loads: tuple[SensorLoad, ...] | None = key("where the loads on each sensor point", None)
    with_moves: NotNegative | None = key("rad: mean to expect with --samples all", None)
    forecasts: tuple[ForecastResult, ...] = key("what changes would bring", ())


class AngleBudget(Strict):
    """Variance of one angle by source, rad²."""

    support: Name = key("name of the support")
    angle: Angle = key("roll, pitch or yaw")
    variance: dict[Text, NotNegative] = key("rad²: contribution of each source")


class Budget(Strict):
    """Contribution of each source to each angle's variance."""

    sources: Texts = key("names of the sources")
    angles: tuple[AngleBudget, ...] = key("one entry per angle")

    @property
    def shares(self) -> FloatArray:
        """(angles, sources), share of each angle's variance; 0 where it has none."""
        table = np.array([[angle.variance[s] for s in self.sources] for angle in self.angles])
        total = table.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(table, total, out=np.zeros_like(table), where=total > 0))


class ExactEffect(Strict):
    """By how much a typical error of a quantity would turn a sensor, rad."""

    name: Name = key("name of the support")
    turn: Vector = key("rad: of the turn about the BCS axes")
    rpy: Vector | None = key("rad: of roll, pitch, yaw; null where these are not separable", None)


class ExactQuantityResult(Strict):
    """A quantity that was taken as exact, and a typical error of each of its components."""

    name: Text = key("the quantity")
    error: NotNegative = key("a typical error of each component, in `unit`")
    unit: Text = key("of the error")
    supports: tuple[ExactEffect, ...] = key("what it does to each sensor")
    common: Matrix | None = key(
        "SI: move of each of `parameters` (without these, of `covariance`) by that error of each "
        "component, which campaigns of the rig have in common; for `update`",
        None,
    )
    apart: Matrix | None = key("SI: the same by errors that each campaign has anew", None)


class MonteCarloResult(Strict):
    """Standard deviation and interval ends of roll, pitch, yaw per support, rad."""

    trials: PositiveCount = key("number of trials")
    rpy_std: Vectors = key("rad: standard deviations over the trials")
    low: Vectors = key("rad: lower ends of the coverage intervals")
    high: Vectors = key("rad: upper ends of the coverage intervals")
    tolerance: NotNegative = key("rad: numerical tolerance δ (JCGM 101, 7.9.2)")
    linear_interval_validated: Flag = key("linear interval agrees (JCGM 101, 8)")
    histogram: tuple[tuple[Bins, Bins, Bins], ...] | None = key(
        "per support and angle: trials by (angle − estimate) / rpy_std, from −4 to 4 by quarters",
        None,
    )

    @property
    def decides(self) -> bool:
        """Whether the intervals stated are those of the trials."""
        return trials_decide(self.trials, validated=self.linear_interval_validated)

    @property
    def verdict(self) -> str:
        """What the trials say of the linear intervals."""
        if self.linear_interval_validated:
            return "confirm"
        return "do not confirm" if self.decides else "are too few to judge"


class ResidualWrench(Strict):
    """Residual of held-out postures without and with the calibration: N or N·m."""

    rms_before: NotNegative = key("root mean square, with the nominal mounting")
    rms_after: NotNegative = key("root mean square, calibrated")
    max_before: NotNegative = key("largest, with the nominal mounting")
    max_after: NotNegative = key("largest, calibrated")


class ValidationResult(Strict):
    """Cross-validation: residual contact wrench of leave-one-out postures."""

    method: Text = key("how postures were held out")
    postures: Count = key("number of postures")
    force: ResidualWrench = key("N: residual contact force")
    moment: ResidualWrench = key("N·m: residual contact moment")


class LimitedResult(Strict):
    """A contact force or torque, N or N·m: expanded uncertainty (k = 2), limit, and their verdict.

    Decision rule: guard band, |deviation| + U ≤ limit (JCGM 106).
    """

    expanded: NotNegative = key("uncertainty of the length, coverage 95.45 %")
    limit: Annotated[
        NotNegative | None, BeforeValidator(lambda limit: None if limit == np.inf else limit)
    ] = key("the rig file's; null where it states none", None)
    exceeding: Probability = key("that the error is beyond the limit")
    conforms: Flag = key(
        "whether the result is accepted, and the expanded uncertainty within the limit"
    )


class ConformityResult(Strict):
    """The contact wrench's uncertainty at a posture against the rig file's limits."""

    rpy: Vector = key("rad: posture of the terminal")
    force: LimitedResult = key("N: length of the force's error")
    torque: LimitedResult = key("N·m: length of the torque's error")


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


def _finite(given: dict[str, Any]) -> dict[str, Any]:
    try:
        json.dumps(given, allow_nan=False)
    except ValueError:
        raise fault("holds a number that is not finite") from None
    return given


TrackerStatistics = Annotated[
    dict[str, JsonValue],
    AfterValidator(_finite),
]
"""χ², degrees of freedom, p-value, Birge ratio, number of points … of the tracker's survey."""


Instant = Annotated[
    str,
    StringConstraints(strict=True, pattern=r"^\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2}(\.\d{1,6})?Z$"),
]
"""UTC, ISO 8601."""


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

    def record(self) -> Measured:
        """Return it in seconds since 1970."""
        return Measured(seconds(self.begin), seconds(self.end), self.source)


class ReadingsTable(Strict):
    """Mean readings, sensor frames, by which a recording is known again."""

    force: tuple[Vectors, ...] = key("N: per support, of each dwell or slowest moment of a motion")
    noise: Vectors = key("N: per support, a mean's typical standard error by noise")


class CampaignResult(Strict):
    """One of several campaigns: its own zeros and load, and what it added to χ²."""

    name: Text = key("its folder")
    measured: MeasuredResult | None = key("when it was recorded", None)
    inputs: tuple[Input, ...] = key("its files")
    zero: OpenRows = key("N: its own zeros, per sensor; null where not measured")
    zero_std: OpenStdRows = key("N: their standard uncertainties; null where open")
    terminal: TerminalResult = key("its own mass and barycentre")
    postures: Count = key("number of postures used")
    chi2: NotNegative = key("χ² that it added: its residuals, and its departure from earlier ones")
    dof: Count = key("degrees of freedom that it added")
    readings: ReadingsTable | None = key("by which its recording is known again", None)


def _without_nan(values: object) -> object:
    """Write numbers, in hundredths; null where there is none."""
    if isinstance(values, np.ndarray):
        return [None if np.isnan(v) else round(float(v), 2) for v in values]
    return values


Course = Annotated[tuple[Number | None, ...], BeforeValidator(_without_nan)]


class ActivityResult(Strict):
    """Log of how fast the readings of two recorders change, in bins by each one's own stamps."""

    width: Positive = key("s: of a bin")
    lag: Number = key("s: of the same move by this recorder's stamps behind the first's, each "
                      "counted from its own first stamp")  # fmt: skip
    start: Number = key("s: of the first bin, by the first recorder")
    first: Course = key("of the first recorder; null where it holds nothing")
    second_start: Number = key("s: of the first bin, by this recorder")
    second: Course = key("of this recorder; null where it holds nothing")


class ClockResult(Strict):
    """A recorder's clock against the first one's; the offset is its stamp of the instant of the
    first recorder's first stamp, less that, and grows by the rate.
    """

    recorder: Text = key("its files, as the rig file names them")
    offset: Number = key("s: its stamps minus the first's, at the first's first stamp")
    offset_std: NotNegative = key("s: standard uncertainty")
    rate: Number = key("relative: growth of the offset")
    rate_std: NotNegative = key("relative: standard uncertainty")
    activity: ActivityResult | None = key("how fast both changed, for the page's figure", None)


class HistoryEntry(Strict):
    """A calibration that this one stands on, by the hash of its file; the oldest first."""

    created: Instant = key("UTC: when it was computed")
    measured: MeasuredResult | None = key("when its data were recorded", None)
    method: Method = key("self, tracker or joint")
    sha256: Sha256 = key("of the calibration's file")


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
    force_std: Vectors | None = key("N: standard uncertainty of force_after", None)
    moment_std: Vectors | None = key("N·m: of moment_after", None)


class DwellTable(Strict):
    """All dwells, column by column, and their mean readings, as tdfscal's sign has them."""

    start: Numbers = key("s: begin of each dwell, as the log counts")
    end: Numbers = key("s: end of each dwell")
    force: tuple[Vectors, ...] = key("N: per support the mean reading of each dwell, sensor frame")
    temperature: Numbers | None = key("°C: mean of all sensors in each dwell", None)
    noise: Vectors | None = key("N: per support, a mean's typical standard error by noise", None)


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


Lengths = Annotated[tuple[Number, ...], BeforeValidator(from_numpy), Field(min_length=1)]


class MotionResidual(Strict):
    """Lengths of the residual wrench over time, in means of a second or more."""

    time: Lengths = key("s in the log's time: middles of the means")
    force_before: Lengths = key("N: with the nominal mounting and the stated zeros")
    force_after: Lengths = key("N: calibrated")
    moment_before: Lengths = key("N·m: about the barycentre, with the nominal mounting")
    moment_after: Lengths = key("N·m: calibrated")


class MotionResult(Strict):
    """Samples in motion: from when, how long, what was left out, and what they tell besides."""

    begin: Number = key("s in the log's time: first sample")
    seconds: Positive = key("s: length of what went in")
    dwells: Count = key("number of static postures that went in too", 0)
    rejected: tuple[LeftOutStretch, ...] = key("stretches of the log that were left out", ())
    delay: MotionValue = key("s: force stamps minus position stamps, in the middle of the log")
    rate: MotionValue | None = key("growth of that delay, where the log says it", None)
    inertia: InertiaValue = key("kg m²: of the terminal, about the LCS origin")
    friction: MotionValue = key("N·m: Coulomb friction of each hinge")
    halves_p_value: Probability = key("that the log's two halves differ by chance as they do")
    spectrum: MotionSpectrum = key("of the residual: square roots of two-sided densities")
    residual: MotionResidual | None = key("of the wrench, over time", None)
    readings: ReadingsTable | None = key("by which the recording is known again", None)


def instant(time: float) -> str:
    """Write seconds since 1970 as an instant, to the second."""
    return datetime.fromtimestamp(round(time), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def seconds(text: str) -> float:
    """Read an instant as seconds since 1970."""
    return datetime.fromisoformat(text).timestamp()
