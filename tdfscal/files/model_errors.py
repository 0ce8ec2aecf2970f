"""From what a model refuses to one paragraph: place, cause, advice."""

from __future__ import annotations

from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from tdfscal.errors import TdfscalError, UsageError
from tdfscal.files.field_types import DIGEST, LINE, UNKNOWN, WORD
from tdfscal.files.yaml import Document, Place, as_written, nearest, shorten

Model = TypeVar("Model", bound=BaseModel)

SHOWN = 3
"""Faults that one message lists."""


def checked(model: type[Model], document: Document, error: type[TdfscalError]) -> Model:
    """Return the document as a model. Raises `error` with the first faults, each with its place."""
    try:
        return model.model_validate(document.content)
    except ValidationError as refused:
        faults = refused.errors(include_url=False)
    # A list is not too short for want of the entries that are at fault.
    places = [fault["loc"] for fault in faults]
    faults = [
        fault
        for fault in faults
        if fault["type"] != "too_short"
        or not any(place[:-1][: len(fault["loc"])] == fault["loc"] for place in places)
    ]
    (place, what, hint), *others = [_told(document.content, fault) for fault in faults]
    for other, also, _ in others[: SHOWN - 1]:
        at = document.where(other).removeprefix(document.source).lstrip(", ")
        what += f"; also {at}: {also}" if at else f"; also {also}"
    if len(faults) > SHOWN:
        what += f"; and {len(faults) - SHOWN} more"
    raise error(what, where=document.where(place), hint=hint)


def require_format(document: Document, expected: str, error: type[TdfscalError]) -> None:
    """Check that the document is a mapping whose `format` is the expected `kind/version`."""
    content, where = document.content, document.source
    kind, version = expected.rsplit("/", 1)
    thing = f"{kind.removeprefix('tdfscal-')} file"
    hint = f"the file begins with `format: {expected}`"
    if content is None:
        raise error("is empty", where=where, hint=hint)
    if not isinstance(content, dict):
        found = "a list" if isinstance(content, list) else "a single value"
        raise error(f"is {found}, not a {thing}", where=where, hint=hint)
    if "format" not in content:
        near = nearest("format", list(content))
        hint = f"rename `{shorten(near)}` to `format`" if near else hint
        raise error(f"is not a {thing}: it has no `format`", where=where, hint=hint)
    if content["format"] == expected:
        return
    where, shown = document.where(("format",)), as_written(content["format"]).strip("'")
    named, _, number = shown.rpartition("/")
    if named == kind and number.isdecimal() and int(number) > int(version):
        what = f"is of the newer format {shown}; this program reads {expected}"
        raise error(what, where=where, hint="update tdfscal")
    if kind == "tdfscal-calibration":
        error, hint = UsageError, "name the file that `tdfscal calibrate` wrote"
    what = f"is not a {thing}: its format is `{shown}`, not `{expected}`"
    raise error(what, where=where, hint=hint)


def _told(content: Any, fault: ErrorDetails) -> tuple[Place, str, str]:
    """Return place, what and hint of one fault."""
    context, kind = fault.get("ctx", {}), fault["type"]
    whole, kept, there = content, list[str | int](), 0
    for part in (*fault["loc"], *context.get("place", ())):
        if part == 0 and isinstance(whole, dict):  # of a block that stands alone
            continue
        kept.append(part)
        try:
            whole, there = whole[part], len(kept)
        except (KeyError, IndexError, TypeError):
            whole = None
    place = tuple(kept)
    if kind == "missing" and isinstance(place[-1], int):
        return place[:-1], f"has {place[-1]} entries, too few", "add what is missing"
    if kind == "missing":
        return place[:-1], f"lacks `{place[-1]}`", _MISSING.get(place[-1], f"add `{place[-1]}`")
    what = _PHRASES.get(kind, fault["msg"].replace("Input should", "must", 1))
    what = what.format(**context) if kind == "too_short" else what
    what, advice = _PATTERNS.get(context.get("pattern", ""), (what, _HINTS.get(kind)))
    if kind != "tdfscal":
        what = f"{what[0].lower()}{what[1:]}, got {as_written(fault['input'])}"
    # A value that stands for a mapping (`mass: 500`) has no such place in the file.
    return place[:there], what, context.get("hint") or advice or "correct the value"


_MISSING: dict[str | int, str] = {
    "std": f"add it: `std: 0` says exact, `std: {UNKNOWN}` says unknown"
}
_PHRASES = {
    "string_too_short": "is empty",
    "too_short": "must have {min_length} entries or more",
    "float_type": "must be a number",
    "string_type": "must be text",
    "model_type": "must be a mapping of keys and values",
    "dict_type": "must be a mapping of keys and values",
    "string_too_long": "is too long",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "too_long": "has too many entries",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "float_parsing": "must be a number",
    "bool_type": "must be true or false",
}
_PATTERNS = {
    LINE: ("must be one line of text", "write it on one line"),
    WORD: ("is no name", "use letters, digits, `_` and `-`"),
    DIGEST: ("is no SHA-256 digest", "write its 64 digits, 0 to 9 and a to f"),
}
_HINTS = {
    "finite_number": f"write a number; only standard uncertainties may be `{UNKNOWN}` or .inf",
    "float_type": "write a number",
    "greater_than": "check sign and unit",
    "greater_than_equal": "check sign and unit",
    "literal_error": "use a value that is named here",
    "model_type": "write a mapping of keys and values",
    "dict_type": "write a mapping of keys and values",
    "string_type": "write text; put a number that is a name in quotes",
    "list_type": "write a list",
    "tuple_type": "write a list",
    "too_short": "add what is missing",
}
