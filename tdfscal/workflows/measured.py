"""When data were recorded: by the log's wall clock, else the rig file, else the file's own date."""

from __future__ import annotations

import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from tdfscal.errors import DataError, RigError
from tdfscal.records import Measured
from tdfscal.workflows.log_pass import LogPass

#: A log whose times lie between 1990 and 2100 has a wall clock; others count from some start, s.
_WALL_CLOCK = (631152000.0, 4102444800.0)
_DAY = 86400.0


def measured(log: LogPass) -> Measured:
    """Tell when a campaign was recorded, and what says so.

    Raises
    ------
    DataError, RigError
        The log's clock, or the rig file's date, lies in the future.
    """
    if by_wall_clock(log.begin, log.end):
        found = Measured(log.begin, log.end, "log")
        if found.end > time.time() + _DAY:
            raise DataError(
                f"the log's clock says {_day(found.end)}, which is in the future",
                where=", ".join(map(str, log.campaign.logs)),
                hint="set the recorder's clock; or let its time count from 0, and state "
                "campaign.date in rig.yaml",
            )
        return found
    rig = log.campaign.rig
    date = rig.rig.campaign.date
    if date is not None:
        found = stated(date)
        if found.begin > time.time() + _DAY:
            raise RigError(
                f"the campaign's date, {date}, is in the future",
                where=f"{rig.path}: campaign.date",
                hint="write the day on which the log was recorded",
            )
        return found
    return _of_files(log.campaign.logs or (rig.path,))


def by_wall_clock(*times: float) -> bool:
    """Tell whether a log's times, s, are those of a wall clock."""
    return all(_WALL_CLOCK[0] <= time <= _WALL_CLOCK[1] for time in times)


def stated(date: str) -> Measured:
    """Tell when a campaign was recorded by the date in its rig file."""
    begin = datetime.fromisoformat(date)
    begin = begin if begin.tzinfo else begin.replace(tzinfo=UTC)
    end = begin + timedelta(days=1, seconds=-1) if len(date) == len("2026-01-01") else begin
    return Measured(begin.timestamp(), end.timestamp(), "rig")


def _of_files(paths: Sequence[Path]) -> Measured:
    times = [path.stat().st_mtime for path in paths]
    return Measured(min(times), max(times), "file")


def _day(moment: float) -> str:
    return f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%d}"
