"""Several recorders of one campaign: whose file is whose, and their samples on the first's clock.

Each recorder's files are read twice: in short bins, for the search for the clocks; then merged, on
the clock of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.findings import Finding, Value
from tdfscal.logs.formats import owns
from tdfscal.records import Log, LogMapping, RecorderClock, Series

if TYPE_CHECKING:
    from tdfscal.clocks import Tracks

Reading = Callable[[], "Iterator[Log]"]
"""Reads a recorder's files from the begin."""
#: Share of the longer recording that both hold, below which a part seems lost.
_COMPLETE = 0.9
_NONE = Series(np.empty(0), np.empty((0, 3)))


def files_by_recorder(
    paths: Sequence[Path], recorders: Sequence[LogMapping]
) -> list[tuple[LogMapping | None, list[Path]]]:
    """Tell which recorder's each path is, by the pattern of its block; a lone one has all.

    Raises UsageError for a path that is nobody's or two recorders', or a recorder without any.
    """
    if len(recorders) < 2 and not any(recorder.files for recorder in recorders):
        return [(recorders[0] if recorders else None, list(paths))]
    found: list[list[Path]] = [[] for _ in recorders]
    for path in paths:
        owners = [k for k, recorder in enumerate(recorders) if owns(recorder, path)]
        if len(owners) != 1:
            patterns = ", ".join(f"`{recorder.files}`" for recorder in recorders)
            what = "is a file of no recorder" if not owners else "is a file of two recorders"
            raise UsageError(
                f"{what}; the rig file's log block says files: {patterns}",
                where=str(path),
                hint="correct the patterns in the log block, or leave the file out",
            )
        found[owners[0]].append(path)
    for recorder, own in zip(recorders, found, strict=True):
        if not own:
            raise UsageError(
                f"there is no file of the recorder `{recorder.files}`",
                where=", ".join(map(str, paths)),
                hint="name a log of each recorder, or correct `files` in its log block",
            )
    return list(zip(recorders, found, strict=True))


def on_one_clock(sources: Sequence[tuple[LogMapping, Reading]]) -> Iterator[Log]:
    """Merge the recorders' pieces on the clock of the first; raises as `find_clocks`.

    sources : each is read twice, for the clocks and for what it holds.
    """
    from tdfscal.clocks import Reduction, find_clocks  # of several alone

    tracks: list[Tracks] = []
    warm = 0  # temperatures of one recorder are those of the log
    for _, pieces in sources:
        reduction = Reduction()
        for piece in pieces():
            pairs = zip(piece.position, piece.force, strict=True)
            reduction.add([series for pair in pairs for series in pair])
            warm = max(warm, len(piece.temperature))
        tracks.append(reduction.finish())
    first, *others = tracks
    stated = [(str(mapping.files), mapping.clock) for mapping, _ in sources[1:]]
    each = [(name, own, clock) for own, (name, clock) in zip(others, stated, strict=True)]
    clocks = find_clocks(first, each)
    found: list[Finding] = []
    for own, clock in zip(others, clocks, strict=True):
        found += _overlap(first, own, clock)
    feeds = [
        _on_clock(pieces(), clock)
        for (_, pieces), clock in zip(sources, (None, *clocks), strict=True)
    ]
    for number, piece in enumerate(_in_order(feeds)):
        if not piece.temperature:
            piece = replace(piece, temperature=(_NONE,) * warm)
        yield (
            piece
            if number
            else replace(piece, clocks=tuple(clocks), findings=(*piece.findings, *found))
        )


def _overlap(first: Tracks, second: Tracks, clock: RecorderClock) -> list[Finding]:
    """Tell where one of two recorders misses much of what the other saw."""
    span = first.end - first.begin
    begin, end = clock.to_first(np.array([second.begin, second.end])) - first.begin
    both = float(min(end, span) - max(begin, 0.0))
    if both > _COMPLETE * max(end - begin, span):
        return []
    late = round(float(begin), 1) + 0.0  # no -0.0
    values: dict[str, Value] = {"own": float(end - begin), "begin": late, "span": span}
    return [Finding("recorders-overlap-in-part", (clock.recorder,), both, "s", values=values)]


def _on_clock(pieces: Iterator[Log], clock: RecorderClock | None) -> Iterator[Log]:
    """The pieces on the first clock, where one is given; what shares its stamps keeps sharing."""
    for piece in pieces:
        if clock is None:
            yield piece
            continue
        times = {id(s.time): clock.to_first(s.time) for s in _streams(piece)}
        streams = [Series(times[id(s.time)], s.value) for s in _streams(piece)]
        n = len(piece.supports)
        yield replace(
            piece,
            position=tuple(streams[:n]),
            force=tuple(streams[n : 2 * n]),
            temperature=tuple(streams[2 * n :]),
        )


def _in_order(feeds: Sequence[Iterator[Log]]) -> Iterator[Log]:
    """Pieces of all recorders in the order of their times."""
    reached = [-np.inf] * len(feeds)
    while min(reached) < np.inf:
        k = int(np.argmin(reached))
        piece = next(feeds[k], None)
        if piece is None:
            reached[k] = np.inf
            continue
        ends = [float(s.time[-1]) for s in _streams(piece) if s.time.size]
        reached[k] = max([reached[k], *ends])
        yield piece


def _streams(piece: Log) -> tuple[Series, ...]:
    return (*piece.position, *piece.force, *piece.temperature)
