"""Where results go: refused before the work, not after it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from tdfscal.errors import UsageError
from tdfscal.files.outputs import check_link, check_target, identity, protect, replaces_input

#: Of report pages.
PAGE_SUFFIXES = (".html", ".htm")


def check_outputs(
    outputs: Mapping[str, tuple[Path | None, Sequence[str]]], inputs: Sequence[Path]
) -> None:
    """Refuse places of output before the work, and keep the inputs from any that follows.

    outputs : by option, the file, None where it is not asked for; and what its name may end in,
    nothing where that is free. inputs : every file that the command reads or would read.

    Raises UsageError where a place cannot be written, is that of an input, is named twice, or the
    name ends in what another kind of file has.
    """
    protect(inputs)
    protected = {identity(path) for path in inputs} - {None}
    places: dict[str, str] = {}
    for option, (path, suffixes) in outputs.items():
        if path is None:
            continue
        if suffixes:
            check_suffix(path, suffixes)
        check_place(path)
        if identity(path) in protected:
            raise replaces_input(path)
        place = os.path.realpath(path)
        if place in places and path.name != "null":
            raise UsageError(
                f"{places[place]} and {option} name one file",
                where=str(path),
                hint="give each a name of its own",
            )
        places[place] = option


def check_suffix(path: Path, suffixes: Sequence[str]) -> None:
    """Raise UsageError for a name that ends in none of the suffixes; a device may have any name."""
    device = path.exists() and not path.is_file() and not path.is_dir()
    if path.suffix.lower() not in suffixes and not device:
        *others, last = suffixes
        raise UsageError(
            f"the name of this file ends in {', '.join(others)}{' or ' if others else ''}{last}",
            where=str(path),
            hint="choose such a name",
        )


def check_place(path: Path) -> None:
    """Raise UsageError where a file cannot be written."""
    folder = path.absolute().parent
    check_target(path)
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


def check_folder(path: Path) -> None:
    """Raise UsageError where a folder for results is not there and cannot be made."""
    check_link(path)
    there = next(p for p in (path.absolute(), *path.absolute().parents) if os.path.lexists(p))
    if not there.is_dir() or not os.access(there, os.W_OK):
        raise UsageError(
            "no folder for the results can be made here" if there.is_dir() else "is not a folder",
            where=str(there),
            hint="choose another folder",
        )
