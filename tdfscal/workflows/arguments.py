"""Arguments as a command line writes them or as Python has them, turned into values."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

from tdfscal.errors import UsageError

PathLike = str | os.PathLike[str]
PathLikes = PathLike | Sequence[PathLike]
Numbers = str | Sequence[float]


def listed(paths: PathLikes) -> list[Path]:
    """Return one path, or several, as a list."""
    if isinstance(paths, str | os.PathLike):
        return [Path(paths)]
    return [Path(path) for path in paths]


def one(path: PathLike | None) -> Path | None:
    """Return a path that may be missing."""
    return None if path is None else Path(path)


def one_of(option: str, value: str, choices: Sequence[str]) -> None:
    """Raise UsageError for a value that is none of the choices."""
    if value not in choices:
        raise UsageError(
            f"{value!r} is none of the choices", where=option, hint=f"use {', '.join(choices)}"
        )


def at_least(option: str, value: float, least: float) -> None:
    """Raise UsageError for a number below the least."""
    if not value >= least:
        raise UsageError(f"{value:g} is too small", where=option, hint=f"give {least:g} or more")


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
