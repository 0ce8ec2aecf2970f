"""The rig file `tdfscal-rig/1` as models: every key, unit, default and bound."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from tdfscal.files.field_types import (
    UNKNOWN,
    Date,
    Label,
    Matrix3,
    Name,
    NotNegative,
    Number,
    Positive,
    PositiveVector,
    Std,
    Stds,
    Strict,
    Text,
    Vector,
    fault,
    from_numpy,
    key,
    list_of,
    one_for_all,
    whole_as_text,
)
from tdfscal.files.rig.checks import (
    check_hinges,
    check_inertia,
    check_names,
    check_recorders,
)
from tdfscal.records import Rows

RIG_FORMAT = "tdfscal-rig/1"

LengthUnit = Literal["m", "mm", "um"]
PointUnit = Literal["m", "cm", "mm", "um", "in"]
ForceUnit = Literal["N", "kN"]
TimeUnit = Literal["s", "ms", "us", "ns"]
Axis = Literal["x", "y", "z"]
TimeSource = Literal["header", "log", "publish"]

_FARTHEST = 100.0
"""m; no terminal reaches farther, and 600 is a millimetre figure."""


def _with_std(given: Any, info: ValidationInfo) -> Any:
    """Refuse a bare value: a quantity without its uncertainty is no measurement."""
    if isinstance(given, (dict, Strict)):
        return given
    value = from_numpy(given)
    raise fault(
        f"states no standard uncertainty, got {value!r:.60}",
        hint=f"write `{info.field_name}: {{value: {value!r:.60}, std: ...}}`; "
        "std: 0 says exact, std: unknown says unknown",
    )


WithStd = BeforeValidator(_with_std)


class Quantity(Strict):
    """A scalar with its standard uncertainty."""

    value: Number = key("the value")
    std: Std = key("its standard uncertainty; 0 exact, .inf unknown")


class Mass(Quantity):
    """Mass of the terminal with all it carries, kg."""

    value: Positive = key("kg")
    std: Std = key("kg: standard uncertainty; 0 exact, .inf unknown")


def _near(given: tuple[float, float, float]) -> tuple[float, float, float]:
    farthest = max(map(abs, given))
    if farthest > _FARTHEST:
        raise fault(
            f"lies {farthest:g} m from the LCS, too far for a terminal", hint="write it in m"
        )
    return given


PlaceOnTerminal = Annotated[Vector, AfterValidator(_near)]


class VectorQuantity(Strict):
    """A vector with its standard uncertainties; a single one stands for all three."""

    value: Vector = key("the three components")
    std: Stds = key("standard uncertainty of each; 0 exact, .inf unknown")


class Barycenter(VectorQuantity):
    """Barycentre of the terminal with all it carries, m, LCS."""

    value: PlaceOnTerminal = key("m, LCS")
    std: Stds = key("m: standard uncertainty of each coordinate; 0 exact, .inf unknown")


class Gravity(Strict):
    """Gravity along −Z of the BCS: magnitude in m/s², tilt_std in rad per horizontal axis."""

    magnitude: Positive = key("m/s²: along −Z of the BCS", 9.80665)
    tilt_std: NotNegative = key("rad: levelness of the BCS, per horizontal axis", 0.0)


class Inertia(Strict):
    """Inertia of the terminal about the LCS origin, kg m²; std is that of each entry."""

    value: Matrix3 = key("kg m², about the LCS origin")
    std: Std = key("kg m²: standard uncertainty of every entry")

    @field_validator("value")
    @classmethod
    def _of_a_body(cls, given: Any) -> Any:
        check_inertia(np.array(given))
        return given


class Terminal(Strict):
    """The terminal with all it carries: mass in kg, barycentre in m in the LCS, inertia."""

    mass: Annotated[Mass, WithStd] = key("kg: quantity")
    barycenter: Annotated[Barycenter, WithStd] = key("m: quantity, LCS")
    inertia: Annotated[Inertia, WithStd] | None = key(
        "kg m²: quantity, 3 × 3 about the LCS origin; used in motion only", None
    )


class Campaign(Strict):
    """When, where and by whom the log was recorded; date in ISO 8601, as a day or a time."""

    date: Date | None = key("ISO 8601; where the log has no wall clock", None)
    operator: Text | None = key("who ran the campaign", None)
    site: Text | None = key("where it was run", None)
    note: Text | None = key("anything else to keep with it", None)


class Sensor(Strict):
    """A sensor's papers, carried to report and certificate; due: day of its next calibration."""

    serial: Label | None = key("serial number of the sensor", None)
    certificate: Label | None = key("number of its certificate", None)
    due: Date | None = key("day of its next calibration, ISO 8601", None)


def _angles(given: Any) -> Any:
    if isinstance(given, (list, tuple)) and any(
        isinstance(angle, (int, float)) and 2 * math.pi < abs(angle) < math.inf for angle in given
    ):
        raise fault("an angle beyond 2π: roll, pitch and yaw are in rad", hint="convert degrees")
    return given


Angles = Annotated[Vector, BeforeValidator(_angles)]


class Support(Strict):
    """One NCP with its TDFS: hinge in m in the LCS, zero and capacity in N, angles in rad."""

    name: Name = key("letters, digits, _ and -")
    hinge: PlaceOnTerminal = key("m: SHC in the LCS")
    zero: Annotated[VectorQuantity, WithStd] = key(
        "N: quantity, reading without load, sensor frame",
        VectorQuantity(value=(0.0, 0.0, 0.0), std=(math.inf,) * 3),
    )
    nominal_rpy: Angles = key("rad: nominal mounting", (0.0, 0.0, 0.0))
    rpy_std: Stds = key(
        "rad: prior about the nominal mounting",
        (math.inf,) * 3,
        json_schema_extra={"default": UNKNOWN},
    )
    capacity: PositiveVector | None = key("N: full scale; a reading beyond it is saturated", None)
    axes: tuple[Axis, ...] = key(
        "what the sensor measures; [z] is a load cell, [] no sensor", ("x", "y", "z")
    )
    sensor: Sensor | None = key("the sensor's papers, carried to report and certificate", None)

    @field_validator("axes")
    @classmethod
    def _each_once(cls, given: tuple[Axis, ...]) -> tuple[Axis, ...]:
        if len(set(given)) < len(given):
            raise fault("names an axis twice", hint="list each measured axis once, as in [x, z]")
        return given

    @field_validator("rpy_std")
    @classmethod
    def _open(cls, given: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(given) <= 0:
            raise fault(
                "must be above 0: an angle known exactly leaves nothing to calibrate",
                hint="write how well the mounting is known, or leave it out",
            )
        return given


class Compliance(Strict):
    """What gives between encoder and hinge, m/N, as a standard uncertainty about none."""

    lateral: NotNegative = key("m/N: sideways", 0.0)
    vertical: NotNegative = key("m/N: along Z of the BCS", 0.0)


class Uncertainty(Strict):
    """Standard uncertainties that the log's own scatter cannot show."""

    positioner: NotNegative = key("m: repeatability of an NCP, per axis and posture", 0.0)
    hinge: NotNegative = key("m: each coordinate of each hinge", 0.0)
    datum: NotNegative = key("m: constant offset of an NCP's servo coordinates, per axis", 0.0)
    force_noise: NotNegative = key(
        "N: per axis and posture, beyond the standard error of the mean", 0.0
    )
    force_sensitivity: NotNegative = key("relative gain and crosstalk of a sensor", 0.0)
    hinge_moment: NotNegative = key("N·m: friction of the hinges, per axis and posture", 0.0)
    compliance: Compliance = key("what gives between encoder and hinge", Compliance())


class Drift(Strict):
    """Zeros that move within a campaign, per channel, and angles that do between campaigns."""

    time: Std = key("N/h: standard uncertainty of a slope in time", 0.0)
    temperature: Std = key("N/K: standard uncertainty of a slope against log.temperature", 0.0)
    walk: NotNegative = key("N/√h: intensity of a random walk", 0.0)
    angle: NotNegative = key("rad/√month: random walk of the angles between campaigns", 0.0)


_FIELD = {"type": ["string", "integer"], "minLength": 1}
FieldName = Annotated[Text, BeforeValidator(whole_as_text), WithJsonSchema(_FIELD)]
"""A field of a log: its name or, of a table without a header, the number of its column from 1."""


class LogTime(Strict):
    """The log's clock: field and unit in CSV and Parquet, source in MCAP."""

    field: FieldName = key("column; CSV and Parquet", "time")
    unit: TimeUnit = key("or ms, us, ns; CSV and Parquet", "s")
    source: TimeSource = key("or header, publish; MCAP", "log")


def _one_or_three(given: Any) -> Any:
    if isinstance(given, (list, tuple)):
        if len(given) not in (1, 3):
            raise fault(
                f"must be three fields or one with members x, y, z, got {len(given)}",
                hint="write [X, Y, Z] or one name",
            )
        return tuple(given)
    return (given,)


Fields = Annotated[
    tuple[FieldName, ...],
    BeforeValidator(_one_or_three),
    WithJsonSchema({"anyOf": [_FIELD, list_of(_FIELD, 3, 3), list_of(_FIELD, 1, 1)]}),
]
"""Three fields, or one field with members x, y, z."""


def _not_zero(scale: Vector) -> Vector:
    if not all(scale):
        raise fault("a scale of zero", hint="write N or m per unit of the log")
    return scale


Scale = Annotated[
    Vector,
    BeforeValidator(one_for_all),
    AfterValidator(_not_zero),
    WithJsonSchema({"anyOf": [{"type": "number"}, list_of({"type": "number"}, 3, 3)]}),
]
"""One factor for x, y, z, or three; its sign turns the reading's."""


class SupportFields(Strict):
    """Where a support's servo position and force reading are in the log.

    The scales are m and N per unit of the log, in place of `length_unit` and `force_unit`: of raw
    counts, of mV.
    """

    position: Fields | None = key("three fields, or one with x, y, z", None)
    force: Fields | None = key("likewise; each is needed, from one recorder or another", None)
    position_scale: Scale | None = key(
        "m: per unit of the log, in place of length_unit; one number or three", None
    )
    force_scale: Scale | None = key(
        "N: per unit of the log, in place of force_unit: raw counts, mV", None
    )


Temperatures = Annotated[
    tuple[FieldName, ...] | dict[Name, FieldName],
    BeforeValidator(lambda given: (given,) if isinstance(given, str | int) else given),
    WithJsonSchema(
        {
            "anyOf": [
                _FIELD,
                list_of(_FIELD, 1),
                {"type": "object", "additionalProperties": _FIELD},
            ]
        }
    ),
]
"""One field in °C for all sensors, or one per support: in their order, or by name."""


class ClockBlock(Strict):
    """A recorder's clock against the first one's: its stamps minus the first's."""

    offset: Annotated[Quantity, WithStd] = key(
        "s: quantity; std: unknown finds it", Quantity(value=0.0, std=math.inf)
    )
    rate_std: NotNegative = key("relative: standard uncertainty of its rate", 1.0e-4)


class LogBlock(Strict):
    """How a recorder of this rig names things, and in which units."""

    files: Text | None = key("pattern of the names of its files, such as cnc*.csv", None)
    rows: Rows = key("or postures: each row is one averaged posture", "timeseries")
    time: LogTime = key("the clock: a column, or which stamps of messages", LogTime())
    delay: Annotated[Quantity, WithStd] | None = key(
        "s: quantity, force stamps minus position stamps; used in motion only", None
    )
    temperature: Temperatures | None = key("°C: field, or one per support", None)
    length_unit: LengthUnit = key("or mm, um", "m")
    force_unit: ForceUnit = key("or kN", "N")
    force_on: Literal["terminal", "sensor"] = key(
        "or sensor: the reading is the reaction, and its sign is turned", "terminal"
    )
    decimal: Literal[".", ","] = key("or ,; CSV", ".")
    supports: dict[Name, SupportFields] | None = key("one entry per support", None)
    clock: ClockBlock = key("against the first recorder's", ClockBlock())

    @property
    def fields(self) -> dict[tuple[str, str], tuple[str, ...]]:
        """By support and quantity, `position` or `force`: the fields that are named."""
        named = {
            (name, what): getattr(fields, what)
            for name, fields in (self.supports or {}).items()
            for what in ("position", "force")
        }
        return {place: fields for place, fields in named.items() if fields is not None}


def _form(given: Any) -> str:
    return "several" if isinstance(given, (list, tuple)) else "one"


#: One recorder's block, or a list of them.
LogBlocks = Annotated[
    Annotated[LogBlock, Tag("one")] | Annotated[tuple[LogBlock, ...], Tag("several")],
    Discriminator(_form),
]


class InstrumentBlock(Strict):
    """Standard uncertainties of a spherical instrument: m, ppm of the range, arcseconds."""

    range: NotNegative = key("m: constant part of the range")
    range_ppm: NotNegative = key("ppm: part that grows with the range")
    angle_arcsec: NotNegative = key("″: each angle")

    @model_validator(mode="after")
    def _not_perfect(self) -> Self:
        if self.range == self.range_ppm == self.angle_arcsec == 0:
            raise fault("an instrument without any uncertainty", hint="see its data sheet")
        return self


class Targets(Strict):
    """Point files of the targets on the sensors: TDFS frames, and the tracker's frame."""

    nominal: Text = key("point file, sensor frames")
    measured: Text = key("point file, tracker frame")


class Moves(Strict):
    """Point files of the NCPs' moves: by the servo in the BCS, and in the tracker's frame."""

    servo: Text = key("point file, hinge centres in the BCS")
    measured: Text = key("point file, tracker frame")


class TrackerBlock(Strict):
    """A laser-tracker survey; drawing in m, misalignment of body against sensing axes in rad."""

    instrument: InstrumentBlock = key("standard uncertainties, k = 1")
    drawing: NotNegative = key("m: nominal points, per coordinate", 0.0)
    misalignment: NotNegative = key("rad: sensing axes against the sensor's body, per axis", 0.0)
    length_unit: PointUnit | None = key("of point files that name none: m, cm, mm, um, in", None)
    targets: Targets = key("targets on the sensors")
    moves: Moves = key("one point on each NCP, moved")


class Contact(Strict):
    """Limit of the contact wrench's error at a posture of the terminal: N, N·m, rad."""

    force: Positive | None = key("N: length of the force's error", None)
    torque: Positive | None = key("N·m: length of the torque's error", None)
    rpy: Angles = key("rad: that posture of the terminal", (0.0, 0.0, 0.0))

    @model_validator(mode="after")
    def _limits_something(self) -> Self:
        if self.force is None and self.torque is None:
            raise fault("limits neither force nor torque", hint="add `force`, `torque` or both")
        return self


class AcceptanceBlock(Strict):
    """Limits of the quality gate; angles in rad."""

    angle_std: Positive = key("rad: largest standard uncertainty of an angle", 5.0e-3)
    identifiable: Positive = key("rad: above it an angle counts as not determined (exit 4)", 0.05)
    birge_max: Positive = key("largest Birge ratio", 2.0)
    contact: Contact | None = key(
        "limit of the contact wrench's error at a posture, guard-banded", None
    )


def _three_or_more(given: Any) -> Any:
    if not isinstance(given, (list, tuple)) or len(given) < 3:
        got = len(given) if isinstance(given, (list, tuple)) else f"{given!r:.40}"
        raise fault(f"must be a list of three or more supports, got {got}", hint="list each NCP")
    return given


class RigFile(Strict):
    """What is known of the rig (`rig.yaml`), SI units."""

    format: Literal["tdfscal-rig/1"] = key("tdfscal-rig/1")
    name: Text = key("what the rig is called")
    serial: Label | None = key("of the rig", None)
    campaign: Campaign | None = key("when, where and by whom the log was recorded", None)
    gravity: Gravity = key("m/s² along −Z of the BCS, and how level that is", Gravity())
    terminal: Terminal = key("the terminal with all it carries")
    supports: Annotated[
        tuple[Support, ...],
        BeforeValidator(_three_or_more),
        Field(json_schema_extra={"minItems": 3}),
    ] = key("list of three or more, one NCP with its TDFS each")
    uncertainty: Uncertainty = key(
        "standard uncertainties that the log's own scatter cannot show", Uncertainty()
    )
    drift: Drift = key("zeros that move within a campaign, per channel", Drift())
    log: LogBlocks | None = key(
        "how the recorder names things; a list of such blocks where there are several", None
    )
    tracker: TrackerBlock | None = key("a survey; paths relative to this file", None)
    acceptance: AcceptanceBlock = key("limits of the quality gate", AcceptanceBlock())

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [support.name for support in self.supports]
        check_names(names)
        check_hinges(names, np.array([support.hinge for support in self.supports]))
        check_recorders(names, self.recorders, one=isinstance(self.log, LogBlock))
        if self.drift.temperature > 0 and all(r.temperature is None for r in self.recorders):
            raise fault(
                "zeros that follow a temperature need one",
                *("drift", "temperature"),
                hint="name the log's field with log.temperature",
            )
        return self

    @property
    def recorders(self) -> tuple[LogBlock, ...]:
        """The blocks of all recorders; none where the file has no log block."""
        if self.log is None:
            return ()
        return (self.log,) if isinstance(self.log, LogBlock) else self.log
