"""The kinds of value that the file models are made of: finite numbers, vectors, names, text.

Numbers are strict (no bool, NaN, ∞ or text); `saving.plain` makes them of arrays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    StringConstraints,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError
from typing_extensions import TypeAliasType

from tdfscal.files.yaml import as_written, nearest, shorten
from tdfscal.frozen import FrozenInstanceError
from tdfscal.records import BoolArray, FloatArray, UncertainValue

UNKNOWN = "unknown"
"""How a file writes an infinite standard uncertainty, since JSON has no infinity."""


LARGEST = 1e60
"""Of all numbers in a file; of what a rig file states, its inverse is the smallest beside 0."""
LengthUnit = Literal["m", "cm", "mm", "um", "in"]
"""Of point files."""


class Strict(BaseModel):
    """A part of a file: frozen, and no key that is not declared."""

    # A part is checked within its file, so that only the files' own validators need building.
    model_config = ConfigDict(
        extra="forbid", frozen=True, protected_namespaces=(), defer_build=True
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_known(cls, given: Any) -> Any:
        for name in given if isinstance(given, dict) else ():
            if name not in cls.model_fields:
                raise unknown_key(str(name), list(cls.model_fields))
        return given

    def __setattr__(self, name: str, value: object) -> None:
        if not name.startswith("_"):
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        raise FrozenInstanceError(f"cannot delete field {name!r}")

    def __hash__(self) -> int:
        """By what is stated, since a mapping among its values has no hash."""
        return hash((type(self), frozenset(self.model_fields_set)))


def unknown_key(name: str, known: Sequence[str], *place: str | int) -> PydanticCustomError:
    """Return the error of a key that is none of those known at a place: which it may be."""
    if name.isdecimal():
        hint = "write decimals with a point: in braces a comma ends a value"
        return fault(f"unknown key `{name}`", *place, name, hint=hint)
    near, hint = nearest(name, known), "rename or remove it"
    if near is None:
        near = nearest(name, known, cutoff=0.0) or known[0]
        hint = f"remove it; known here are {', '.join(known)}"
    said = f"unknown key `{shorten(name)}`, the nearest known key is `{near}`"
    return fault(said, *place, name, hint=hint)


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
    if isinstance(given, (int, float)) and LARGEST < abs(given) < math.inf:
        raise fault(f"is beyond any quantity, got {as_written(given)}", hint="check the number")
    return given


def _as_stated(given: Any) -> Any:
    """Return a number; refused is besides what is 0 when it is squared, and is not 0."""
    value = _as_number(given)
    if isinstance(value, (int, float)) and 0 < abs(value) < 1 / LARGEST:
        raise fault(
            f"is below any quantity, got {as_written(value)}", hint="check the number, or write 0"
        )
    return value


def open_as_infinite(stds: Any) -> FloatArray:
    """Return the standard uncertainties of a file as an array, ∞ where it has none."""
    return np.nan_to_num(np.array(stds, dtype=np.float64), nan=np.inf, posinf=np.inf)


def measured_only(values: FloatArray, axes: BoolArray) -> FloatArray:
    """Return values (n, 3) for a file: ∞, which becomes null, for an axis that is not measured."""
    return np.where(axes, values, np.inf)


def _std(given: Any) -> Any:
    # `.inf` is text in JSON, which has no infinity.
    value = math.inf if given in (UNKNOWN, ".inf") else _as_stated(given)
    if isinstance(value, str):
        what = f"must be a number or `{UNKNOWN}`, got {as_written(value)}"
        raise fault(what, hint="correct the value")
    if isinstance(value, (int, float)) and not value >= 0:
        what = f"a standard uncertainty must be 0 or above, got {value:g}"
        raise fault(what, hint="0 is known exactly, `unknown` is not known")
    return value


def _three(value: Any) -> Any:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        got = f"{len(value)} of them" if isinstance(value, (list, tuple)) else as_written(value)
        raise fault(f"must be a list of three, got {got}", hint="write [.., .., ..]")
    return value


def one_for_all(value: Any) -> Any:
    """Return a single number, or word, as three of them."""
    return (value,) * 3 if isinstance(value, (int, float, str)) else value


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


# Each kind by its name: pydantic builds it once, and the published schemas tell it once.
_Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_number, _triple = BeforeValidator(_as_number), BeforeValidator(_three)
Number = TypeAliasType("Number", Annotated[_Finite, _number])
Positive = TypeAliasType("Positive", Annotated[_Finite, Field(gt=0), _number])
NotNegative = TypeAliasType("NotNegative", Annotated[_Finite, Field(ge=0), _number])
Amount = TypeAliasType("Amount", Annotated[_Finite, Field(ge=0), BeforeValidator(_as_stated)])
PositiveAmount = TypeAliasType(
    "PositiveAmount", Annotated[_Finite, Field(gt=0), BeforeValidator(_as_stated)]
)
"""As a rig file states them."""
Probability = TypeAliasType("Probability", Annotated[_Finite, Field(ge=0, le=1), _number])
Coverage = TypeAliasType("Coverage", Annotated[_Finite, Field(gt=0, lt=1), _number])
PositiveCount = TypeAliasType("PositiveCount", Annotated[int, Field(strict=True, gt=0)])
Count = TypeAliasType("Count", Annotated[int, Field(strict=True, ge=0)])
Flag = TypeAliasType("Flag", Annotated[bool, Field(strict=True)])


Numbers = TypeAliasType("Numbers", tuple[Number, ...])
Vector = TypeAliasType("Vector", Annotated[tuple[Number, Number, Number], _triple])
PositiveVector = TypeAliasType(
    "PositiveVector", Annotated[tuple[Positive, Positive, Positive], _triple]
)
Vectors = TypeAliasType("Vectors", tuple[Vector, ...])
Matrix3 = TypeAliasType("Matrix3", Annotated[tuple[Vector, Vector, Vector], _triple])
Matrix = TypeAliasType("Matrix", Annotated[tuple[Numbers, ...], AfterValidator(_rectangular)])
Counts = TypeAliasType("Counts", tuple[Count, ...])
Pairs = TypeAliasType("Pairs", tuple[tuple[NotNegative, NotNegative], ...])
Quaternion = TypeAliasType("Quaternion", tuple[Number, Number, Number, Number])

OpenStd = TypeAliasType("OpenStd", NotNegative | None)
OpenStds = TypeAliasType("OpenStds", tuple[OpenStd, OpenStd, OpenStd])
_OpenNumber = Number | None
OpenAngles = TypeAliasType("OpenAngles", tuple[_OpenNumber, _OpenNumber, _OpenNumber])
OpenRows = TypeAliasType("OpenRows", tuple[OpenAngles, ...])
OpenStdRows = TypeAliasType("OpenStdRows", tuple[OpenStds, ...])
"""Null where the data and the rig leave it open, or nothing is measured."""

Std = TypeAliasType(
    "Std",
    Annotated[
        float,
        Field(strict=True),
        BeforeValidator(_std),
        PlainSerializer(lambda std: UNKNOWN if math.isinf(std) else std, return_type=float | str),
        WithJsonSchema(_STD_SCHEMA),
    ],
)
"""A standard uncertainty; ∞ is unknown."""

_Std3 = Annotated[tuple[Std, Std, Std], _triple, BeforeValidator(one_for_all)]
Stds = TypeAliasType("Stds", Annotated[_Std3, WithJsonSchema(_STD_SCHEMA_3)])
"""Three of them; a single one stands for all three."""

LINE, WORD, DIGEST = r"^[^\x00-\x1f\x7f]+$", r"^[A-Za-z0-9_][A-Za-z0-9_-]*$", r"^[0-9a-f]{64}$"
_LINE = StringConstraints(strict=True, min_length=1, pattern=LINE)
Text = TypeAliasType("Text", Annotated[str, _LINE])
"""One line of text."""


def whole_as_text(value: Any) -> Any:
    """Return a whole number as its text, all else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


_LABEL = WithJsonSchema({"type": ["string", "integer"]})
Label = TypeAliasType("Label", Annotated[Text, BeforeValidator(whole_as_text), _LABEL])
"""One line of text, such as a serial number: a bare number is its text."""


def _date(value: str) -> str:
    try:
        datetime.fromisoformat(value)
    except ValueError:
        raise fault(
            f"is no date: {as_written(value)}", hint="write 2026-11-21 or 2026-11-21T08:30:00Z"
        ) from None
    return value


Date = TypeAliasType("Date", Annotated[Text, AfterValidator(_date)])
"""A day, or a time of a day, in ISO 8601."""

FreeText = TypeAliasType("FreeText", Annotated[str, StringConstraints(strict=True, min_length=1)])
"""Text as it comes, such as a file's name."""

_WORD = StringConstraints(strict=True, pattern=WORD, max_length=64)
Name = TypeAliasType("Name", Annotated[str, _WORD])
"""A support's name; it is part of field and parameter names such as `ncp1.rx`."""

Sha256 = TypeAliasType("Sha256", Annotated[str, StringConstraints(strict=True, pattern=DIGEST)])


def _with_std(given: Any, info: ValidationInfo) -> Any:
    """Refuse a bare value: a quantity without its uncertainty is no measurement."""
    if isinstance(given, (dict, Strict)):
        return given
    number = as_written(given) if isinstance(given, int | float | list) else "..."
    raise fault(
        f"states no standard uncertainty, got {as_written(given)}",
        hint=f"write `{info.field_name}: {{value: {number}, std: ...}}`; "
        "std: 0 says exact, std: unknown says unknown",
    )


WithStd = BeforeValidator(_with_std)


Value = TypeVar("Value")
Spread = TypeVar("Spread")


class Known(Strict, Generic[Value, Spread]):
    """A quantity with its standard uncertainty; a single one stands for all components.

    Each kind of it is named in its module: of one that is made within a class no pickle can be.
    """

    value: Value = key("the value")
    std: Spread = key("its standard uncertainty, in the same unit; 0 exact")

    def record(self) -> UncertainValue:
        """Return it as a record; ∞ is unknown."""
        value = np.array(self.value, dtype=np.float64)
        std = np.broadcast_to(open_as_infinite(self.std), value.shape)
        return UncertainValue(value, np.array(std))


Quantity = Known[Number, Std]
