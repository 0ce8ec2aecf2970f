"""Recordings of messages: ROS (CDR, ROS 1), JSON and protobuf, the wanted topics only."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Final

from mcap.exceptions import McapError

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.damage import damage
from tdfscal.logs.common.request import Items, Outcome, Piece, Reached, Request, join, split
from tdfscal.logs.messages.buffer import Recording
from tdfscal.logs.messages.contents import RecordingLook
from tdfscal.logs.messages.topics import Topics
from tdfscal.records import Integrity

_MAX_SAMPLES: Final = 1 << 16
_ENOUGH: Final = 1 << 14
_OPENING: Final = 1 << 20  # bytes
Check = Callable[[Path, Mapping[str, int]], tuple[Sequence[str], Sequence[Finding]]]
"""(file, messages by topic) → contradictions and doubts of what else states their counts."""


def read_recording(
    path: Path,
    request: Request,
    *,
    reached: Reached,
    opened: Callable[[Path], Recording],
    check: Check | None = None,
) -> Items:
    """Read a recording in pieces; see `request.Reader`.

    opened : gives the recording of a path. check : of its counts against those of the recording
    that it is part of.
    """
    recording = opened(path)
    topics = Topics(recording, request)
    if (announced := recording.announced()) is not None:
        topics.check_present(announced)
    look = RecordingLook(recording) if request.describe else None
    waiting: list[Piece] = []
    size = 0
    with damage(path, McapError):
        for messages in recording.messages():
            if look is not None:
                look.note(messages)
            piece = topics.piece(messages)
            if not piece:
                continue
            waiting.append(piece)
            size += max(block.time.size for block in piece)
            if size >= _ENOUGH:
                yield from split(join(waiting), _MAX_SAMPLES)
                waiting, size = [], 0
                reached(recording.reached)
        if waiting:
            yield from split(join(waiting), _MAX_SAMPLES)
    topics.check_complete()
    contradictions, doubts = check(path, topics.counts()) if check else ((), ())
    if contradictions and recording.cut_at is None:
        raise DataError(contradictions[0], hint="copy the recording again")
    skewed = [f for topic, skew in topics.skews.items() for f in skew.findings(topic)]
    seen = look.contents() if look is not None else None
    whole = recording.checked and recording.cut_at is None
    integrity: Integrity = "verified" if whole else "unverified"
    yield Outcome(integrity, (*doubts, *skewed), seen, recording.cut_at)


def recording_contents(recording: Recording, *, opening: bool) -> Contents:
    """Look through a recording, or its opening: every topic."""
    look = RecordingLook(recording)
    with damage(recording.path, McapError), closing(recording.messages()) as stream:
        for messages in stream:
            look.note(messages)
            if opening and recording.reached > _OPENING:
                break
    return look.contents()
