"""Damage that libraries report in their own ways becomes a DataError; errors get their file."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tdfscal.errors import DataError, UsageError
from tdfscal.files.yaml.scalars import shorten
from tdfscal.memory import is_short_for, shortage

_Kinds = tuple[type[Exception], ...]
_CAUGHT: _Kinds = (OSError, EOFError, ValueError, OverflowError, struct.error)


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

    kinds : the library's own exceptions. Raises MemoryShortError where the memory does not suffice
    for a file of this size, UsageError where it is not there, or not to be read by this user.
    """
    caught: _Kinds = (*kinds, *_CAUGHT)
    doubtful: _Kinds = (*caught, MemoryError, RuntimeError)
    try:
        yield
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        reason = error.strerror or str(error)
        raise UsageError(f"the file cannot be opened ({reason})", where=str(path)) from error
    except doubtful as error:
        short = is_short_for(path, error)
        if short:
            raise shortage() from error
        if short is False:
            what = "the file declares lengths that do not fit in memory; it is damaged"
            raise DataError(what) from None
        if not isinstance(error, caught):
            raise
        what = f"the file is damaged ({one_line(error).rstrip('.')})"
        raise DataError(what, hint="copy it from the recorder again") from error


def one_line(error: BaseException) -> str:
    """Return an exception's text on one line, shortened."""
    return shorten(" ".join(str(error).split()) or type(error).__name__, 160)
