"""A part of a log between two moments of its clock (`--from`, `--to`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.logs.common.clock import shown
from tdfscal.records import Log, Series


@dataclass(frozen=True, slots=True)
class Moment:
    """A time in s: on the log's clock or, `after_begin`, from the first sample on."""

    seconds: float
    after_begin: bool = False

    def __str__(self) -> str:
        """As it is written on the command line."""
        return f"+{shown(self.seconds)} s" if self.after_begin else f"{shown(self.seconds)} s"


@dataclass(frozen=True, slots=True)
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

        Raises DataError where no sample lies in it.
        """
        first, last, kept = np.inf, -np.inf, 0
        said: tuple[Finding, ...] = (Finding("log-window", values={"window": str(self)}),)
        for piece in pieces:
            streams = (*piece.position, *piece.force)
            times = [series.time for series in streams if series.time.size]
            if times and first == np.inf:
                first = min(float(time[0]) for time in times)
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
                f"no sample lies {self}; the log runs from {shown(first)} s to {shown(last)} s",
                where=where,
                hint="correct --from and --to; a time after the begin of the log is written +90, "
                "+1.5min or +2h",
            )


def _at(moment: Moment | None, first: float, otherwise: float) -> float:
    if moment is None:
        return otherwise
    return moment.seconds + (first if moment.after_begin else 0.0)


def _between(series: Series, low: float, high: float) -> Series:
    begin = np.searchsorted(series.time, low)
    end = np.searchsorted(series.time, high, side="right")
    if begin == 0 and end == series.time.size:
        return series
    return Series(series.time[begin:end], series.value[begin:end])
