"""A campaign's log as it passes: what it says of itself and of its files, when it was recorded."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import combinations

import numpy as np

from tdfscal.catalogue import sentence, told
from tdfscal.catalogue.inputs import STOPS
from tdfscal.catalogue.numbers import by_wall_clock
from tdfscal.commands.campaign import Campaign
from tdfscal.commands.options import Progress, silent
from tdfscal.comparison.shared_data import readings, repeated
from tdfscal.dwells import find_dwells
from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, RigError, UsageError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.logs import TimeWindow, iter_log
from tdfscal.records import Dwells, FloatArray, InputFile, Log, Measured, RecorderClock, Rig

#: Warnings of a log that an error repeats at most.
_REPEATED = 3
#: Stops left out per dwell found, from which an error says so.
_LOST = 2
#: A reading this close to its capacity, relative, stands at it.
_AT_CAPACITY = 1e-6
_DAY = 86400.0


@record
class Settings:
    """What holds for every campaign of a command.

    window : the part of the logs that is used. trials : Monte Carlo trials at most; None for the
    default, 0 for none. command : kept in the file, as what was asked for.
    """

    progress: Progress = silent
    window: TimeWindow | None = None
    trials: int | None = None
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

    @property
    def rig(self) -> Rig:
        """What the rig file states."""
        return self.campaign.rig.rig

    @property
    def progress(self) -> Progress:
        """Whom to tell of the work."""
        return self.settings.progress

    def pieces(self) -> Iterator[Log]:
        """Read the logs once, piece by piece. Raises UsageError, DataError."""
        logs, rig = self.campaign.logs, self.rig
        first, last = dict[int, float](), dict[int, float]()
        mapping, window = self.campaign.rig.log, self.settings.window
        for piece in iter_log(logs, mapping, rig.supports, axes=rig.axes, window=window):
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
        self.progress("reading the log and finding the dwells")
        return self.noted(find_dwells(self.pieces()))

    def noted(self, dwells: Dwells) -> Dwells:
        """Keep what the dwells say of the log.

        Raises DataError where one file holds the recording of another, by another clock.
        """
        self._note(dwells.findings)
        self.stops = _lost_stops(dwells, self.rig)
        if len(self.inputs) > 1 and dwells.force_cov.any():
            self._refuse_copies(dwells)
        return dwells

    def _refuse_copies(self, dwells: Dwells) -> None:
        whole, file = readings(self.rig, dwells), np.searchsorted(self.ends[:-1], dwells.start)
        parts = [
            (entry.path, replace(whole, force=whole.force[file == k]))
            for k, entry in enumerate(self.inputs)
        ]
        for (name, first), (other, second) in combinations(parts, 2):
            if 0 < len(second.force) <= 2 * repeated(first, second).sum():
                raise DataError(
                    f"holds the recording of {name} again, by another clock: the mean forces "
                    "agree far below their uncertainty",
                    where=str(other),
                    hint="keep one of the two in the folder; twice the same data are no more data",
                )

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
            found = [*([self.stops] if self.stops else []), *self.messages]
            what = "; ".join([error.what, *map(sentence, error.findings)])
            advice = error.hint
            if found:
                look = f"look first at the log: {'; '.join(map(told, found[:_REPEATED]))}"
                advice = f"{look}. {advice[0].upper()}{advice[1:]}" if advice else look
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
    """Say so where rig file and log's clock are of other days."""
    date, found = log.rig.campaign.date, measured(log)
    if date is None or found.source != "log":
        return []
    stated = stated_date(date)
    if max(stated.begin - found.end, found.begin - stated.end) <= _DAY:
        return []
    values: dict[str, Value] = {"date": date, "clock": day(found.begin)}
    return [Finding("campaign-misdated", (str(log.campaign.rig.path),), values=values)]


def stated_date(date: str) -> Measured:
    """Tell when a campaign was recorded by the date in its rig file."""
    begin = datetime.fromisoformat(date)
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    end = begin + timedelta(days=1, seconds=-1) if len(date) == len("2026-01-01") else begin
    return Measured(begin.timestamp(), end.timestamp(), "rig")


def day(moment: float) -> str:
    """Return the date of a moment in s since 1970."""
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"
