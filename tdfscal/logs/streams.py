"""The streams of a file as its pieces pass: clocks, sizes, lone readings; those of recorders.

A reading stands alone, or a few together, where they are far off those before and after them, which
agree. No terminal of hundreds of kilograms moves so: the recorder, the bus or an edit has spoilt
cells.

Each of several recorders is read twice: in short bins, for the search for the clocks; then merged,
on the clock of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tdfscal.catalogue.numbers import when
from tdfscal.errors import DataError, UsageError
from tdfscal.files.rig.recorders import LogBlock
from tdfscal.findings import Finding, Value
from tdfscal.logs.clock import Clock, apart
from tdfscal.logs.formats import owns
from tdfscal.logs.log_file import Block, LogFile, Piece, Request, Signal
from tdfscal.records import BoolArray, ClockPrior, FloatArray, IntArray, Log, RecorderClock, Series

if TYPE_CHECKING:
    from tdfscal.clocks.tracks import Tracks


#: Largest magnitudes that are read, by quantity.
_LARGEST = {"position": (1e9, "m"), "force": (1e9, "N"), "temperature": (1e4, "°C")}
_NOTHING = Series(np.empty(0), np.empty((0, 3)))
_FEWEST = 32  # samples
_GLANCE, _ENOUGH = 16, 64  # of so many steps, one shows how large they are; so many at least
_UNUSUAL = 10.0  # a step / the usual one, from which on a reading is looked at
_FAR = 8.0  # a reading's distance / the largest step near it
_NEAR = 8  # steps looked at on either side
_RUN, _TOGETHER = 0.1, 10  # time, s, and samples of a few that stand alone together, at most
_EXACT = 1e-5  # of the largest reading: steps of a signal without noise


class Streams:
    """The streams of one file as their pieces pass.

    reached : s, per signal, where the file before ended. row : rows of the files before.
    begin : s, the first time. last : s, per signal, the latest time. count : samples, per signal.
    """

    def __init__(self, request: Request, reached: FloatArray, row: int) -> None:
        self._request, self._reached, self._row = request, reached, row
        self._clocks: dict[str, Clock] = {}
        self._lone = {
            number: LoneReadings(signal)
            for number, signal in enumerate(request.signals)
            if signal.quantity != "temperature" and request.mapping.rows == "timeseries"
        }
        self.last = reached.copy()
        self.begin = np.inf
        self.count = np.zeros(len(reached), dtype=np.int64)

    def passed(self, piece: Piece) -> list[Block]:
        """Leave out the samples that do not ascend or stand alone; refuse what cannot be."""
        blocks: list[Block] = []
        for block in piece:
            if block.clock == "row" and self._row:  # without a time, rows count on over the files
                block = replace(block, time=block.time + self._row)
            if block.clock not in self._clocks:
                before = max(float(self._reached[number]) for number in block.value)
                if block.time.size and block.time[0] < before:
                    raise DataError(
                        f"{block.clock} starts at {when(block.time[0])}, before the end of "
                        f"another log at {when(before)}",
                        hint="logs of one campaign follow each other; leave out the one that "
                        "overlaps",
                    )
                rows = self._request.mapping.rows
                self._clocks[block.clock] = Clock(block.clock, rows, before)
            keep = self._clocks[block.clock].ascending(block.time)
            if keep is not None:
                block = block.at(keep)
            together = dict(block.value)
            for number, value in block.value.items():
                lone = self._lone.get(number)
                keep = None if lone is None else lone.others(block.time, value)
                if keep is not None:
                    own = {number: together.pop(number)}
                    blocks.append(Block(block.clock, block.time, own).at(keep))
            if together:
                blocks.append(Block(block.clock, block.time, together))
        for block in blocks:
            for number, value in block.value.items():
                limit, _ = _LARGEST[self._request.signals[number].quantity]
                if value.size and not (value.max() <= limit and value.min() >= -limit):
                    self._refuse_size(block, number)
                self.count[number] += block.time.size
                if block.time.size:
                    self.begin = min(self.begin, float(block.time[0]))
                    self.last[number] = block.time[-1]
        return blocks

    def _refuse_size(self, block: Block, number: int) -> None:
        """Refuse what no NCP reaches and no sensor bears; sums of it would overflow."""
        signal = self._request.signals[number]
        limit, unit = _LARGEST[signal.quantity]
        size = np.abs(block.value[number]).max(axis=1)
        k = int(np.argmax(size > limit))
        raise DataError(
            f"the {signal.quantity} of {signal.support} is {size[k]:.3g} {unit} at "
            f"{when(block.time[k])}",
            hint=f"check the recorder, and the units of the log block; {limit:g} {unit} is "
            "the largest value read",
        )

    def findings(self, file: LogFile) -> list[Finding]:
        """What is to be said at the file's end; refuses a file that lacks a signal."""
        clocks = tuple(self._clocks.values())
        said = [self._truncated(file)] if file.cut_at is not None else []
        said += [*file.findings, *(f for clock in clocks for f in clock.finish())]
        said += apart(clocks) if len(clocks) > 1 else []
        said += [lone.finding() for lone in self._lone.values() if lone.count]
        for signal, count in zip(self._request.signals, self.count, strict=True):
            if count:
                continue
            fields = ", ".join(dict.fromkeys(signal.fields))
            what = f"there is no sample of the {signal.quantity} of {signal.support} ({fields})"
            if file.cut_at is not None:
                what += f" before byte {file.cut_at}, where the file was cut short"
            raise DataError(what)
        return said

    def _truncated(self, file: LogFile) -> Finding:
        """Say where a file that was cut short stops being whole."""
        end, rows = float(self.last.max()), "row" in self._clocks
        at = f"row {self.count.max()}" if rows else when(end)
        values: dict[str, Value] = {"byte": file.cut_at, "at": at}
        # From a clock's zero on the two are one number.
        values["apart"] = not rows and bool(abs(self.begin) > 0.05)
        size = None if rows else end - self.begin
        return Finding("log-truncated", (str(file.path),), size, "s", values=values)


def as_log(piece: Sequence[Block], request: Request) -> Log:
    """The samples of one piece, as a log."""
    n = len(request.supports)
    series = [_NOTHING] * (2 * n + len(request.mapping.temperature or ()))
    for block in piece:
        for index, value in block.value.items():
            measured = request.signals[index].measured
            series[request.numbers[index]] = Series(
                block.time, value if all(measured) else np.where(measured, value, 0.0)
            )
    return Log(
        supports=request.supports,
        position=tuple(series[0 : 2 * n : 2]),
        force=tuple(series[1 : 2 * n : 2]),
        temperature=tuple(series[2 * n :]),
        rows=request.mapping.rows,
    )


@dataclass(slots=True)
class LoneReadings:
    """Those of one signal, followed from piece to piece.

    count : how many. A piece's first and last samples have no neighbours and are kept.
    """

    signal: Signal
    count: int = 0
    _first: tuple[float, float, float] | None = None
    _samples: int = 0

    def others(self, time: FloatArray, value: FloatArray) -> BoolArray | None:
        """Which of the samples, (N,) s and (N, 3), do not stand alone; None where none does."""
        self._samples += len(time)
        if len(time) < _FEWEST:
            return None
        step = np.diff(value, axis=0)
        # Mean size of some of the steps.
        usual = np.abs(step[:: max(min(_GLANCE, len(step) // _ENOUGH), 1)]).mean(axis=0)
        unusual = np.maximum(step.max(axis=0), -step.min(axis=0)) > _UNUSUAL * usual
        most = int(np.clip(_RUN * (len(time) - 1) / max(time[-1] - time[0], _RUN), 1, _TOGETHER))
        found = [
            (k, axis)
            for axis in np.flatnonzero(unusual)
            for k in _lone(value[:, axis], usual[axis], most)
        ]
        if not found:
            return None
        if self._first is None:
            k, axis = min(found)
            self._first = float(time[k]), float(value[k, axis]), float(value[k - 1, axis])
        keep = np.ones(len(time), dtype=np.bool_)
        keep[[k for k, _ in found]] = False
        self.count += int(np.count_nonzero(~keep))
        return keep

    def finding(self) -> Finding:
        """Say how many there were, and where the first one."""
        at, lone, before = self._first or (np.nan,) * 3
        values: dict[str, Value] = {
            "signal": self.signal.quantity,
            "samples": self._samples,
            "at": when(at),
            "lone": lone,
            "before": before,
            "lone_unit": {"position": "m", "force": "N"}[self.signal.quantity],
        }
        return Finding("readings-alone", (self.signal.support,), self.count, values=values)


def _lone(value: FloatArray, usual: float, most: int) -> Iterator[int]:
    """Samples of an axis (N,) that stand alone, `most` together at most; usual : its steps."""
    step, limit = np.diff(value), _UNUSUAL * usual
    size = np.abs(step)
    edges: IntArray = np.flatnonzero(size > limit)
    quiet = np.delete(size, edges)
    least = quiet.min(initial=np.inf, where=quiet > 0.0)
    if not np.isfinite(least):
        least = _EXACT * np.abs(value).max()
    last = -1
    for number, first in enumerate(edges.tolist()):
        for end in edges[number + 1 : number + 1 + most].tolist():
            if first < last or end - first > most:
                break
            near = size[max(first - _NEAR, 0) : first], size[end + 1 : end + 1 + _NEAR]
            across = abs(value[end + 1] - value[first])
            around = max(near[0].max(initial=0.0), near[1].max(initial=0.0), across, least)
            if step[first] * step[end] < 0 and min(size[first], size[end]) > _FAR * around:
                yield from range(first + 1, end + 1)
                last = end


Reading = Callable[[], "Iterator[Log]"]
"""Reads a recorder's files from the begin."""
#: Share of the longer recording that both hold, below which a part seems lost.
_COMPLETE = 0.9


def files_by_recorder(
    paths: Sequence[Path], recorders: Sequence[LogBlock]
) -> list[tuple[LogBlock | None, list[Path]]]:
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


def on_one_clock(sources: Sequence[tuple[str, ClockPrior, Reading]]) -> Iterator[Log]:
    """Merge the recorders' pieces on the clock of the first; raises as `find_clocks`.

    sources : name, what is stated of its clock, and what reads it, twice: for the clocks and for
    what it holds.
    """
    from tdfscal.clocks import find_clocks  # of several alone
    from tdfscal.clocks.tracks import Reduction

    tracks: list[Tracks] = []
    warm = 0  # temperatures of one recorder are those of the log
    for *_, pieces in sources:
        reduction = Reduction()
        for piece in pieces():
            pairs = zip(piece.position, piece.force, strict=True)
            reduction.add([series for pair in pairs for series in pair])
            warm = max(warm, len(piece.temperature))
        tracks.append(reduction.finish())
    first, *others = tracks
    stated = zip(others, sources[1:], strict=True)
    clocks = find_clocks(first, [(name, own, clock) for own, (name, clock, _) in stated])
    found: list[Finding] = []
    for own, clock in zip(others, clocks, strict=True):
        found += _overlap(first, own, clock)
    feeds = [
        _on_clock(pieces(), clock)
        for (*_, pieces), clock in zip(sources, (None, *clocks), strict=True)
    ]
    for number, piece in enumerate(_in_order(feeds)):
        if not piece.temperature:
            piece = replace(piece, temperature=(_NOTHING,) * warm)
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
        times = {id(s.time): clock.to_first(s.time) for s in piece.streams}
        yield piece.with_streams(Series(times[id(s.time)], s.value) for s in piece.streams)


def _in_order(feeds: Sequence[Iterator[Log]]) -> Iterator[Log]:
    """Pieces of all recorders in the order of their times."""
    reached = [-np.inf] * len(feeds)
    while min(reached) < np.inf:
        k = int(np.argmin(reached))
        piece = next(feeds[k], None)
        if piece is None:
            reached[k] = np.inf
            continue
        ends = [float(s.time[-1]) for s in piece.streams if s.time.size]
        reached[k] = max([reached[k], *ends])
        yield piece
