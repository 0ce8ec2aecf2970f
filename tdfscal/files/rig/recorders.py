"""The `log` block of the rig file: how each recorder names things, and what all must hold."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag, WithJsonSchema

from tdfscal.files.field_types import (
    Name,
    NotNegative,
    Quantity,
    Strict,
    Text,
    Vector,
    WithStd,
    block,
    fault,
    key,
    list_of,
    one_for_all,
    whole_as_text,
)
from tdfscal.files.model_errors import nearest
from tdfscal.files.units import by_scale
from tdfscal.records import CLOCK_RATE_STD, Rows

#: In place of a field that no recorder has, of an axis that is not measured.
_NOT_RECORDED = "none"
_FIELD = {"type": ["string", "integer"], "minLength": 1}
FieldName = Annotated[Text, BeforeValidator(whole_as_text), WithJsonSchema(_FIELD)]
"""A field of a log: its name or, of a table without a header, the number of its column from 1."""


class LogTime(Strict):
    """The log's clock: field and unit in CSV and Parquet, source in MCAP."""

    field: FieldName = key("column; CSV and Parquet", "time")
    unit: Literal["s", "ms", "us", "ns"] = key("or ms, us, ns; CSV and Parquet", "s")
    source: Literal["header", "log", "publish"] = key("or header, publish; MCAP", "log")


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
    tuple[FieldName, ...],
    BeforeValidator(lambda given: (given,) if isinstance(given, str | int) else given),
    WithJsonSchema({"anyOf": [_FIELD, list_of(_FIELD, 1)]}),
]
"""One field in °C for all sensors, or one per support, in their order."""


class ClockBlock(Strict):
    """A recorder's clock against the first one's: its stamps minus the first's."""

    offset: Annotated[Quantity, WithStd] = block(
        "s: quantity; std: unknown finds it", Quantity, value=0.0, std=math.inf
    )
    rate_std: NotNegative = key("relative: standard uncertainty of its rate", CLOCK_RATE_STD)


@BeforeValidator
def _by_name(unit: Any) -> Any:
    """Refuse a unit that has no name here, with the scale to write instead."""
    line = isinstance(unit, str) and (by_scale("force", unit) or by_scale("position", unit))
    if line:
        raise fault(f"{unit} has no name here", hint=f"{line} in its place")
    return unit


class LogBlock(Strict):
    """How a recorder of this rig names things, and in which units."""

    files: Text | None = key("pattern of the names of its files, such as cnc*.csv", None)
    rows: Rows = key("or postures: each row is one averaged posture", "timeseries")
    time: LogTime = block("the clock: a column, or which stamps of messages", LogTime)
    delay: Annotated[Quantity, WithStd] | None = key(
        "s: quantity, force stamps minus position stamps; used in motion only", None
    )
    temperature: Temperatures | None = key("°C: field, or one per support", None)
    length_unit: Annotated[Literal["m", "mm", "um"], _by_name] = key("or mm, um", "m")
    force_unit: Annotated[Literal["N", "kN"], _by_name] = key("or kN", "N")
    force_on: Literal["terminal", "sensor"] = key(
        "or sensor: the reading is the reaction, and its sign is turned", "terminal"
    )
    decimal: Literal[".", ","] = key("or ,; CSV", ".")
    supports: dict[Name, SupportFields] | None = key("one entry per support", None)
    clock: ClockBlock = block("against the first recorder's", ClockBlock)

    @property
    def fields(self) -> dict[tuple[str, str], tuple[str, ...]]:
        """By support and quantity, `position` or `force`: the fields that are named."""
        return {
            (name, what): named
            for name, fields in (self.supports or {}).items()
            for what in ("position", "force")
            if (named := getattr(fields, what)) is not None
        }


#: One recorder's block, or a list of them.
LogBlocks = Annotated[
    Annotated[LogBlock, Tag("one")] | Annotated[tuple[LogBlock, ...], Tag("several")],
    Discriminator(lambda given: "several" if isinstance(given, (list, tuple)) else "one"),
]


def check_recorders(names: Sequence[str], log: LogBlock | Sequence[LogBlock]) -> None:
    """Refuse blocks that do not hold each support's position and force once, all together."""
    one = isinstance(log, LogBlock)
    recorders = [log] if isinstance(log, LogBlock) else log
    held: dict[tuple[str, str], int] = {}
    for index, recorder in enumerate(recorders):
        place = ("log",) if one else ("log", index)
        _check_block(names, recorder, place, several=len(recorders) > 1)
        for what in recorder.fields:
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
        missing = [what for what in ("position", "force") if (name, what) not in held]
        if len(missing) == 2:
            raise fault(f"lacks the support `{name}`", "log", "supports", hint=f"add `{name}: ...`")
        if missing:
            where = ("log", "supports", name) if one else ("log",)
            raise fault(
                f"lacks the {missing[0]} of `{name}`", *where, hint=f"add `{missing[0]}: ...`"
            )


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
    _check_known(names, list(recorder.supports or ()), *place, "supports")
    taken: dict[str, str] = {}
    for (name, what), used in recorder.fields.items():
        for field in used:
            if field in taken and field != _NOT_RECORDED:
                raise fault(
                    f"the field `{field}` already serves {taken[field]}",
                    *(*place, "supports", name, what),
                    hint="let each field serve one quantity",
                )
            taken[field] = f"log.supports.{name}.{what}"
    warm = recorder.temperature
    if warm is not None and len(warm) not in (1, len(names)):
        raise fault(
            f"names {len(warm)} fields for {len(names)} supports",
            *(*place, "temperature"),
            hint="name one field for all, or one per support",
        )


def _check_known(names: Sequence[str], given: Sequence[str], *place: str | int) -> None:
    """Refuse a support that is none of the rig's, with the one that is meant perhaps."""
    for name in given:
        if name not in names:
            unused = [other for other in names if other not in given]
            near = nearest(name, unused or list(names), cutoff=0.0)
            hint = f"write `{near}` perhaps"
            raise fault(f"`{name}` is no support of this rig", *place, name, hint=hint)
