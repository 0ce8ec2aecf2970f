"""Logs as MCAP."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.request import Outcome, Piece, Reached, Request
from tdfscal.logs.mcap.container import Container
from tdfscal.logs.mcap.summary import announced_topics
from tdfscal.logs.messages.contents import recording_contents
from tdfscal.logs.messages.reader import Check, read_recording


def read_mcap(
    path: Path, request: Request, *, salvage: bool, reached: Reached, check: Check | None = None
) -> Generator[Piece, None, Outcome]:
    """Read an MCAP log in pieces; see `request.Reader`.

    check : of its counts against those of the recording that it is part of.

    Raises
    ------
    DataError : with the topic, or the place in the file, of what is wrong.
    """
    return read_recording(
        Container(path, salvage), request, reached=reached, check=check,
        announced=None if salvage else announced_topics(path),
    )  # fmt: skip


def mcap_contents(path: Path) -> Contents:
    """Look through an MCAP file.

    Raises
    ------
    UsageError, DataError : it cannot be read, or is damaged.
    """
    return recording_contents(Container(path, salvage=False), "mcap")
