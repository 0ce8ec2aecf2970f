"""Everything that can be said of some logs before anything is calibrated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from glob import escape
from itertools import product, takewhile
from pathlib import Path
from typing import Literal

import numpy as np

from tdfscal.catalogue import told
from tdfscal.dwells import (
    Bins,
    dwells_of_bins,
    find_dwells,
    misaligned,
    motion_offset,
    reduce_to_bins,
    with_offset,
)
from tdfscal.dwells.find import no_dwell
from tdfscal.errors import DataError, TdfscalError, UsageError
from tdfscal.files.rig.draft import log_lines
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.rig.recorders import LogBlock, LogTime
from tdfscal.files.saving import in_utf8
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.logs.clock import Clock
from tdfscal.logs.contents import Contents
from tdfscal.logs.formats import expand, open_log, owns
from tdfscal.logs.mapping_guess import Guess, guess_recorders
from tdfscal.logs.reader import TimeWindow, iter_log
from tdfscal.numerics.streams import Line
from tdfscal.records import Dwells, FloatArray, InputFile, Log, RecorderClock

Source = Literal["rig", "guessed"]
_SAMPLED = 400  # instants that stand for a log without dwells
_DEPARTURE = 1.0  # s; header times that leave their usual distance to the log's by more are none


@record
class Signal:
    """One vector signal as it is read with the mapping.

    fields : in the file. count : samples. start, end : s, None without any. rate : Hz, None below
    two samples. gaps : intervals of more than five periods. longest_interval : s.
    """

    support: str
    quantity: str
    fields: tuple[str, ...]
    count: int
    start: float | None
    end: float | None
    rate: float | None
    gaps: int
    longest_interval: float


@record
class LogInfo:
    """What is in some logs.

    recorders : with which the signals were read: the rig's, or the guess. problems : what keeps the
    logs from being used, or wants a look. clocks : of all recorders but the first. samples :
    positions in m and forces in N, (K, n, 3), of instants over the log; None where it was not read.
    offset : between forces and positions; lag : said instead where it is one of seconds.
    """

    contents: tuple[Contents, ...]
    guess: Guess
    recorders: tuple[LogBlock, ...]
    source: Source
    signals: tuple[Signal, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    dwells: Dwells | None = None
    offset: Line | None = None
    lag: Finding | None = None
    problems: tuple[str, ...] = ()
    clocks: tuple[RecorderClock, ...] = ()
    samples: tuple[FloatArray, FloatArray] | None = None


def describe_logs(
    paths: Sequence[Path],
    rig: LoadedRig | None = None,
    *,
    window: TimeWindow | None = None,
) -> LogInfo:
    """Look through logs, guess their mapping, and read them with it: clocks, dwells.

    rig : names the supports; its log block is used where it has one. window : the part whose clocks
    and dwells are looked at.

    Raises UsageError where a path is not there or is no log, DataError where a file cannot be read
    at all. What can be looked at but not used is no error: `problems` says what is wrong.
    """
    contents = {path: open_log(path).contents() for path in expand(paths)}
    if not contents:
        raise UsageError("there is no log to look at", hint="name a CSV, Parquet or MCAP file")
    guess = guess_recorders(_layouts(paths, contents), rig.rig if rig else None)
    recorders = guess.recorders
    source: Source = "guessed"
    if rig is not None and (rig.log or not recorders):
        recorders, source = rig.log or (LogBlock(),), "rig"
    info = LogInfo(tuple(contents.values()), guess, recorders, source)
    problems = [f"{own.path}: {what}" for own in info.contents for what in own.problems]
    problems += [f"{info.contents[0].path}: {what}" for what in guess.problems]
    if not recorders:
        return _with_problems(info, [*problems, *guess.notes])
    supports = rig.rig.supports if rig and source == "rig" else guess.supports
    logs = [path for path in paths if any(owns(recorder, path) for recorder in recorders)]
    used = _Used(info, supports)
    used.read(logs, window)
    if source == "guessed" and (why := used.doubted_stamps):
        by_log_time = {"time": LogTime(source="log")}
        alike = tuple(recorder.model_copy(update=by_log_time) for recorder in recorders)
        note = f"time source: log, as header times cannot be used: {why}"
        by_log = replace(guess, recorders=alike, notes=(*guess.notes, note))
        other = _Used(replace(info, recorders=alike, guess=by_log), supports)
        other.read(logs, window)
        used = used if other.error else other
    return _with_problems(used.found(), [*problems, *used.problems])


def _with_problems(info: LogInfo, problems: list[str]) -> LogInfo:
    return replace(info, problems=tuple(dict.fromkeys(map(in_utf8, problems))))


class _Used:
    """Logs as they are read with some recorders, and what they say while they pass.

    error : why they cannot be read to their end. problems : that, and what else wants a look.
    """

    def __init__(self, info: LogInfo, supports: Sequence[str]) -> None:
        self._info, self._supports = info, supports
        # Of the positions, then the forces.
        self._clocks = [Clock(name, "timeseries") for name in (*supports, *supports)]
        self._inputs: list[InputFile] = []
        self._recorders: list[RecorderClock] = []
        self._findings: list[Finding] = []
        self.problems: list[str] = []
        self.error: TdfscalError | None = None

    def read(self, logs: Sequence[Path], window: TimeWindow | None) -> None:
        """Read the logs, to their dwells."""
        recorders, bins, lag, offset = self._info.recorders, None, None, None
        pieces = self._passing(iter_log(logs, recorders, self._supports, window=window))
        try:
            if recorders[0].rows == "postures":
                dwells = find_dwells(pieces)
            else:
                bins = reduce_to_bins(pieces)
                found = dwells_of_bins(bins)
                offset = motion_offset(bins, found)
                lag = misaligned(bins, found, offset)
                dwells = with_offset(found, offset)
        except TdfscalError as error:
            self.problems, self.error = [*map(told, self._findings), str(error)], error
            return
        self.problems = list(map(told, [*self._findings, *dwells.findings, *filter(None, [lag])]))
        if not len(dwells) and lag is None:
            absence = no_dwell(dwells)
            self.problems.append(f"{absence.what}; {absence.hint}")
        self._info = replace(
            self._info,
            inputs=tuple(self._inputs),
            dwells=dwells,
            lag=lag,
            offset=offset if lag is None else None,
            samples=_sampled(bins) if bins else None,
        )

    @property
    def doubted_stamps(self) -> str | None:
        """Why the messages' header times may be none, where they were taken."""
        if all(recorder.time.source != "header" for recorder in self._info.recorders):
            return None
        if isinstance(self.error, DataError):
            return self.error.what
        gone = [f for f in self._findings if f.code == "header-clock-departs"]
        return next((told(f) for f in gone if (f.size or 0.0) > _DEPARTURE), None)

    def found(self) -> LogInfo:
        """What was seen."""
        return replace(self._info, signals=self._signals(), clocks=tuple(self._recorders))

    def _passing(self, pieces: Iterator[Log]) -> Iterator[Log]:
        """The pieces, looked at on their way."""
        for piece in pieces:
            for clock, series in zip(self._clocks, (*piece.position, *piece.force), strict=True):
                clock.ascending(series.time)
            self._inputs.extend(piece.inputs)
            self._recorders.extend(piece.clocks)
            self._findings.extend(piece.findings)
            yield piece

    def _signals(self) -> tuple[Signal, ...]:
        """What the clocks have counted; none where none has."""
        recorders, found = self._info.recorders, []
        each = product(("position", "force"), self._supports)
        for clock, (quantity, name) in zip(self._clocks, each, strict=True):
            named = (getattr(recorder.support_fields(name), quantity) for recorder in recorders)
            fields, (_, gaps) = next(filter(None, named), ()), clock.intervals()
            start, end = clock.span or (None, None)
            span = (end or 0.0) - (start or 0.0)
            rate = (clock.count - 1) / span if span > 0 else None
            last = (rate, gaps, clock.longest[0])
            found.append(Signal(name, quantity, fields, clock.count, start, end, *last))
        return tuple(found) if any(clock.count for clock in self._clocks) else ()


def _sampled(bins: Bins) -> tuple[FloatArray, FloatArray] | None:
    """Positions in m and forces in N on the terminal, (K, n, 3), of instants over the log."""
    n = len(bins.supports)
    whole = np.flatnonzero((bins.count > 0).all(axis=1))
    if not len(whole):
        return None
    some = whole[np.linspace(0, len(whole) - 1, min(len(whole), _SAMPLED)).astype(int)]
    return bins.mean[some, :n], bins.mean[some, n:]


def _layouts(paths: Sequence[Path], contents: Mapping[Path, Contents]) -> dict[str, Contents]:
    """One file of each layout of fields, by the pattern of the names that have it."""
    names: dict[tuple[object, ...], list[str]] = {}
    first: dict[tuple[object, ...], Contents] = {}
    for path in paths:
        for file in expand([path]):
            own = contents[file]
            layout = (own.by_topic, *(f.name for stream in own.streams for f in stream.fields))
            first.setdefault(layout, own)
            names.setdefault(layout, [])
            if path.name not in names[layout]:
                names[layout].append(path.name)
    return {_pattern(own): first[layout] for layout, own in names.items()}


def _pattern(names: Sequence[str]) -> str:
    """A pattern that the names fit."""
    if len(names) == 1:
        return escape(names[0])
    begin = _common(names)
    end = _common([name[len(begin) :][::-1] for name in names])[::-1]
    return f"{escape(begin)}*{escape(end)}"


def _common(names: Sequence[str]) -> str:
    """What all names begin with."""
    letters = takewhile(lambda own: len(set(own)) == 1, zip(*names, strict=False))
    return "".join(own[0] for own in letters)


def mapping_block(info: LogInfo) -> str:
    """The guessed block as YAML, ready to paste into rig.yaml."""
    return "\n".join(log_lines(info.guess.recorders)) + "\n"
