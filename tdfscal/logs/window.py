"""The part of a log that is used."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.catalogue.entry import by_wall_clock, when
from tdfscal.errors import DataError, UsageError
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.records import Log, Series


@record
class Moment:
    """A time in s: on the log's clock or, `after_begin`, from the first sample on.

    dated : given as a date, which the clock must have.
    """

    seconds: float
    after_begin: bool = False
    dated: bool = False

    def __str__(self) -> str:
        """As it is written on the command line."""
        return f"+{self.seconds:.9g} s" if self.after_begin else when(self.seconds)


@record
class TimeWindow:
    """What of a log is used: from `begin` to `end`, both included; None is open."""

    begin: Moment | None = None
    end: Moment | None = None

    def __str__(self) -> str:
        """In words."""
        ends = (("from", self.begin), ("to", self.end))
        return " ".join(f"{word} {moment}" for word, moment in ends if moment is not None)

    def cut(self, pieces: Iterator[Log], where: str) -> Iterator[Log]:
        """Pass the pieces of a log on, with the samples of this part only.

        Raises DataError where no sample lies in it, UsageError for a date that its clock lacks.
        """
        first, last, kept = np.inf, -np.inf, 0
        said: tuple[Finding, ...] = (Finding("log-window", values={"window": str(self)}),)
        for piece in pieces:
            times = [s.time for s in (*piece.position, *piece.force) if s.time.size]
            if times and first == np.inf:
                first = min(float(time[0]) for time in times)
                self._refuse_date(first, where)
            last = max([last, *(float(time[-1]) for time in times)])
            low, high = _at(self.begin, first, -np.inf), _at(self.end, first, np.inf)
            part = replace(
                piece,
                position=tuple(_between(s, low, high) for s in piece.position),
                force=tuple(_between(s, low, high) for s in piece.force),
                temperature=tuple(_between(s, low, high) for s in piece.temperature),
                findings=(*said, *piece.findings),
            )
            said = ()
            kept += sum(series.time.size for series in part.force)
            yield part
        if not kept:
            raise DataError(
                f"no sample lies {self}; the log runs from {when(first)} to {when(last)}",
                where=where,
                hint="correct --from and --to; a time after the begin of the log is written +90, "
                "+1.5min or +2h",
            )

    def _refuse_date(self, first: float, where: str) -> None:
        """Raise UsageError where an end is a date and the log's clock counts from some start."""
        ends = [end for end in (self.begin, self.end) if end is not None and end.dated]
        if any(by_wall_clock(end.seconds) for end in ends) and not by_wall_clock(first):
            raise UsageError(
                f"the log's clock has no dates: it begins at {when(first)}",
                where=where,
                hint="give s of that clock, or +90 for 90 s after the log's begin",
            )


def _at(moment: Moment | None, first: float, otherwise: float) -> float:
    if moment is None:
        return otherwise
    return moment.seconds + (first if moment.after_begin else 0.0)


def _between(series: Series, low: float, high: float) -> Series:
    begin = np.searchsorted(series.time, low)
    end = np.searchsorted(series.time, high, side="right")
    return Series(series.time[begin:end], series.value[begin:end])
