"""Every file that a command reads, or would read: what no output may replace."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from tdfscal.errors import TdfscalError
from tdfscal.files import RIG_NAME
from tdfscal.files.rig.reading import load_rig
from tdfscal.logs import is_log
from tdfscal.logs.bag.rosbag2 import read_bag


def inputs_read(
    paths: Iterable[Path] = (), *, rigs: Iterable[Path | None] = (), files: Iterable[Path] = ()
) -> list[Path]:
    """Return the files behind a command's arguments.

    Parameters
    ----------
    paths : campaign folders, logs, recordings; each with its rig and its survey.
    rigs : rig files, or their folders; None for one that is not named.
    files : all others.
    """
    found = list(files)
    for path in paths:
        found += _of_campaign(path)
    for rig in rigs:
        if rig is not None:
            found += _of_campaign(rig) if rig.is_dir() else _of_rig(rig)
    return found


def _of_campaign(path: Path) -> Iterator[Path]:
    """Logs with all their parts, the rig, the survey; in whatever state they are."""
    with contextlib.suppress(OSError):
        if not path.is_dir():
            yield path
        elif is_log(path):
            yield from _of_recording(path)
        else:
            for entry in path.iterdir():
                if is_log(entry):
                    yield entry
                    if entry.is_dir():
                        yield from _of_recording(entry)
        inside = path.is_dir() and not is_log(path)
        yield from _of_rig((path if inside else path.absolute().parent) / RIG_NAME)


def _of_recording(folder: Path) -> Iterator[Path]:
    """All that lies in a bag's folder, and what its metadata name elsewhere."""
    yield from folder.rglob("*")
    with contextlib.suppress(TdfscalError, OSError):
        yield from read_bag(folder).files


def _of_rig(path: Path) -> Iterator[Path]:
    yield path
    with contextlib.suppress(TdfscalError, OSError):
        tracker = load_rig(path).tracker if path.is_file() else None
        if tracker is not None:
            yield from tracker.paths
