"""Arguments as a command line writes them or as Python has them; how a caller follows the work."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from tdfscal.errors import UsageError, expect
from tdfscal.files.yaml import as_path
from tdfscal.frozen import record
from tdfscal.logs import Moment, TimeWindow
from tdfscal.logs.table import seconds_of

PathLike = str | os.PathLike[str]
PathLikes = PathLike | Sequence[PathLike]
Numbers = str | Sequence[float]
#: A moment of a log as text, a number of s, or a date and time.
Instant = str | float | datetime


_UNITS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
_DURATION = re.compile(r"(\+?)\s*(-?[0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(ms|s|min|h)?")


def _unheard(text: str) -> None:
    """Nobody listens."""


@record
class Progress:
    """Called while a command works. stage : with the name of each stage that begins."""

    stage: Callable[[str], None] = _unheard

    def __post_init__(self) -> None:
        expect("stage", self.stage, Callable, "a function")

    def __repr__(self) -> str:
        return "SILENT" if self == SILENT else object.__repr__(self)


SILENT = Progress()


def listed(paths: PathLikes) -> list[Path]:
    """Return one path, or several, as a list. Raises UsageError where one is named twice."""
    each = [paths] if isinstance(paths, str | os.PathLike) else paths
    expect("paths", each, Sequence, "a path, or a list of them")
    found = list(map(as_path, each))
    counts = Counter(map(os.path.realpath, found))
    for path in found:
        if counts[os.path.realpath(path)] > 1:
            raise UsageError("is named twice", where=str(path), hint="name each path once")
    return found


def one(path: PathLike | None) -> Path | None:
    """Return a path that may be missing."""
    return None if path is None else as_path(path)


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
        return Moment(zoned.timestamp(), dated=True)
    text = str(value).strip()
    if found := _DURATION.fullmatch(text):
        with suppress(ValueError):
            seconds = float(found[2]) * _UNITS[found[3] or "s"]
            if math.isfinite(seconds):
                return Moment(seconds, after_begin=bool(found[1]))
    if (stamp := seconds_of(text)) is not None:
        return Moment(stamp, dated=True)
    raise UsageError(
        f"{text!r} is no time",
        where=option,
        hint="write s of the log's clock as 12.5, 1.5min or 2h; +90 for 90 s after the log's "
        "begin; or a date with a time, 2026-11-21T09:30:00+01:00",
    )
