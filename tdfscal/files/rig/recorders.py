"""The `log` and `tracker` blocks of the rig file: every unit that a log may state, how each
recorder names things and what all must hold; a laser tracker's survey and where its files are.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    SerializerFunctionWrapHandler,
    WithJsonSchema,
    WrapSerializer,
    model_validator,
)

from tdfscal.files import field_types as kind
from tdfscal.files.field_types import Quantity, Strict, block, fault, key, unknown_key
from tdfscal.records import CLOCK_RATE_STD, ClockPrior, Instrument, Rows

Dimension = Literal["position", "force", "time"]

UNITS: Final[dict[Dimension, dict[str, float]]] = {
    "position": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "force": {"N": 1.0, "kN": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Units that can be declared, and their factors to SI."""
_SPELLINGS: Final = {"µm": "um", "μm": "um", "µs": "us", "μs": "us", "sec": "s"}
FOREIGN: Final[dict[Dimension, dict[str, float]]] = {
    "position": {"cm": 1e-2, "dm": 1e-1, "km": 1e3, "ft": 0.3048, "mil": 2.54e-5}
    | dict.fromkeys(("in", "inch"), 0.0254),
    "force": {"mN": 1e-3, "dN": 0.1, "daN": 10.0, "MN": 1e6, "gf": 9.80665e-3}
    | dict.fromkeys(("kp", "kgf", "kg"), 9.80665)
    | dict.fromkeys(("lbf", "lb"), 4.4482216152605),
}
"""Units that recorders write and that are none of ours, by the scale of the rig file for each."""
# Naming one is a disagreement too, and not a name.
_OTHERS: Final = frozenset(
    ("V", "mV", "mV/V", "A", "deg", "rad", "g", "h", "min", "counts", "raw", "%")
)


def canonical(unit: str) -> str:
    """Return the one spelling of a unit: µm and um are the same."""
    return _SPELLINGS.get(unit.strip(), unit.strip())


def unit_factor(quantity: Dimension, unit: str) -> float | None:
    """Return the factor to SI of a unit however it is spelt; None where it is none of `UNITS`."""
    return UNITS[quantity].get(canonical(unit))


def is_unit(text: str) -> bool:
    """Tell whether a text is a unit of measurement, ours or another."""
    unit = canonical(text)
    tables = (_OTHERS, *UNITS.values(), *FOREIGN.values())
    return any(unit in table for table in tables)


def by_scale(quantity: Dimension, unit: str) -> str | None:
    """Return how a rig file states a unit that it does not know by name; None of one unknown."""
    factor = FOREIGN.get(quantity, {}).get(unit.strip())
    if factor is None:
        return None
    line = f"{quantity}_scale: {factor:.14g}"
    return f"write `{line}` beside the {quantity} fields of each support in the log block"


#: In place of a field that no recorder has, of an axis that is not measured.
_NOT_RECORDED = "none"
_FIELD = {"type": ["string", "integer"], "minLength": 1}
FieldName = Annotated[kind.Text, BeforeValidator(kind.whole_as_text), WithJsonSchema(_FIELD)]
"""A field of a log: its name or, of a table without a header, the number of its column from 1."""


class LogTime(Strict):
    """The log's clock: field and unit in CSV and Parquet, source in MCAP."""

    field: FieldName = key("column; CSV and Parquet", "time")
    unit: Literal["s", "ms", "us", "ns"] = key("or ms, us, ns; CSV and Parquet", "s")
    source: Literal["header", "log", "publish"] = key("or header, publish; MCAP", "log")


def _list(given: Any) -> Any:
    return given if isinstance(given, (list, tuple)) else (given,)


def _alone(several: Any, written: SerializerFunctionWrapHandler) -> Any:
    each = written(several)
    return each[0] if len(each) == 1 else each


Fields = Annotated[
    tuple[FieldName, ...],
    BeforeValidator(_list),
    WrapSerializer(_alone),
    WithJsonSchema({"anyOf": [_FIELD, kind.list_of(_FIELD, 1, 3)]}),
]
"""A field per axis that is measured, or one field with members x, y, z."""


def _not_zero(scale: kind.Vector) -> kind.Vector:
    if not all(scale):
        raise fault("a scale of zero", hint="write N or m per unit of the log")
    return scale


Scale = Annotated[
    kind.Vector,
    BeforeValidator(kind.one_for_all),
    AfterValidator(_not_zero),
    WithJsonSchema({"anyOf": [{"type": "number"}, kind.list_of({"type": "number"}, 3, 3)]}),
]
"""One factor for x, y, z, or three; its sign turns the reading's."""


class SupportFields(Strict):
    """Where a support's servo position and force reading are in the log.

    The scales are m and N per unit of the log, in place of `length_unit` and `force_unit`: of raw
    counts, of mV.
    """

    position: Fields | None = key("three fields, or one with x, y, z", None)
    force: Fields | None = key("likewise, or one per measured axis; both are needed", None)
    position_scale: Scale | None = key(
        "m: per unit of the log, in place of length_unit; one number or three", None
    )
    force_scale: Scale | None = key(
        "N: per unit of the log, in place of force_unit: raw counts, mV", None
    )


Temperatures = Annotated[
    tuple[FieldName, ...],
    BeforeValidator(_list),
    WithJsonSchema({"anyOf": [_FIELD, kind.list_of(_FIELD, 1)]}),
]
"""One field in °C for all sensors, or one per support, in their order."""


class ClockBlock(Strict):
    """A recorder's clock against the first one's: its stamps minus the first's."""

    offset: Annotated[Quantity, kind.WithStd] = block(
        "s: quantity; std: unknown finds it", Quantity, value=0.0, std=math.inf
    )
    rate_std: kind.Amount = key("relative: standard uncertainty of its rate", CLOCK_RATE_STD)

    def record(self) -> ClockPrior:
        """Return it as a record."""
        return ClockPrior(self.offset.record(), self.rate_std)


@BeforeValidator
def _by_name(unit: Any) -> Any:
    """Refuse a unit that has no name here, with the scale to write instead."""
    line = isinstance(unit, str) and (by_scale("force", unit) or by_scale("position", unit))
    if line:
        raise fault(f"{unit} has no name here", hint=f"{line} in its place")
    return unit


class LogBlock(Strict):
    """How a recorder of this rig names things, and in which units."""

    files: kind.Text | None = key("pattern of the names of its files, such as cnc*.csv", None)
    rows: Rows = key("or postures: each row is one averaged posture", "timeseries")
    time: LogTime = block("the clock: a column, or which stamps of messages", LogTime)
    delay: Annotated[Quantity, kind.WithStd] | None = key(
        "s: quantity, force stamps minus position stamps; used in motion only", None
    )
    temperature: Temperatures | None = key("°C: field, or one per support", None)
    length_unit: Annotated[Literal["m", "mm", "um"], _by_name] = key("or mm, um", "m")
    force_unit: Annotated[Literal["N", "kN"], _by_name] = key("or kN", "N")
    force_on: Literal["terminal", "sensor"] = key(
        "or sensor: the reading is the reaction, and its sign is turned", "terminal"
    )
    decimal: Literal[".", ","] = key("or ,; CSV", ".")
    supports: dict[kind.Name, SupportFields] | None = key("one entry per support", None)
    clock: ClockBlock = block("against the first recorder's", ClockBlock)

    def support_fields(self, support: str) -> SupportFields:
        """Fields of a support, none where another recorder holds them.

        A block that names none is of a log with `<name>.x .y .z .fx .fy .fz`.
        """
        if self.supports is not None:
            return self.supports.get(support, SupportFields.model_construct())
        x, f = (tuple(f"{support}.{what}{axis}" for axis in "xyz") for what in ("", "f"))
        return SupportFields.model_construct(position=x, force=f)

    def scale(
        self, quantity: Literal["position", "force"], support: str
    ) -> tuple[tuple[float, ...], str | None]:
        """M or N per unit of the log along x, y, z, and the unit where none is stated beside it."""
        own = self.support_fields(support)
        unit: str = self.length_unit if quantity == "position" else self.force_unit
        stated = own.position_scale if quantity == "position" else own.force_scale
        return stated or (UNITS[quantity][canonical(unit)],) * 3, None if stated else unit

    @property
    def fields(self) -> dict[tuple[str, str], tuple[str, ...]]:
        """By support and quantity, `position` or `force`: the fields that are named."""
        return {
            (name, what): named
            for name, fields in (self.supports or {}).items()
            for what in ("position", "force")
            if (named := getattr(fields, what)) is not None
        }


LogBlocks = Annotated[
    tuple[LogBlock, ...],
    BeforeValidator(_list, json_schema_input_type=LogBlock | tuple[LogBlock, ...]),
    WrapSerializer(_alone),
]
"""One recorder's block, or a list of them."""


def check_recorders(measured: Mapping[str, Sequence[str]], recorders: Sequence[LogBlock]) -> None:
    """Refuse blocks that do not hold each support's position and force once, all together.

    measured : support's name → the axes of its sensor; of none, no force is asked for, and in the
        order x, y, z a field for each is enough.
    """
    names = tuple(measured)
    held: dict[tuple[str, str], int] = {}
    for index, recorder in enumerate(recorders):
        place = ("log", index)
        _check_block(names, recorder, place, several=len(recorders) > 1)
        for what, fields in recorder.fields.items():
            own = list(measured[what[0]]) if what[1] == "force" else []
            if len(fields) not in (1, 3) and (len(fields) != len(own) or own != sorted(own)):
                said = f"must be three fields or one with members x, y, z, got {len(fields)}"
                hint = f"write [X, Y, Z] or one name; {_NOT_RECORDED} for an axis not measured"
                raise fault(said, *place, "supports", *what, hint=hint)
            if what in held:
                raise fault(
                    f"the {what[1]} of {what[0]} is recorder {held[what] + 1}'s already",
                    *(*place, "supports", *what),
                    hint="let one recorder give each quantity",
                )
            held[what] = index
    if not any(recorder.supports is not None for recorder in recorders):
        return
    for name in names:
        needed = ("position", "force") if measured[name] else ("position",)
        missing = [what for what in needed if (name, what) not in held]
        if len(missing) == 2:
            raise fault(f"lacks the support `{name}`", "log", "supports", hint=f"add `{name}: ...`")
        if missing:
            where = ("log", 0, "supports", name) if len(recorders) == 1 else ("log",)
            said, hint = f"lacks the {missing[0]} of `{name}`", f"add `{missing[0]}: ...`"
            raise fault(said, *where, hint=hint)


def _check_block(
    names: Sequence[str], recorder: LogBlock, place: tuple[str | int, ...], *, several: bool
) -> None:
    """Refuse a block that names other supports than the rig's, or a field twice."""
    if several and (recorder.files is None or recorder.supports is None):
        lacking = "files" if recorder.files is None else "supports"
        raise fault(f"lacks `{lacking}`", *place, hint=f"add `{lacking}: ...` for each recorder")
    if several and recorder.rows == "postures":
        raise fault(
            "averaged postures of several recorders have no time to bring them together",
            *(*place, "rows"),
            hint="give the recordings themselves",
        )
    for name in recorder.supports or ():
        if name not in names:
            raise unknown_key(name, names, *place, "supports")
    warm, taken = recorder.temperature, dict[str, str]()
    served = {(*place, "supports", *what): used for what, used in recorder.fields.items()}
    served[*place, "temperature"] = tuple(dict.fromkeys(warm or ()))
    for where, used in served.items():
        for field in used:
            if field in taken and field != _NOT_RECORDED:
                what = f"the field `{field}` already serves {taken[field]}"
                raise fault(what, *where, hint="let each field serve one quantity")
            taken[field] = ".".join(part for part in where if isinstance(part, str))
    if warm is not None and len(warm) not in (1, len(names)):
        raise fault(
            f"names {len(warm)} fields for {len(names)} supports",
            *(*place, "temperature"),
            hint="name one field for all, or one per support",
        )


class InstrumentBlock(Strict):
    """Standard uncertainties of a spherical instrument: m, ppm of the range, arcseconds."""

    range: kind.Amount = key("m: constant part of the range")
    range_ppm: kind.Amount = key("ppm: part that grows with the range")
    angle_arcsec: kind.Amount = key("″: each angle")

    @model_validator(mode="after")
    def _not_perfect(self) -> Self:
        if self.range == self.range_ppm == self.angle_arcsec == 0:
            raise fault("an instrument without any uncertainty", hint="see its data sheet")
        return self

    def record(self) -> Instrument:
        """Return it as a record."""
        return Instrument(**dict(self))


class Targets(Strict):
    """Point files of the targets on the sensors: TDFS frames, and the tracker's frame."""

    nominal: kind.Text = key("point file, sensor frames")
    measured: kind.Text = key("point file, tracker frame")


class Moves(Strict):
    """Point files of the NCPs' moves: by the servo in the BCS, and in the tracker's frame."""

    servo: kind.Text = key("point file, hinge centres in the BCS")
    measured: kind.Text = key("point file, tracker frame")


class TrackerBlock(Strict):
    """A laser-tracker survey; drawing in m, misalignment of body against sensing axes in rad."""

    instrument: InstrumentBlock = key("standard uncertainties, k = 1")
    drawing: kind.Amount = key("m: nominal points, per coordinate", 0.0)
    misalignment: kind.Amount = key("rad: sensing axes against the sensor's body, per axis", 0.0)
    length_unit: kind.LengthUnit | None = key(
        "of point files that name none: m, cm, mm, um, in", None
    )
    targets: Targets = key("targets on the sensors")
    moves: Moves = key("one point on each NCP, moved")

    @property
    def files(self) -> tuple[str, str, str, str]:
        """The four point files: targets nominal and measured, moves by servo and measured."""
        targets, moves = self.targets, self.moves
        return targets.nominal, targets.measured, moves.servo, moves.measured
