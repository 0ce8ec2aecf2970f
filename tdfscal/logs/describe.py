"""Everything that can be said of some logs before anything is calibrated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Literal

from tdfscal.catalogue import told
from tdfscal.dwells import (
    dwells_of_bins,
    find_dwells,
    motion_offset,
    no_dwell,
    reduce_to_bins,
)
from tdfscal.errors import DataError, TdfscalError
from tdfscal.files.hashing import printable
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.logs.common.clock import Clock
from tdfscal.logs.common.contents import Contents
from tdfscal.logs.common.window import TimeWindow
from tdfscal.logs.description.info import LogInfo, Signal, Source
from tdfscal.logs.description.mapping_guess import Guess, guess_mapping
from tdfscal.logs.description.plausible_units import declared_time
from tdfscal.logs.formats import contents_of, expand
from tdfscal.logs.reader import iter_log
from tdfscal.records import InputFile, Log, LogMapping


def describe_logs(
    paths: Sequence[Path],
    rig: LoadedRig | None = None,
    *,
    window: TimeWindow | None = None,
    progress: Callable[[float], None] | None = None,
) -> LogInfo:
    """Read logs once: contents, a guessed mapping, clocks, dwells.

    The mapping is guessed from the first file's opening, and again from all that was seen; where
    that differs, the logs are read again.

    rig : names the supports; its log block is used where it has one. window : the part whose clocks
    and dwells are looked at. progress : told the share that is read, from 0 to 1.

    Raises UsageError where a path is not there or is no log, DataError where a file cannot be read
    at all. What can be looked at but not used is no error: `problems` says what is wrong.
    """
    files = expand(paths)
    if not files:
        raise DataError("there is no log to look at", hint="name a CSV, Parquet or MCAP file")
    known = rig.rig if rig else None
    opening = contents_of(files[0], opening=True)
    seen = {files[0]: opening} if opening.format == "parquet" else {}

    def read(guess: Guess) -> LogInfo:
        return _read(paths, guess, rig, window, progress, seen)

    info = read(guess_mapping(opening, known))
    # What the reading has not seen to its end is looked through now.
    contents = tuple(seen[path] if path in seen else contents_of(path) for path in files)
    guess = guess_mapping(contents[0], known)
    if _mapping(guess, rig)[0] != info.mapping:
        # Where a damaged line is why nothing is guessed any more, the first reading has named it.
        damaged = () if info.inputs else info.problems
        info = read(guess)
        if info.mapping is None:
            info = replace(info, problems=damaged)
    problems = [f"{c.path}: {what}" for c in contents for what in c.problems]
    problems += [f"{contents[0].path}: {what}" for what in guess.problems]
    if info.mapping is not None and info.source == "rig":
        mapping = info.mapping
        problems += [f"{c.path}: {what}" for c in contents for what in declared_time(c, mapping)]
    problems += info.problems
    if info.mapping is None:
        problems += guess.notes
    unique = tuple(dict.fromkeys(map(printable, problems)))
    return replace(info, contents=contents, guess=guess, problems=unique)


def _mapping(guess: Guess, rig: LoadedRig | None) -> tuple[LogMapping | None, Source]:
    """What the logs are read with: the rig's own, or the guess."""
    if rig is not None and (rig.log or guess.mapping is None):
        return (rig.log or (LogMapping.default(rig.rig.supports),))[0], "rig"
    return guess.mapping, "guessed"


def _read(
    paths: Sequence[Path],
    guess: Guess,
    rig: LoadedRig | None,
    window: TimeWindow | None,
    progress: Callable[[float], None] | None,
    seen: dict[Path, Contents],
) -> LogInfo:
    """Read the logs once, to their dwells; seen : takes what else is in them."""
    mapping, source = _mapping(guess, rig)
    if mapping is None:
        return LogInfo((), guess, None, source)
    supports = rig.rig.supports if rig is not None and source == "rig" else mapping.supports
    clocks = [Clock(name, "timeseries") for name in (*supports, *supports)]
    inputs: list[InputFile] = []
    problems: list[str] = []
    dwells, offset = None, None

    def passing(pieces: Iterator[Log]) -> Iterator[Log]:
        for piece in pieces:
            for clock, series in zip(clocks, (*piece.position, *piece.force), strict=True):
                clock.ascending(series.time)
            inputs.extend(piece.inputs)
            problems.extend(map(told, piece.findings))
            yield piece

    try:
        log = iter_log(paths, mapping, supports, window=window, progress=progress, seen=seen)
        if mapping.rows == "postures":
            dwells = find_dwells(passing(log))
        else:
            bins = reduce_to_bins(passing(log))
            dwells = dwells_of_bins(bins)
            offset = motion_offset(bins, dwells)
        problems += map(told, dwells.findings)
        if not len(dwells):
            absence = no_dwell(dwells)
            problems.append(f"{absence.what}; {absence.hint}")
    except TdfscalError as error:
        problems.append(str(error))
        dwells = None
        inputs.clear()
    signals = _signals(clocks, mapping, supports)
    return LogInfo(
        (), guess, mapping, source, signals, tuple(inputs), dwells, offset, tuple(problems)
    )


def _signals(
    clocks: Sequence[Clock], mapping: LogMapping, supports: Sequence[str]
) -> tuple[Signal, ...]:
    """What the clocks of the positions, then the forces, have counted; none where none has."""
    kinds: tuple[Literal["position", "force"], ...] = ("position", "force")
    result = []
    for clock, (quantity, name) in zip(clocks, product(kinds, supports), strict=True):
        fields = mapping.position if quantity == "position" else mapping.force
        own = fields[mapping.supports.index(name)]
        start, end = clock.span or (None, None)
        rate = None
        if start is not None and end is not None and end > start:
            rate = (clock.count - 1) / (end - start)
        longest, _ = clock.longest
        result.append(
            Signal(name, quantity, own, clock.count, start, end, rate, clock.gaps, longest)
        )
    return tuple(result) if any(clock.count for clock in clocks) else ()
