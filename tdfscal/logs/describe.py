"""Everything that can be said of some logs before anything is calibrated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from tdfscal.dwells import (
    Offset,
    dwells_of_bins,
    find_dwells,
    motion_offset,
    no_dwell,
    reduce_to_bins,
)
from tdfscal.errors import DataError, TdfscalError
from tdfscal.files.hashing import printable
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.logs.common.clock import GAP
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.window import TimeWindow
from tdfscal.logs.description.info import LogInfo, Signal, Source
from tdfscal.logs.description.mapping_guess import Guess, guess_mapping
from tdfscal.logs.description.plausible_units import declared_time
from tdfscal.logs.formats import contents_of, expand
from tdfscal.logs.reader import iter_log
from tdfscal.records import Dwells, InputFile, Log, LogMapping, Series


def describe_logs(
    paths: Sequence[Path],
    rig: LoadedRig | None = None,
    *,
    window: TimeWindow | None = None,
    progress: Callable[[float], None] | None = None,
) -> LogInfo:
    """Look through logs: contents, a guessed mapping, clocks, dwells.

    Parameters
    ----------
    paths : CSV, Parquet, MCAP files or rosbag2 folders; several are one campaign.
    rig : names the supports; its log block is used where it has one.
    window : the part of the logs whose clocks and dwells are looked at.
    progress : told the share that is read, from 0 to 1.

    Raises
    ------
    UsageError : a path is not there or is no log.
    DataError : a file cannot be read at all. What can be looked at but not used is no error here:
        `problems` says what is wrong.
    """
    files = expand(paths)
    if not files:
        raise DataError("there is no log to look at", hint="name a CSV, Parquet or MCAP file")
    opening = contents_of(files[0], opening=True)
    seen = {files[0]: opening} if opening.format == "parquet" else {}

    def read(guess: Guess) -> _Reading:
        return _read(paths, _mapping(guess, rig), window, progress, seen)

    guess = guess_mapping(opening, rig.rig if rig else None)
    reading = read(guess)
    # What the reading has not seen to its end is looked through now.
    contents = tuple(seen[path] if path in seen else contents_of(path) for path in files)
    whole = guess_mapping(contents[0], rig.rig if rig else None)
    if _mapping(whole, rig) != _mapping(guess, rig):
        reading = read(whole)
    mapping, _ = _mapping(whole, rig)
    source: Source = "guessed" if mapping is whole.mapping else "rig"
    problems = [f"{c.path}: {what}" for c in contents for what in c.problems]
    problems += [f"{contents[0].path}: {what}" for what in whole.problems]
    if mapping is not None and source == "rig":
        problems += [f"{c.path}: {what}" for c in contents for what in declared_time(c, mapping)]
    problems += reading.problems if mapping is not None else whole.notes
    return LogInfo(
        contents,
        whole,
        mapping,
        source,
        reading.signals,
        reading.inputs,
        reading.dwells,
        reading.offset,
        tuple(dict.fromkeys(map(printable, problems))),
    )


def _mapping(guess: Guess, rig: LoadedRig | None) -> tuple[LogMapping | None, tuple[str, ...]]:
    """What the logs are read with: the rig's own, or the guess; and the supports."""
    if rig is not None and (rig.log is not None or guess.mapping is None):
        return rig.log or LogMapping.default(rig.rig.supports), rig.rig.supports
    return guess.mapping, guess.mapping.supports if guess.mapping else ()


@dataclass(frozen=True, slots=True)
class _Reading:
    """What one reading of all logs has shown; without inputs and dwells where it failed."""

    problems: tuple[str, ...] = ()
    signals: tuple[Signal, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    dwells: Dwells | None = None
    offset: Offset | None = None


def _read(
    paths: Sequence[Path],
    read_with: tuple[LogMapping | None, tuple[str, ...]],
    window: TimeWindow | None,
    progress: Callable[[float], None] | None,
    seen: dict[Path, Contents],
) -> _Reading:
    """Read the logs once, to their dwells; seen : takes what else is in them."""
    mapping, supports = read_with
    if mapping is None:
        return _Reading()
    watch = _Watch(mapping, supports)
    offset = None
    try:
        log = iter_log(paths, mapping, supports, window=window, progress=progress, seen=seen)
        if mapping.rows == "postures":
            dwells = find_dwells(watch.passing(log))
        else:
            bins = reduce_to_bins(watch.passing(log))
            dwells = dwells_of_bins(bins)
            offset = motion_offset(bins, dwells)
    except TdfscalError as error:
        return _Reading((*watch.warnings, str(error)), watch.signals())
    problems = [*watch.warnings, *dwells.warnings]
    if not len(dwells):
        absence = no_dwell(dwells)
        problems.append(f"{absence.what}; {absence.hint}")
    return _Reading(tuple(problems), watch.signals(), tuple(watch.inputs), dwells, offset)


@dataclass(slots=True)
class _Pace:
    """Times of one stream, piece by piece."""

    count: int = 0
    start: float | None = None
    end: float | None = None
    period: float | None = None
    gaps: int = 0
    longest: float = 0.0

    def note(self, series: Series) -> None:
        time = series.time
        if not time.size:
            return
        step = np.diff(time, prepend=self.end) if self.end is not None else np.diff(time)
        if step.size:
            if self.period is None:
                self.period = float(np.median(step))
            self.gaps += int((step > GAP * self.period).sum())
            self.longest = max(self.longest, float(step.max()))
        if self.start is None:
            self.start = float(time[0])
        self.end = float(time[-1])
        self.count += time.size


@dataclass(slots=True)
class _Watch:
    """Lets pieces pass and notes their clocks."""

    mapping: LogMapping
    supports: tuple[str, ...]
    inputs: list[InputFile] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    paces: list[_Pace] = field(default_factory=list)

    def passing(self, pieces: Iterator[Log]) -> Iterator[Log]:
        for piece in pieces:
            streams = (*piece.position, *piece.force)
            self.paces = self.paces or [_Pace() for _ in streams]
            for pace, series in zip(self.paces, streams, strict=True):
                pace.note(series)
            self.inputs += piece.inputs
            self.warnings += piece.warnings
            yield piece

    def signals(self) -> tuple[Signal, ...]:
        result = []
        n = len(self.supports)
        for k, pace in enumerate(self.paces):
            name = self.supports[k % n]
            index = self.mapping.supports.index(name)
            quantity: Literal["position", "force"] = "position" if k < n else "force"
            fields = self.mapping.position if k < n else self.mapping.force
            span = 0.0 if pace.start is None or pace.end is None else pace.end - pace.start
            rate = (pace.count - 1) / span if span > 0 else None
            result.append(
                Signal(
                    name, quantity, fields[index], pace.count, pace.start, pace.end, rate,
                    pace.gaps, pace.longest,
                )
            )  # fmt: skip
        return tuple(result)
