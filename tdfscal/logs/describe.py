"""Everything that can be said of some logs before anything is calibrated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
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
from tdfscal.logs.description.mapping_guess import Guess, guess_recorders
from tdfscal.logs.description.plausible_units import declared_time
from tdfscal.logs.formats import contents_of, expand
from tdfscal.logs.reader import iter_log
from tdfscal.logs.recorders import owns
from tdfscal.records import FloatArray, InputFile, Log, LogMapping, RecorderClock

#: Instants that stand for a log without dwells.
_SAMPLED = 400


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
    openings = {path: contents_of(path, opening=True) for path in files}
    seen = {path: opening for path, opening in openings.items() if opening.format == "parquet"}

    def read(guess: Guess) -> LogInfo:
        return _read(paths, guess, rig, window, progress, seen)

    info = read(guess_recorders(_layouts(paths, openings), known))
    # What the reading has not seen to its end is looked through now.
    looked = {path: seen[path] if path in seen else contents_of(path) for path in files}
    contents = tuple(looked.values())
    guess = guess_recorders(_layouts(paths, looked), known)
    if _mappings(guess, rig)[0] != info.recorders:
        # Where a damaged line is why nothing is guessed any more, the first reading has named it.
        damaged = () if info.inputs else info.problems
        info = read(guess)
        if info.mapping is None:
            info = replace(info, problems=damaged)
    problems = [f"{c.path}: {what}" for c in contents for what in c.problems]
    problems += [f"{contents[0].path}: {what}" for what in guess.problems]
    if info.source == "rig":
        problems += [
            f"{c.path}: {what}"
            for c in contents
            for mapping in info.recorders
            if owns(mapping, c.path)
            for what in declared_time(c, mapping)
        ]
    problems += info.problems
    if info.mapping is None:
        problems += guess.notes
    unique = tuple(dict.fromkeys(map(printable, problems)))
    return replace(info, contents=contents, guess=guess, problems=unique)


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


def _mappings(guess: Guess, rig: LoadedRig | None) -> tuple[tuple[LogMapping, ...], Source]:
    """What the logs are read with: the rig's own, or the guess."""
    if rig is not None and (rig.log or guess.mapping is None):
        return rig.log or (LogMapping.default(rig.rig.supports),), "rig"
    return guess.recorders, "guessed"


def _read(
    paths: Sequence[Path],
    guess: Guess,
    rig: LoadedRig | None,
    window: TimeWindow | None,
    progress: Callable[[float], None] | None,
    seen: dict[Path, Contents],
) -> LogInfo:
    """Read the logs once, to their dwells; seen : takes what else is in them."""
    recorders, source = _mappings(guess, rig)
    if not recorders:
        return LogInfo((), guess, (), source)
    paths = [path for path in paths if any(owns(recorder, path) for recorder in recorders)]
    supports = rig.rig.supports if rig is not None and source == "rig" else recorders[0].supports
    found: list[RecorderClock] = []
    samples = None
    clocks = [Clock(name, "timeseries") for name in (*supports, *supports)]
    inputs: list[InputFile] = []
    problems: list[str] = []
    dwells, offset = None, None

    def passing(pieces: Iterator[Log]) -> Iterator[Log]:
        for piece in pieces:
            for clock, series in zip(clocks, (*piece.position, *piece.force), strict=True):
                clock.ascending(series.time)
            inputs.extend(piece.inputs)
            found.extend(piece.clocks)
            problems.extend(map(told, piece.findings))
            yield piece

    try:
        log = iter_log(paths, recorders, supports, window=window, progress=progress, seen=seen)
        if recorders[0].rows == "postures":
            dwells = find_dwells(passing(log))
        else:
            bins = reduce_to_bins(passing(log))
            samples = _sampled(bins)
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
    return LogInfo(
        (),
        guess,
        recorders,
        source,
        _signals(clocks, recorders, supports),
        tuple(inputs),
        dwells,
        offset,
        tuple(problems),
        tuple(found),
        samples,
    )


def _sampled(bins: Bins) -> tuple[FloatArray, FloatArray] | None:
    """Positions in m and forces in N on the terminal, (K, n, 3), of instants over the log."""
    n = len(bins.supports)
    whole = np.flatnonzero((bins.count > 0).all(axis=1))
    if not len(whole):
        return None
    some = whole[np.linspace(0, len(whole) - 1, min(len(whole), _SAMPLED)).astype(int)]
    return bins.mean[some, :n], bins.mean[some, n:]


def _signals(
    clocks: Sequence[Clock], recorders: Sequence[LogMapping], supports: Sequence[str]
) -> tuple[Signal, ...]:
    """What the clocks of the positions, then the forces, have counted; none where none has."""
    kinds: tuple[Literal["position", "force"], ...] = ("position", "force")
    result = []
    for clock, (quantity, name) in zip(clocks, product(kinds, supports), strict=True):
        index = recorders[0].supports.index(name)
        named = [(r.position if quantity == "position" else r.force)[index] for r in recorders]
        start, end = clock.span or (None, None)
        rate = None
        if start is not None and end is not None and end > start:
            rate = (clock.count - 1) / (end - start)
        longest, _ = clock.longest
        result.append(
            Signal(name, quantity, next(filter(None, named), ()), clock.count, start, end, rate,
                   clock.gaps, longest)
        )  # fmt: skip
    return tuple(result) if any(clock.count for clock in clocks) else ()
