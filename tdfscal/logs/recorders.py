"""Several recorders of one campaign: whose file is whose, and their samples on the first's clock.

Each recorder's files are read once. What they hold goes to a temporary file, and in short bins to
the search for the clocks; then it comes back, merged, on the clock of the first.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.findings import Finding, Value
from tdfscal.records import FloatArray, Log, LogMapping, RecorderClock, Series

if TYPE_CHECKING:
    from tdfscal.clocks import Tracks

#: Share of the longer recording that both hold, below which a part seems lost.
_COMPLETE = 0.9
_NONE = Series(np.empty(0), np.empty((0, 3)))


def files_by_recorder(
    paths: Sequence[Path], recorders: Sequence[LogMapping]
) -> list[tuple[LogMapping, list[Path]]]:
    """Tell which recorder's each path is, by the pattern of its block.

    Raises UsageError for a path that is nobody's or two recorders', or a recorder without any.
    """
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


def owns(recorder: LogMapping, path: Path) -> bool:
    """Tell whether a path is of a recorder's files."""
    return (
        recorder.files is None or fnmatch(path.name, recorder.files) or path.match(recorder.files)
    )


def on_one_clock(sources: Sequence[tuple[LogMapping, Iterator[Log]]]) -> Iterator[Log]:
    """Merge the recorders' pieces on the clock of the first.

    Raises
    ------
    DataError, NotIdentifiableError
        Where a recorder's clock cannot be found; see `find_clock`.
    UsageError
        The temporary file cannot be written.
    """
    with tempfile.TemporaryFile() as file:
        spools = [_Spool(file) for _ in sources]
        from tdfscal.clocks import Reduction, find_clocks  # of several alone

        tracks: list[Tracks] = []
        for spool, (_, pieces) in zip(spools, sources, strict=True):
            reduction = Reduction()
            for piece in pieces:
                reduction.add([s for pair in zip(piece.position, piece.force, strict=True)
                               for s in pair])  # fmt: skip
                spool.put(piece)
            tracks.append(reduction.finish())
        first, *others = tracks
        stated = [(str(mapping.files), mapping.clock) for mapping, _ in sources[1:]]
        clocks = find_clocks(first, [(name, own, clock) for own, (name, clock)
                                     in zip(others, stated, strict=True)])  # fmt: skip
        found = [_overlap(first, own, clock) for own, clock in zip(others, clocks, strict=True)]
        yield from _merged(spools, clocks, tuple(one for each in found for one in each))


def _overlap(first: Tracks, second: Tracks, clock: RecorderClock) -> list[Finding]:
    """Tell where one of two recorders misses much of what the other saw."""
    span = first.end - first.begin
    begin, end = clock.to_first(np.array([second.begin, second.end])) - first.begin
    both = min(end, span) - max(begin, 0.0)
    if both > _COMPLETE * max(end - begin, span):
        return []
    values: dict[str, Value] = {"begin": float(begin), "end": float(end), "span": span}
    return [Finding("recorders-overlap-in-part", (clock.recorder,), values=values)]


@dataclass(slots=True)
class _Spool:
    """Pieces of one recorder in a file. held : each piece without samples, and where these are."""

    file: IO[bytes]
    held: list[tuple[Log, list[tuple[int, int, int, int]]]] = field(default_factory=list)

    def put(self, piece: Log) -> None:
        """Append the samples of a piece; streams that share their stamps keep sharing them."""
        places, stamps = [], {}
        try:
            for number, series in enumerate(_streams(piece)):
                if not series.time.size:
                    continue
                if id(series.time) not in stamps:
                    stamps[id(series.time)] = self._append(series.time)
                values = self._append(np.ascontiguousarray(series.value))
                places.append((number, series.time.size, stamps[id(series.time)], values))
        except OSError as error:
            raise UsageError(
                f"the recordings cannot be held while their clocks are compared "
                f"({error.strerror or error})",
                where=tempfile.gettempdir(),
                hint="make room there, or name another folder with TMPDIR",
            ) from error
        empty = replace(
            piece,
            position=(_NONE,) * len(piece.position),
            force=(_NONE,) * len(piece.force),
            temperature=(_NONE,) * len(piece.temperature),
        )
        self.held.append((empty, places))

    def _append(self, array: FloatArray) -> int:
        place = self.file.seek(0, 2)
        self.file.write(array.tobytes())
        return place

    def pieces(self, clock: RecorderClock | None) -> Iterator[Log]:
        """All pieces again; on the first clock, where one is given."""
        for piece, places in self.held:
            streams = list(_streams(piece))
            stamps: dict[int, FloatArray] = {}
            for number, count, at, values in places:
                if at not in stamps:
                    time = self._taken(at, count)
                    stamps[at] = time if clock is None else clock.to_first(time)
                streams[number] = Series(stamps[at], self._taken(values, 3 * count).reshape(-1, 3))
            n = len(piece.supports)
            yield replace(
                piece,
                position=tuple(streams[:n]),
                force=tuple(streams[n : 2 * n]),
                temperature=tuple(streams[2 * n :]),
            )

    def _taken(self, place: int, count: int) -> FloatArray:
        self.file.seek(place)
        return np.frombuffer(self.file.read(8 * count), dtype=np.float64)


def _streams(piece: Log) -> tuple[Series, ...]:
    return (*piece.position, *piece.force, *piece.temperature)


def _merged(
    spools: Sequence[_Spool], clocks: Sequence[RecorderClock], found: tuple[Finding, ...]
) -> Iterator[Log]:
    """Pieces of all recorders in the order of their times."""
    feeds = [spool.pieces(clock) for spool, clock in zip(spools, (None, *clocks), strict=True)]
    # Temperatures of one recorder are those of the log.
    warm = max(len(piece.temperature) for spool in spools for piece, _ in spool.held)
    reached = [-np.inf] * len(feeds)
    first = True
    while min(reached) < np.inf:
        k = int(np.argmin(reached))
        piece = next(feeds[k], None)
        if piece is None:
            reached[k] = np.inf
            continue
        ends = [float(s.time[-1]) for s in _streams(piece) if s.time.size]
        reached[k] = max([reached[k], *ends]) if ends else reached[k]
        if not piece.temperature:
            piece = replace(piece, temperature=(_NONE,) * warm)
        if first:
            piece = replace(piece, clocks=tuple(clocks), findings=(*piece.findings, *found))
        yield piece
        first = False
