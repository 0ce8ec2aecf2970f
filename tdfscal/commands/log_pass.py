"""A campaign's log as it passes: what it says of itself and of its files, when it was recorded.

And the same recording in two campaigns: told by its files, its hours, its dwells or its samples.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import combinations

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.catalogue.entry import by_wall_clock
from tdfscal.catalogue.inputs import STOPS
from tdfscal.commands.arguments import SILENT, Progress
from tdfscal.commands.campaign import Campaign
from tdfscal.comparison.shared_data import Readings, repeated
from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, RigError, UsageError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.logs import TimeWindow, iter_log
from tdfscal.records import Dwells, FloatArray, InputFile, Log, Measured, RecorderClock, Rig

#: Warnings of a log that an error repeats at most; those of its clocks come first.
_REPEATED = 3
_CLOCK = (
    "samples-not-ascending",
    "header-clock-off",
    "header-clock-departs",
    "clocks-run-apart",
    "clocks-apart",
)
#: Stops left out per dwell found, from which an error says so.
_LOST = 2
#: A reading this close to its capacity, relative, stands at it.
_AT_CAPACITY = 1e-6
_DAY = 86400.0
_MONTH_IN_NAME, _MONTH = re.compile(r"(?<!\d)(20\d\d)-?(0[1-9]|1[0-2])-?[0-3]\d(?!\d)"), 31 * _DAY


@record
class Settings:
    """What holds for every campaign of a command.

    window : the part of the logs that is used. trials : Monte Carlo trials at most; None for the
    default, 0 for none. command : kept in the file, as what was asked for.
    """

    progress: Progress = SILENT
    window: TimeWindow | None = None
    trials: int | None = None
    seed: int = 0
    command: str = ""

    def __post_init__(self) -> None:
        if self.trials == 1:
            raise UsageError(
                "one trial has no spread", where="--trials", hint="give 0, or 2 or more"
            )


@dataclass(slots=True)
class LogPass:
    """What one reading of a campaign's logs leaves behind.

    inputs : files that were read; ends : s, the log's last time up to each. messages : what the
    logs say of themselves, each once. stops : what became of most of them, where few are dwells.
    begin, end : s, from when to when all signals were recorded, by the first recorder's clock.
    clocks : of the other recorders.
    """

    campaign: Campaign
    settings: Settings
    inputs: list[InputFile] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    messages: list[Finding] = field(default_factory=list)
    begin: float = float("inf")
    end: float = float("-inf")
    stops: Finding | None = None
    clocks: tuple[RecorderClock, ...] = ()
    rig: Rig = field(init=False)
    progress: Progress = field(init=False)

    def __post_init__(self) -> None:
        self.rig, self.progress = self.campaign.rig.rig, self.settings.progress

    def pieces(self) -> Iterator[Log]:
        """Read the logs once, piece by piece. Raises UsageError, DataError."""
        logs, rig = self.campaign.logs, self.rig
        first, last = dict[int, float](), dict[int, float]()
        with self.progress.reading(logs) as share:
            for piece in iter_log(
                logs,
                self.campaign.rig.log,
                rig.supports,
                axes=rig.axes,
                window=self.settings.window,
                progress=share,
            ):
                self.inputs += piece.inputs
                self.clocks += piece.clocks
                self._note(piece.findings)
                for number, series in enumerate((*piece.position, *piece.force)):
                    if len(series.time):
                        first.setdefault(number, float(series.time[0]))
                        last[number] = float(series.time[-1])
                self.begin = max(first.values(), default=self.begin)
                self.end = min(last.values(), default=self.end)
                self.ends += [max(last.values(), default=self.end)] * len(piece.inputs)
                yield piece

    def dwells(self) -> Dwells:
        """Read the logs and find the static dwells."""
        self.progress.stage("reading the log and finding the dwells")
        return self.noted(find_dwells(self.pieces()))

    def noted(self, dwells: Dwells) -> Dwells:
        """Keep what the dwells say of the log."""
        self._note(dwells.findings)
        self.stops = _lost_stops(dwells, self.rig)
        return dwells

    def files_at(self, times: FloatArray) -> list[InputFile]:
        """Return the files (T,) that hold these times, s of the log's clock."""
        return [self.inputs[k] for k in np.searchsorted(self.ends[:-1], times)]

    def _note(self, findings: Iterable[Finding]) -> None:
        self.messages += [finding for finding in findings if finding not in self.messages]

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Let an error say what the log's messages told before it."""
        try:
            yield
        except (DataError, NotIdentifiableError, NotConvergedError) as error:
            messages = sorted(self.messages, key=lambda finding: finding.code not in _CLOCK)
            found = [*([self.stops] if self.stops else []), *messages]
            what = "; ".join([error.what, *map(sentence, error.findings)])
            if not found and not error.findings:
                raise
            if not found:
                raise error.restated(what=what) from error
            rest = len(found) - _REPEATED
            more = f"; and {rest} more" if rest > 0 else ""
            look = f"look first at the log: {'; '.join(map(told, found[:_REPEATED]))}{more}"
            advice = f"{look}. {error.hint[0].upper()}{error.hint[1:]}" if error.hint else look
            raise error.restated(what=what, hint=advice) from error


def _lost_stops(dwells: Dwells, rig: Rig) -> Finding | None:
    """Say so where far more stops are left out than found, and why."""
    lost = len(dwells.left_out)
    if lost <= _LOST * len(dwells):
        return None
    reasons = Counter(piece.reason.code for piece in dwells.left_out)
    values: dict[str, Value] = {
        "stops": lost + len(dwells),
        "reason": STOPS[reasons.most_common(1)[0][0]],
    }
    if dwells.force_range is not None:
        full = np.abs(dwells.force_range).max(axis=0) >= rig.capacity * (1 - _AT_CAPACITY)
        for i, j in np.argwhere(full & np.isfinite(rig.capacity) & rig.axes):
            values |= {"axis": "xyz"[j], "capacity": float(rig.capacity[i, j])}
            return Finding("stops-over-capacity", (rig.supports[i],), lost, values=values)
    return Finding("stops-left-out", size=lost, values=values)


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
    surveyed = () if log.inputs or rig.tracker is None else rig.tracker.paths[1::2]
    times = [path.stat().st_mtime for path in surveyed or log.campaign.logs]
    return Measured(min(times), max(times), "file")


def misdated(log: LogPass) -> list[Finding]:
    """Say so where rig file and log's clock, or the log's name and its file, are of other days."""
    date, found = log.rig.campaign.date, measured(log)
    for path in log.campaign.logs if found.source == "file" else ():
        named = _MONTH_IN_NAME.search(path.name)
        if named and abs(stated_date(f"{named[1]}-{named[2]}-15").begin - found.begin) > 2 * _MONTH:
            named_on = {"date": f"{named[1]}-{named[2]}", "clock": day(found.begin)}
            return [Finding("log-misdated", (str(path),), values=named_on)]
    if date is None or found.source != "log":
        return []
    stated = stated_date(date)
    apart = max(stated.begin - found.end, found.begin - stated.end)
    values: dict[str, Value] = {"date": date, "clock": day(found.begin)}
    where = str(log.campaign.rig.path)
    return [Finding("campaign-misdated", (where,), values=values)] if apart > _DAY else []


def stated_date(date: str) -> Measured:
    """Tell when a campaign was recorded by the date in its rig file."""
    begin = datetime.fromisoformat(date)
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    end = begin + timedelta(days=1, seconds=-1) if len(date) == len("2026-01-01") else begin
    return Measured(begin.timestamp(), end.timestamp(), "rig")


def day(moment: float) -> str:
    """Return the date of a moment in s since 1970."""
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"


@record
class Recording:
    """What tells one recording from another. means : of its readings; None where not at hand."""

    name: str
    inputs: Sequence[InputFile]
    measured: Measured | None
    means: Readings | None = None


def refuse_repeated(recordings: Sequence[Recording]) -> None:
    """Raise UsageError where two campaigns hold the same recording."""
    for first, second in combinations(recordings, 2):
        common = {e.sha256 for e in first.inputs} & {e.sha256 for e in second.inputs}
        what = next((e.path for e in second.inputs if e.sha256 in common), None)
        if what is None and _at_one_time(first.measured, second.measured):
            what = "their clocks say so, for no rig is recorded twice at a time"
        if what is None and _alike(first, second):
            what = "their mean forces agree far below their uncertainty"
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
    if a.means is None or b.means is None:
        return False
    few, many = sorted((a.means, b.means), key=lambda one: len(one.force))
    if not len(few.force) or few.force.shape[1:] != many.force.shape[1:]:
        return False
    return bool(2 * repeated(many, few).sum() >= len(few.force))
