"""Logs in bags: rosbag2's SQLite files, and ROS 1."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

from tdfscal.logs.bag.packing import Stored
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.request import Outcome, Piece, Reached, Request
from tdfscal.logs.messages.contents import recording_contents
from tdfscal.logs.messages.reader import Check, read_recording


def read_bag_file(
    path: Path, request: Request, *, salvage: bool, reached: Reached, check: Check | None = None
) -> Generator[Piece, None, Outcome]:
    """Read a `.db3` or `.bag` file in pieces; see `request.Reader`.

    check : of its counts against those of the recording that it is part of.

    Raises
    ------
    DataError : with the topic of what is wrong.
    """
    return read_recording(_recording(path, salvage), request, reached=reached, check=check)


def bag_contents(path: Path) -> Contents:
    """Look through a `.db3` or `.bag` file.

    Raises
    ------
    UsageError, DataError : it cannot be read, or is damaged.
    """
    return recording_contents(_recording(path, salvage=False), "bag")


def _recording(path: Path, salvage: bool) -> Stored:
    if path.suffix.lower() == ".bag":
        from tdfscal.logs.bag.ros1 import Ros1Recording

        return Ros1Recording(path, salvage)
    from tdfscal.logs.bag.sqlite import SqliteRecording

    return SqliteRecording(path, salvage)
