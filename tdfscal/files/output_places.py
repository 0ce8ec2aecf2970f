"""Where results go: refused before the work, not after it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from tdfscal.errors import UsageError
from tdfscal.files import RIG_NAME


def check_place(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Raise UsageError where a file cannot be written, or is one of the inputs; `-` always can.

    inputs : files and campaign folders.
    """
    if str(path) == "-":
        return
    folder = path.absolute().parent
    if path.is_dir():
        raise UsageError("is a folder", where=str(path), hint="name a file in it")
    if not folder.is_dir():
        raise UsageError(
            "the folder for the result does not exist", where=str(path), hint="create it first"
        )
    if not os.access(folder, os.W_OK):
        raise UsageError(
            "the folder for the result cannot be written",
            where=str(path),
            hint="choose another folder",
        )
    if not path.exists():
        return
    named = list(inputs)
    for given in (*named, *(folder / RIG_NAME for folder in named)):
        if given.exists() and path.samefile(given):
            raise UsageError(
                "would replace an input", where=str(path), hint="choose another name for the result"
            )


def check_folder(path: Path) -> None:
    """Raise UsageError where a folder for results is not there and cannot be made."""
    there = next(p for p in (path.absolute(), *path.absolute().parents) if os.path.lexists(p))
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise UsageError(
            "no folder for the results can be made here" if there.is_dir() else "is not a folder",
            where=str(there),
            hint="choose another folder",
        )


def check_calibration(path: Path) -> None:
    """Raise UsageError where a folder stands in the place of a calibration file."""
    if path.is_dir():
        raise UsageError(
            "is a folder; a calibration file is wanted here",
            where=str(path),
            hint="name the .yaml or .json file that calibrate wrote",
        )
