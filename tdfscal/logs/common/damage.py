"""Damage that libraries report in their own ways becomes a DataError; errors get their file."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from tdfscal.errors import DataError, UsageError
from tdfscal.files.yaml import shorten
from tdfscal.memory import is_short, shortage

LIBRARY_FAULTS: Final = (OSError, EOFError, ValueError, OverflowError, struct.error)
"""What libraries raise on bytes that are not what they should be."""


@contextmanager
def placed(whole: Path | str) -> Iterator[None]:
    """Put a file, or a part of it, before the place that a DataError states within it."""
    try:
        yield
    except DataError as error:
        if (error.where or "").startswith(str(whole)):
            raise
        where = f"{whole}, {error.where}" if error.where else str(whole)
        raise error.restated(where=where) from error


@contextmanager
def damage(path: Path, *kinds: type[Exception]) -> Iterator[None]:
    """Turn what libraries and the operating system raise on a damaged file into a DataError.

    kinds : the library's own exceptions. Raises MemoryShortError where the memory does not suffice,
    UsageError where the file is not there, or not to be read by this user.
    """
    doubtful: tuple[type[Exception], ...] = (*kinds, *LIBRARY_FAULTS, MemoryError)
    try:
        yield
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        why = error.strerror or str(error)
        raise UsageError(f"the file cannot be opened ({why})", where=str(path)) from error
    except doubtful as error:
        if is_short(error):
            raise shortage() from error
        what = f"the file is damaged ({reason(error)})"
        raise DataError(what, hint="copy it from the recorder again") from error


def reason(error: BaseException) -> str:
    """Say in plain words what is wrong: libraries speak of their codecs, protocols and types."""
    if isinstance(error, UnicodeDecodeError):
        return "a text in it is not UTF-8"
    if isinstance(error, struct.error | EOFError):
        return "it ends too early"
    if isinstance(error, OverflowError):
        return "a number in it is too large"
    if isinstance(error, OSError) and error.errno is not None:
        return error.strerror or "it cannot be read"
    if type(error) is ValueError:  # ours, but for a few
        return shorten(" ".join(str(error).split()).rstrip("."), 160)
    return "its content cannot be decoded"
