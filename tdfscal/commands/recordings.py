"""When data were recorded, and that each recording counts once.

Copies, exports in two formats, the same hours under two names are one recording.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import combinations

import numpy as np

from tdfscal.checks.repeated_samples import RepeatedSamples
from tdfscal.commands.log_pass import LogPass
from tdfscal.errors import DataError, RigError, UsageError
from tdfscal.records import Dwells, InputFile, Measured, Rig

#: A log whose times lie between 1990 and 2100 has a wall clock; others count from some start, s.
_WALL_CLOCK = (631152000.0, 4102444800.0)
_DAY = 86400.0
#: Mean forces of two recordings differ by more than this share of their standard uncertainty in
#: one of nine channels or more; chance alone would bring them as near once in 10¹⁵ dwells.
_SAME = 0.02


def measured(log: LogPass) -> Measured:
    """Tell when a campaign was recorded: by the log's clock, the rig file, or the file's date.

    Raises DataError, RigError where the log's clock, or the rig file's date, lies in the future.
    """
    if by_wall_clock(log.begin, log.end):
        found = Measured(log.begin, log.end, "log")
        if found.end > time.time() + _DAY:
            raise DataError(
                f"the log's clock says {day(found.end)}, which is in the future",
                where=", ".join(map(str, log.campaign.logs)),
                hint="set the recorder's clock; or let its time count from 0, and state "
                "campaign.date in rig.yaml",
            )
        return found
    for clock in log.clocks:  # where the first recorder's is none
        begin, end = log.begin + clock.offset, log.end + clock.offset
        if by_wall_clock(begin, end) and end < time.time() + _DAY:
            return Measured(begin, end, "log")
    rig, date = log.campaign.rig, log.rig.campaign.date
    if date is not None:
        found = stated_date(date)
        if found.begin > time.time() + _DAY:
            raise RigError(
                f"the campaign's date, {date}, is in the future",
                where=f"{rig.path}: campaign.date",
                hint="write the day on which the log was recorded",
            )
        return found
    times = [path.stat().st_mtime for path in log.campaign.logs or (rig.path,)]
    return Measured(min(times), max(times), "file")


def by_wall_clock(*times: float) -> bool:
    """Tell whether a log's times, s, are those of a wall clock."""
    return all(_WALL_CLOCK[0] <= time <= _WALL_CLOCK[1] for time in times)


def stated_date(date: str) -> Measured:
    """Tell when a campaign was recorded by the date in its rig file."""
    begin = datetime.fromisoformat(date)
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    end = begin + timedelta(days=1, seconds=-1) if len(date) == len("2026-01-01") else begin
    return Measured(begin.timestamp(), end.timestamp(), "rig")


def day(moment: float) -> str:
    """Return the date of a moment in s since 1970."""
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"


@dataclass(frozen=True, slots=True)
class Recording:
    """What tells one recording from another. dwells, samples : None where not at hand."""

    name: str
    inputs: Sequence[InputFile]
    measured: Measured | None
    rig: Rig | None = None
    dwells: Dwells | None = None
    samples: RepeatedSamples | None = None


def refuse_repeated(recordings: Sequence[Recording]) -> None:
    """Raise UsageError where two campaigns hold the same recording."""
    for first, second in combinations(recordings, 2):
        common = {e.sha256 for e in first.inputs} & {e.sha256 for e in second.inputs}
        what = next((e.path for e in second.inputs if e.sha256 in common), None)
        if what is None and _at_one_time(first.measured, second.measured):
            what = "their clocks say so, for no rig is recorded twice at a time"
        if what is None and _alike(first, second):
            what = "the mean forces of their dwells agree far below their uncertainty"
        if what is None and _copied(first, second):
            what = "the readings of every sensor are the same, noise included"
        if what is not None:
            raise UsageError(
                f"holds the same recording as {first.name}: {what}",
                where=second.name,
                hint="name each recording once; twice the same data are no more data",
            )


def _at_one_time(a: Measured | None, b: Measured | None) -> bool:
    """Whether two wall clocks ran at the same time, for longer than they may be set apart."""
    if a is None or b is None or not a.source == b.source == "log":
        return False
    together = min(a.end, b.end) - max(a.begin, b.begin)
    return together > 0.5 * min(a.end - a.begin, b.end - b.begin)


def _alike(a: Recording, b: Recording) -> bool:
    """Whether half of the dwells of the shorter one, or more, are also the other's."""
    if a.dwells is None or b.dwells is None or a.rig is None:
        return False
    few, many = sorted((a.dwells, b.dwells), key=len)
    if not len(few) or few.force.shape[1:] != many.force.shape[1:]:
        return False
    variance = np.diagonal(few.force_cov, axis1=-2, axis2=-1) + a.rig.declared.force_noise**2
    within = _SAME * np.sqrt(variance)
    same = sum(
        bool((np.abs(many.force - force) <= limit).all(axis=(1, 2)).any())
        for force, limit in zip(few.force, within, strict=True)
    )
    return 2 * same >= len(few)


def _copied(a: Recording, b: Recording) -> bool:
    """Whether samples of every sensor that measures are in both."""
    if a.samples is None or b.samples is None or a.rig is None or b.rig is None:
        return False
    if a.rig.supports != b.rig.supports:
        return False
    copied = {repeat.sensor for repeat in a.samples.shared(b.samples)}
    return copied >= set(np.flatnonzero(a.rig.axes.any(axis=1)).tolist())
