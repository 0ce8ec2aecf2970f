"""Arguments as a command line writes them or as Python has them, turned into values."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from numbers import Integral, Real
from pathlib import Path
from reprlib import repr as shortly
from types import NoneType, UnionType
from typing import Any, Literal, TypeGuard, Union, get_args, get_origin

from tdfscal.errors import UsageError
from tdfscal.logs import Moment, TimeWindow
from tdfscal.logs.text.date_times import seconds_of

PathLike = str | os.PathLike[str]
PathLikes = PathLike | Sequence[PathLike]
Numbers = str | Sequence[float]
#: A moment of a log as text, a number of s, or a date and time.
Instant = str | float | datetime

#: What types are to a user.
_SAID = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    str: "a text",
    os.PathLike: "a path",
    datetime: "a date and time",
    Sequence: "a list",
    Iterable: "a list",
    Mapping: "a mapping",
    NoneType: "None",
}
_UNIONS = (Union, UnionType)
_UNITS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_DURATION = re.compile(r"(\+?)\s*(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(ms|s|min|h)?")


def listed(paths: PathLikes) -> list[Path]:
    """Return one path, or several, as a list."""
    if isinstance(paths, str | os.PathLike):
        return [Path(paths)]
    return [Path(path) for path in paths]


def one(path: PathLike | None) -> Path | None:
    """Return a path that may be missing."""
    return None if path is None else Path(path)


def at_least(option: str, value: float | None, least: float) -> None:
    """Raise UsageError for a number below the least; None is the default."""
    if value is not None and not value >= least:
        raise UsageError(f"{value} is too small", where=option, hint=f"give {least:g} or more")


def check_argument(option: str, value: Any, kind: Any, least: float | None = None) -> None:
    """Look whether a value is of its parameter's type, and no number below the least.

    Raises UsageError; for a text that can be no path too.
    """
    members = get_args(kind) if get_origin(kind) in _UNIONS else (kind,)
    if not any(_fits(value, member) for member in members):
        raise UsageError(
            f"{shortly(value)} is none of what this takes",
            where=option,
            hint=f"give {' or '.join(map(_said, members))}",
        )
    if least is not None and isinstance(value, Real):
        at_least(option, value, least)  # type: ignore[arg-type]
    if any(get_origin(member) is os.PathLike for member in members):
        for path in value if _is_list(value) else (value,):
            if isinstance(path, str | os.PathLike) and "\0" in os.fspath(path):
                raise UsageError(f"{shortly(path)} is no path", where=option, hint="check it")


def _fits(value: object, kind: Any) -> bool:
    origin, parts = get_origin(kind) or kind, get_args(kind)
    if origin in _UNIONS:
        return any(_fits(value, part) for part in parts)
    if origin is Literal:
        return isinstance(value, str) and value in parts
    if origin is bool or isinstance(value, bool):
        return origin is bool and isinstance(value, bool)
    if origin is int:
        return isinstance(value, Integral)
    if origin is float:
        return isinstance(value, Real) and _is_double(value)
    if origin is Mapping:
        return isinstance(value, Mapping) and all(
            _fits(key, parts[0]) and _fits(each, parts[1]) for key, each in value.items()
        )
    if origin in (Sequence, Iterable):
        # What is walked but once is not walked here.
        each = value if _is_list(value) else ()
        return (each is value or isinstance(value, Iterator)) and all(
            _fits(one, parts[0]) for one in each
        )
    if origin is os.PathLike:
        return isinstance(value, os.PathLike) and isinstance(os.fspath(value), str)
    return isinstance(value, origin)


def _is_double(value: Any) -> bool:
    try:
        return not math.isnan(float(value))
    except OverflowError:
        return False


def _is_list(value: object) -> TypeGuard[Collection[Any]]:
    with suppress(TypeError):  # an array of no dimension has no length
        return not isinstance(value, str | bytes | Mapping) and len(value) >= 0  # type: ignore[arg-type]
    return False


def _said(kind: Any) -> str:
    """Return what a type is to a user."""
    origin = get_origin(kind) or kind
    if origin is Literal:
        return ", ".join(get_args(kind))
    return _SAID.get(origin, getattr(origin, "__name__", str(origin)))


def check_trials(trials: int | None) -> None:
    """Raise UsageError for a number of Monte Carlo trials that gives no standard uncertainty."""
    at_least("--trials", trials, 0)
    if trials == 1:
        raise UsageError("one trial has no spread", where="--trials", hint="give 0, or 2 or more")


def numbers(option: str, value: Numbers) -> tuple[float, ...]:
    """Return finite numbers, of a sequence or of text such as `0.1,0.1,0.2`. Raises UsageError."""
    try:
        values = tuple(
            float(part) for part in (value.split(",") if isinstance(value, str) else value)
        )
    except (TypeError, ValueError):
        values = ()
    if not values or not all(map(math.isfinite, values)):
        raise UsageError(
            f"{value!r} is no list of numbers", where=option, hint="write numbers as 0.1,0.1,0.2"
        )
    return values


def triple(option: str, value: Numbers) -> tuple[float, float, float]:
    """Return three numbers, as `numbers`."""
    values = numbers(option, value)
    if len(values) != 3:
        raise UsageError(f"{value!r} is not three numbers", where=option, hint="write 0,0,0")
    return values[0], values[1], values[2]


def window(begin: Instant | None, end: Instant | None) -> TimeWindow | None:
    """Return the part of a log that `--from` and `--to` name; None for all. Raises UsageError."""
    ends = [
        None if value is None else _moment(option, value)
        for option, value in (("--from", begin), ("--to", end))
    ]
    first, last = ends
    if first is None and last is None:
        return None
    if first and last and first.after_begin == last.after_begin and first.seconds >= last.seconds:
        raise UsageError(
            f"{first} is not before {last}", where="--from, --to", hint="give the earlier one first"
        )
    return TimeWindow(first, last)


def _moment(option: str, value: Instant) -> Moment:
    if isinstance(value, datetime):
        zoned = value if value.tzinfo else value.replace(tzinfo=UTC)
        return Moment(zoned.timestamp())
    text = str(value).strip()
    if found := _DURATION.fullmatch(text):
        with suppress(ValueError):
            seconds = float(found[2]) * _UNITS[found[3] or "s"]
            if math.isfinite(seconds):
                return Moment(seconds, after_begin=bool(found[1]))
    if (stamp := seconds_of(text)) is not None:
        return Moment(stamp)
    raise UsageError(
        f"{text!r} is no time",
        where=option,
        hint="write s of the log's clock as 12.5, 1.5min or 2h; +90 for 90 s after the log's "
        "begin; or a date with a time, 2026-11-21T09:30:00+01:00",
    )
