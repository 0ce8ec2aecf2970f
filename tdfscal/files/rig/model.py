"""The rig file `tdfscal-rig/1` as models: every key, unit, default and bound."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from tdfscal.files.field_types import (
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
)
from tdfscal.files.rig.checks import check_hinges, check_inertia, check_mapping, check_names
from tdfscal.records import Rows

RIG_FORMAT = "tdfscal-rig/1"

LengthUnit = Literal["m", "mm", "um"]
PointUnit = Literal["m", "cm", "mm", "um", "in"]
ForceUnit = Literal["N", "kN"]
TimeUnit = Literal["s", "ms", "us", "ns"]
TimeSource = Literal["header", "log", "publish"]

_FARTHEST = 100.0
"""m; no terminal reaches farther, and 600 is a millimetre figure."""


class _Known(Strict):
    """A value with its standard uncertainty; a bare value is known exactly."""

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, given: Any) -> Any:
        return given if isinstance(given, (dict, _Known)) else {"value": given, "std": 0.0}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        full = handler.resolve_ref_schema(handler(core))
        return {"anyOf": [full["properties"]["value"], full]}


class Quantity(_Known):
    """A scalar with its standard uncertainty; a bare number is known exactly."""

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


class VectorQuantity(_Known):
    """A vector with its standard uncertainties; a bare list is known exactly."""

    value: Vector
    std: Stds


class Barycenter(VectorQuantity):
    """Barycentre of the terminal with all it carries, m, LCS."""

    value: PlaceOnTerminal


class Gravity(Strict):
    """Gravity along −Z of the BCS: magnitude in m/s², tilt_std in rad per horizontal axis."""

    magnitude: Positive = 9.80665
    tilt_std: NotNegative = 0.0


class Terminal(Strict):
    """The terminal: mass in kg, barycentre in m in the LCS, inertia in kg m² about its origin."""

    mass: Mass
    barycenter: Barycenter
    inertia: Matrix3 | None = None

    @field_validator("inertia")
    @classmethod
    def _of_a_body(cls, given: Any) -> Any:
        if given is not None:
            check_inertia(np.array(given))
        return given


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
    zero: VectorQuantity = VectorQuantity(value=(0.0, 0.0, 0.0), std=(math.inf,) * 3)
    nominal_rpy: Angles = (0.0, 0.0, 0.0)
    rpy_std: Stds = (math.inf,) * 3
    capacity: PositiveVector | None = None

    @field_validator("rpy_std")
    @classmethod
    def _open(cls, given: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(given) <= 0:
            raise fault(
                "must be above 0: an angle known exactly leaves nothing to calibrate",
                hint="write how well the mounting is known, or leave it out",
            )
        return given


class Uncertainty(Strict):
    """Standard uncertainties that the log's own scatter cannot show."""

    positioner: NotNegative = 0.0
    hinge: NotNegative = 0.0
    datum: NotNegative = 0.0
    force_noise: NotNegative = 0.0
    force_sensitivity: NotNegative = 0.0
    hinge_moment: NotNegative = 0.0


class LogTime(Strict):
    """The log's clock: field and unit in CSV and Parquet, source in MCAP."""

    field: Text = "time"
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


_FIELD = {"type": "string", "minLength": 1}
Fields = Annotated[
    tuple[Text, ...],
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


class SupportFields(Strict):
    """Where a support's servo position and force reading are in the log."""

    position: Fields
    force: Fields


class LogBlock(Strict):
    """How this rig's recorder names things, and in which units."""

    rows: Rows = "timeseries"
    time: LogTime = LogTime()
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
    gravity: Gravity = Gravity()
    terminal: Terminal
    supports: Annotated[
        tuple[Support, ...],
        BeforeValidator(_three_or_more),
        Field(json_schema_extra={"minItems": 3}),
    ]
    uncertainty: Uncertainty = Uncertainty()
    log: LogBlock | None = None
    tracker: TrackerBlock | None = None
    acceptance: AcceptanceBlock = AcceptanceBlock()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [support.name for support in self.supports]
        check_names(names)
        check_hinges(names, np.array([support.hinge for support in self.supports]))
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
