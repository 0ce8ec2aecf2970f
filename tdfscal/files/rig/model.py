"""The rig file `tdfscal-rig/1` as models: every key, unit, default and bound."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from tdfscal.files.field_types import (
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
)
from tdfscal.files.rig.checks import (
    check_hinges,
    check_inertia,
    check_mapping,
    check_names,
    check_temperature,
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

    value: Number
    std: Std


class Mass(Quantity):
    """Mass of the terminal with all it carries, kg."""

    value: Positive


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

    value: Vector
    std: Stds


class Barycenter(VectorQuantity):
    """Barycentre of the terminal with all it carries, m, LCS."""

    value: PlaceOnTerminal


class Gravity(Strict):
    """Gravity along −Z of the BCS: magnitude in m/s², tilt_std in rad per horizontal axis."""

    magnitude: Positive = 9.80665
    tilt_std: NotNegative = 0.0


class Inertia(Strict):
    """Inertia of the terminal about the LCS origin, kg m²; std is that of each entry."""

    value: Matrix3
    std: Std

    @field_validator("value")
    @classmethod
    def _of_a_body(cls, given: Any) -> Any:
        check_inertia(np.array(given))
        return given


class Terminal(Strict):
    """The terminal with all it carries: mass in kg, barycentre in m in the LCS, inertia."""

    mass: Annotated[Mass, WithStd]
    barycenter: Annotated[Barycenter, WithStd]
    inertia: Annotated[Inertia, WithStd] | None = None


class Campaign(Strict):
    """When, where and by whom the log was recorded; date in ISO 8601, as a day or a time."""

    date: Date | None = None
    operator: Text | None = None
    site: Text | None = None
    note: Text | None = None


class Sensor(Strict):
    """A sensor's papers, carried to report and certificate; due: day of its next calibration."""

    serial: Label | None = None
    certificate: Label | None = None
    due: Date | None = None


def _angles(given: Any) -> Any:
    if isinstance(given, (list, tuple)) and any(
        isinstance(angle, (int, float)) and 2 * math.pi < abs(angle) < math.inf for angle in given
    ):
        raise fault("an angle beyond 2π: roll, pitch and yaw are in rad", hint="convert degrees")
    return given


Angles = Annotated[Vector, BeforeValidator(_angles)]


class Support(Strict):
    """One NCP with its TDFS: hinge in m in the LCS, zero and capacity in N, angles in rad."""

    name: Name
    hinge: PlaceOnTerminal
    zero: Annotated[VectorQuantity, WithStd] = VectorQuantity(
        value=(0.0, 0.0, 0.0), std=(math.inf,) * 3
    )
    nominal_rpy: Angles = (0.0, 0.0, 0.0)
    rpy_std: Stds = (math.inf,) * 3
    capacity: PositiveVector | None = None
    axes: tuple[Axis, ...] = ("x", "y", "z")
    sensor: Sensor | None = None

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

    lateral: NotNegative = 0.0
    vertical: NotNegative = 0.0


class Uncertainty(Strict):
    """Standard uncertainties that the log's own scatter cannot show."""

    positioner: NotNegative = 0.0
    hinge: NotNegative = 0.0
    datum: NotNegative = 0.0
    force_noise: NotNegative = 0.0
    force_sensitivity: NotNegative = 0.0
    hinge_moment: NotNegative = 0.0
    compliance: Compliance = Compliance()


class Drift(Strict):
    """Zeros that move within a campaign, per channel, and angles that do between campaigns.

    time in N/h and temperature in N/K: standard uncertainties of a slope, `unknown` for any;
    walk in N/√h and angle in rad/√month: intensities of random walks.
    """

    time: Std = 0.0
    temperature: Std = 0.0
    walk: NotNegative = 0.0
    angle: NotNegative = 0.0


def _column(given: Any) -> Any:
    number = isinstance(given, int) and not isinstance(given, bool)
    return str(given) if number else given


_FIELD = {"type": ["string", "integer"], "minLength": 1}
FieldName = Annotated[Text, BeforeValidator(_column), WithJsonSchema(_FIELD)]
"""A field of a log: its name or, of a table without a header, the number of its column from 1."""


class LogTime(Strict):
    """The log's clock: field and unit in CSV and Parquet, source in MCAP."""

    field: FieldName = "time"
    unit: TimeUnit = "s"
    source: TimeSource = "log"


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
    WithJsonSchema(
        {
            "anyOf": [
                _FIELD,
                {"type": "array", "items": _FIELD, "minItems": 3, "maxItems": 3},
                {"type": "array", "items": _FIELD, "minItems": 1, "maxItems": 1},
            ]
        }
    ),
]
"""Three fields, or one field with members x, y, z."""


def _each(given: Any) -> Any:
    return (given,) * 3 if isinstance(given, int | float) else given


def _not_zero(scale: Vector) -> Vector:
    if not all(scale):
        raise fault("a scale of zero", hint="write N or m per unit of the log")
    return scale


Scale = Annotated[
    Vector,
    BeforeValidator(_each),
    AfterValidator(_not_zero),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "number"},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]
"""One factor for x, y, z, or three; its sign turns the reading's."""


class SupportFields(Strict):
    """Where a support's servo position and force reading are in the log.

    The scales are m and N per unit of the log, in place of `length_unit` and `force_unit`: of raw
    counts, of mV.
    """

    position: Fields
    force: Fields
    position_scale: Scale | None = None
    force_scale: Scale | None = None


def _temperatures(given: Any) -> Any:
    return (given,) if isinstance(given, str | int) else given


Temperatures = Annotated[
    tuple[FieldName, ...] | dict[Name, FieldName],
    BeforeValidator(_temperatures),
    WithJsonSchema(
        {
            "anyOf": [
                _FIELD,
                {"type": "array", "items": _FIELD, "minItems": 1},
                {"type": "object", "additionalProperties": _FIELD},
            ]
        }
    ),
]
"""One field in °C for all sensors, or one per support: in their order, or by name."""


class LogBlock(Strict):
    """How this rig's recorder names things, and in which units."""

    rows: Rows = "timeseries"
    time: LogTime = LogTime()
    delay: Annotated[Quantity, WithStd] | None = None
    temperature: Temperatures | None = None
    length_unit: LengthUnit = "m"
    force_unit: ForceUnit = "N"
    force_on: Literal["terminal", "sensor"] = "terminal"
    decimal: Literal[".", ","] = "."
    supports: dict[Name, SupportFields] | None = None


class InstrumentBlock(Strict):
    """Standard uncertainties of a spherical instrument: m, ppm of the range, arcseconds."""

    range: NotNegative
    range_ppm: NotNegative
    angle_arcsec: NotNegative

    @model_validator(mode="after")
    def _not_perfect(self) -> Self:
        if self.range == self.range_ppm == self.angle_arcsec == 0:
            raise fault("an instrument without any uncertainty", hint="see its data sheet")
        return self


class Targets(Strict):
    """Point files of the targets on the sensors: TDFS frames, and the tracker's frame."""

    nominal: Text
    measured: Text


class Moves(Strict):
    """Point files of the NCPs' moves: by the servo in the BCS, and in the tracker's frame."""

    servo: Text
    measured: Text


class TrackerBlock(Strict):
    """A laser-tracker survey; drawing in m, misalignment of body against sensing axes in rad."""

    instrument: InstrumentBlock
    drawing: NotNegative = 0.0
    misalignment: NotNegative = 0.0
    length_unit: PointUnit | None = None
    targets: Targets
    moves: Moves


class Contact(Strict):
    """Limit of the contact wrench's error at a posture of the terminal: N, N·m, rad."""

    force: Positive | None = None
    torque: Positive | None = None
    rpy: Angles = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _limits_something(self) -> Self:
        if self.force is None and self.torque is None:
            raise fault("limits neither force nor torque", hint="add `force`, `torque` or both")
        return self


class AcceptanceBlock(Strict):
    """Limits of the quality gate; angles in rad."""

    angle_std: Positive = 5.0e-3
    identifiable: Positive = 0.05
    birge_max: Positive = 2.0
    contact: Contact | None = None


def _three_or_more(given: Any) -> Any:
    if not isinstance(given, (list, tuple)) or len(given) < 3:
        got = len(given) if isinstance(given, (list, tuple)) else f"{given!r:.40}"
        raise fault(f"must be a list of three or more supports, got {got}", hint="list each NCP")
    return given


class RigFile(Strict):
    """What is known of the rig (`rig.yaml`), SI units."""

    format: Literal["tdfscal-rig/1"]
    name: Text
    serial: Label | None = None
    campaign: Campaign | None = None
    gravity: Gravity = Gravity()
    terminal: Terminal
    supports: Annotated[
        tuple[Support, ...],
        BeforeValidator(_three_or_more),
        Field(json_schema_extra={"minItems": 3}),
    ]
    uncertainty: Uncertainty = Uncertainty()
    drift: Drift = Drift()
    log: LogBlock | None = None
    tracker: TrackerBlock | None = None
    acceptance: AcceptanceBlock = AcceptanceBlock()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [support.name for support in self.supports]
        check_names(names)
        check_hinges(names, np.array([support.hinge for support in self.supports]))
        temperature = self.log.temperature if self.log else None
        if temperature is not None:
            check_temperature(names, temperature)
        elif self.drift.temperature > 0:
            raise fault(
                "zeros that follow a temperature need one",
                *("drift", "temperature"),
                hint="name the log's field with log.temperature",
            )
        if self.log is not None and self.log.supports is not None:
            check_mapping(
                names,
                {
                    (name, what): getattr(fields, what)
                    for name, fields in self.log.supports.items()
                    for what in ("position", "force")
                },
            )
        return self
