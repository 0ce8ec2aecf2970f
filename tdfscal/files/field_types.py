"""The kinds of value that the file models are made of: finite numbers, vectors, names, text.

Numbers are strict (no bool, NaN, ∞ or text); numpy arrays are taken as lists.
"""

from __future__ import annotations

import math
from datetime import datetime
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    StringConstraints,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, PydanticCustomError

from tdfscal.records import BoolArray, FloatArray

UNKNOWN = "unknown"
"""How a file writes an infinite standard uncertainty, since JSON has no infinity."""


LARGEST = 1e60
"""Of all numbers in a file."""
LengthUnit = Literal["m", "cm", "mm", "um", "in"]
"""Of point files."""


class Strict(BaseModel):
    """A part of a file: frozen, and no key that is not declared."""

    # A part is checked within its file, so that only the files' own validators need building.
    # Records of the same field names are taken as they are, in place of a mapping.
    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        protected_namespaces=(),
        defer_build=True,
        from_attributes=True,
    )


class Once:
    """Annotation by which pydantic builds the schema of a kind of value once, not at every use."""

    def __init__(self) -> None:
        self._schema: CoreSchema | None = None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        if self._schema is None:
            self._schema = handler(source)
        return self._schema


def key(description: str, default: Any = ..., **more: Any) -> Any:
    """Return a key of a file: what it says, for the published schema, and its default."""
    return Field(default, description=description, **more)


def block(description: str, model: type[Strict], **stated: Any) -> Any:
    """Return a key that holds a block, by default one that says no more than this."""
    # Unchecked: importing the models builds none of them.
    return key(description, model.model_construct(**stated))


def fault(message: str, *place: str | int, hint: str | None = None) -> PydanticCustomError:
    """Return an error that a validator raises: what is wrong, at which place below it, what to do.

    The message is shown as it stands, so it carries no braces.
    """
    context: dict[str, Any] = {"place": place, "hint": hint}
    return PydanticCustomError("tdfscal", "{said}", {"said": message, **context})


def _as_number(given: Any) -> Any:
    """Return a number; refused is what overflows when it is squared, and is no quantity at all."""
    value = from_numpy(given)
    if isinstance(value, (int, float)) and LARGEST < abs(value) < math.inf:
        raise fault(f"is beyond any quantity, got {value!r:.20}", hint="check the number")
    return value


def from_numpy(value: Any) -> Any:
    """Return numpy arrays and scalars as lists and numbers, all else as it is."""
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def none_where_open(value: Any) -> Any:
    """Return the ∞ of a record's arrays as None; ∞ in a file stays what it is, an error."""
    if isinstance(value, (np.ndarray, np.generic)):
        return np.where(value == np.inf, None, value).tolist()  # type: ignore[call-overload]
    return value


def measured_only(values: FloatArray, axes: BoolArray) -> FloatArray:
    """Return values (n, 3) for a file: ∞, which becomes null, for an axis that is not measured."""
    return np.where(axes, values, np.inf)


def _std(given: Any) -> Any:
    # `.inf` is text in JSON, which has no infinity.
    value = math.inf if given in (UNKNOWN, ".inf") else _as_number(given)
    if isinstance(value, str):
        what = f"must be a number or `{UNKNOWN}`, got {value!r:.40}"
        raise fault(what, hint="correct the value")
    if isinstance(value, (int, float)) and not value >= 0:
        what = f"a standard uncertainty must be 0 or above, got {value:g}"
        raise fault(what, hint="0 is known exactly, `unknown` is not known")
    return value


def _three(value: Any) -> Any:
    value = from_numpy(value)
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        got = f"{len(value)} of them" if isinstance(value, (list, tuple)) else f"{value!r:.40}"
        raise fault(f"must be a list of three, got {got}", hint="write [.., .., ..]")
    return value


def one_for_all(value: Any) -> Any:
    """Return a single number, or word, as three of them."""
    return (value,) * 3 if isinstance(value, (int, float, str, np.generic)) else value


def list_of(item: dict[str, Any], least: int, most: int | None = None) -> dict[str, Any]:
    """Return the JSON Schema of a list."""
    ends = {"minItems": least} | ({} if most is None else {"maxItems": most})
    return {"type": "array", "items": item, **ends}


_STD_SCHEMA = {"anyOf": [{"type": "number", "minimum": 0}, {"enum": [UNKNOWN, ".inf"]}]}
_STD_SCHEMA_3 = {"anyOf": [*_STD_SCHEMA["anyOf"], list_of(_STD_SCHEMA, 3, 3)]}


def _rectangular(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if len({len(row) for row in rows}) != 1 or not rows[0]:
        raise fault("must have rows of one length", hint="write every number of every row")
    return rows


_before = BeforeValidator(_as_number)
Number = Annotated[float, Field(strict=True, allow_inf_nan=False), _before, Once()]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0), _before, Once()]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0), _before, Once()]
Probability = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1), _before, Once()]
Coverage = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, lt=1), _before, Once()]
PositiveCount = Annotated[int, Field(strict=True, gt=0), BeforeValidator(from_numpy), Once()]
Count = Annotated[int, Field(strict=True, ge=0), BeforeValidator(from_numpy), Once()]
Flag = Annotated[bool, Field(strict=True), BeforeValidator(from_numpy), Once()]


Numbers = Annotated[tuple[Number, ...], BeforeValidator(from_numpy), Once()]
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_three), Once()]
PositiveVector = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_three), Once()]
Vectors = Annotated[tuple[Vector, ...], BeforeValidator(from_numpy), Once()]
Matrix = Annotated[
    tuple[Numbers, ...], BeforeValidator(from_numpy), AfterValidator(_rectangular), Once()
]
Matrix3 = Annotated[tuple[Vector, Vector, Vector], BeforeValidator(_three), Once()]

OpenStd = Annotated[NotNegative | None, BeforeValidator(none_where_open), Once()]
OpenStds = Annotated[tuple[OpenStd, OpenStd, OpenStd], BeforeValidator(none_where_open), Once()]
OpenAngles = Annotated[
    tuple[Number | None, Number | None, Number | None], BeforeValidator(none_where_open), Once()
]
OpenRows = Annotated[tuple[OpenAngles, ...], BeforeValidator(none_where_open), Once()]
OpenStdRows = Annotated[tuple[OpenStds, ...], BeforeValidator(none_where_open), Once()]
"""Null where the data and the rig leave it open, or nothing is measured."""

Std = Annotated[
    float,
    Field(strict=True),
    BeforeValidator(_std),
    PlainSerializer(lambda std: UNKNOWN if math.isinf(std) else std, return_type=float | str),
    WithJsonSchema(_STD_SCHEMA),
    Once(),
]
"""A standard uncertainty; ∞ is unknown."""

Stds = Annotated[
    tuple[Std, Std, Std],
    BeforeValidator(_three),
    BeforeValidator(one_for_all),
    WithJsonSchema(_STD_SCHEMA_3),
    Once(),
]
"""Three of them; a single one stands for all three."""

Text = Annotated[
    str, StringConstraints(strict=True, min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$"), Once()
]
"""One line of text."""


def whole_as_text(value: Any) -> Any:
    """Return a whole number as its text, all else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Label = Annotated[
    Text, BeforeValidator(whole_as_text), WithJsonSchema({"type": ["string", "integer"]}), Once()
]
"""One line of text, such as a serial number: a bare number is its text."""


def _date(value: str) -> str:
    try:
        datetime.fromisoformat(value)
    except ValueError:
        raise fault(
            f"is no date: {value!r:.40}", hint="write 2026-11-21 or 2026-11-21T08:30:00Z"
        ) from None
    return value


Date = Annotated[Text, AfterValidator(_date), Once()]
"""A day, or a time of a day, in ISO 8601."""

FreeText = Annotated[str, StringConstraints(strict=True, min_length=1), Once()]
"""Text as it comes, such as a file's name."""

Name = Annotated[
    str,
    StringConstraints(strict=True, pattern=r"^[A-Za-z0-9_][A-Za-z0-9_-]*$", max_length=64),
    Once(),
]
"""A support's name; it is part of field and parameter names such as `ncp1.rx`."""

Sha256 = Annotated[str, StringConstraints(strict=True, pattern=r"^[0-9a-f]{64}$"), Once()]


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
