"""Time must ascend: duplicates, steps back and gaps of a recording's clock."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.catalogue.numbers import when
from tdfscal.errors import DataError
from tdfscal.files.rig.recorders import UNITS
from tdfscal.findings import Finding, Value
from tdfscal.records import BoolArray, FloatArray, Rows, by_wall_clock

MAX_STEP_BACK = 1.0
"""A clock that steps back by more than this many seconds was set anew: refused."""
MAX_DESCENDING = 0.25
"""Largest share of steps back of a clock that was set anew; beyond, the rows are in no order."""
MAX_PAUSE = 30.4375 * 86400.0
"""A clock that goes on by more than this many seconds, a month, was set meanwhile: refused."""
MAX_DROPPED = 1e-3
"""Largest share of samples (one at least) whose time does not ascend; they are left out."""
GAP = 5.0
"""An interval of more than this many median periods is a gap."""

MAX_APART = 1.0
"""A stream that begins or ends by more than this many seconds apart from the others is reported."""

MAX_SKEW = 0.1
"""A header time that departs by more than this from its usual offset to log time is counted, s."""
MAX_CLOCK_OFFSET = 1.0
"""A usual offset of header time to log time beyond this is reported, s."""

_ENOUGH = 4096
"""Intervals at the begin whose median is the period."""


class Clock:
    """The clock of one stream in one file, a column's or a topic's, followed from piece to piece.

    rows : with "postures" nothing is left out: a time that does not ascend is refused.
    after : s, the end of the file before; -∞ without one. The pause between is no gap.
    count : samples. longest : of the intervals, s, and where it begins. span : first and last time,
    s; None without a sample, or where rows are postures.
    """

    def __init__(self, name: str, rows: Rows, after: float = -np.inf) -> None:
        self.name, self._rows = name, rows
        self._last = after
        self.span: tuple[float, float] | None = None
        self.count = 0
        self._duplicates = 0
        self._back = 0
        self._worst_back = 0.0
        self._opening = np.empty(0)
        self._gaps = 0
        self.longest = (0.0, 0.0)

    def ascending(self, time: FloatArray) -> BoolArray | None:
        """Return which of the next samples (N,) are ahead of all before them; None where all are.

        Raises DataError for a step back of more than MAX_STEP_BACK or on by more than MAX_PAUSE.
        """
        if time.size == 0:
            return None
        self.count += time.size
        step = np.diff(time, prepend=self._last)
        pauses = step[int(not np.isfinite(self._last)) :]
        if self._rows != "postures" and pauses.max(initial=0.0) > MAX_PAUSE:
            k = int(np.argmax(pauses)) + time.size - pauses.size
            was, now = time[k - 1] if k else self._last, time[k]
            hint = "correct or leave out this stamp; give the logs of another month as a campaign "
            hint += "of their own"
            for unit, second in UNITS["time"].items():
                if unit != "s" and by_wall_clock(was * second, now * second):
                    hint = f"in the log block of rig.yaml state `time.unit: {unit}` where it says "
                    hint += f"s: the times are then of {when(now * second)}"
            raise DataError(
                f"the time of {self.name} goes from {when(was)} to {when(now)}, more than a month",
                hint=hint,
            )
        if (step > 0.0).all():
            self._note(time, step)
            return None
        # Against the latest time seen, not the sample before: one step back hides no other.
        latest = np.maximum.accumulate(np.concatenate(([self._last], time)))[:-1]
        keep: BoolArray = time > latest
        self._refuse_if_set_anew(time, latest, keep)
        same = time == latest
        self._duplicates += int(np.count_nonzero(same))
        back = ~keep & ~same
        if back.any():
            self._back += int(np.count_nonzero(back))
            self._worst_back = max(self._worst_back, float((latest - time)[back].max()))
        kept = time[keep]
        self._note(kept, np.diff(kept, prepend=self._last))
        return keep

    def finish(self) -> list[Finding]:
        """Return what is to be said at the file's end.

        Raises DataError where more samples than MAX_DROPPED do not ascend.
        """
        dropped = self._duplicates + self._back
        if dropped > max(1.0, MAX_DROPPED * self.count):
            kinds = []
            if self._duplicates:
                kinds.append(f"{self._duplicates} repeat the time of the sample before")
            if self._back:
                kinds.append(f"{self._back} step back by up to {self._worst_back:.3g} s")
            raise DataError(
                f"of {self.count} samples of {self.name}, {' and '.join(kinds)}",
                hint="check the time field and its unit; a recording's clock must ascend",
            )
        said = []
        if dropped:
            values: dict[str, Value] = {
                "count": self.count,
                "repeat": self._duplicates,
                "back": self._back,
                "worst": self._worst_back,
            }
            said.append(Finding("samples-not-ascending", (self.name,), dropped, values=values))
        period, gaps = self.intervals()
        if gaps:
            longest, at = self.longest
            values = {
                "gaps": gaps,
                "several_gaps": gaps > 1,
                "periods": GAP,
                "period": period,
                "at": when(at),
            }
            said.append(Finding("stream-gaps", (self.name,), longest, "s", values=values))
        return said

    def _refuse_if_set_anew(self, time: FloatArray, latest: FloatArray, keep: BoolArray) -> None:
        bad = ~keep if self._rows == "postures" else latest - time > MAX_STEP_BACK
        if bad.any():
            step = np.diff(time)
            if np.mean(step < 0.0) > MAX_DESCENDING:
                how = "is in no order"
                if not np.any(step > 0.0):
                    how = f"runs backwards from {when(time[0])}: the newest rows come first"
                raise DataError(
                    f"the time of {self.name} {how}",
                    hint="sort the rows so that their time ascends",
                )
            k = int(np.argmax(bad))
            raise DataError(
                f"the time of {self.name} goes from {when(latest[k])} to {when(time[k])}",
                hint="time must ascend; split the recording where its clock was set anew",
            )

    def _note(self, time: FloatArray, step: FloatArray) -> None:
        """Take in what ascends; step : from what was before. The pause between files is no gap."""
        if time.size == 0:
            return
        intervals = step[1:] if self.span is None else step
        begin = self.span[0] if self.span is not None else float(time[0])
        self._last = float(time[-1])
        if self._rows == "postures":
            return
        self.span = begin, self._last
        if intervals.size == 0:
            return
        k = int(np.argmax(intervals))
        if intervals[k] > self.longest[0]:
            at = float(time[k + time.size - intervals.size]) - float(intervals[k])
            self.longest = (float(intervals[k]), at)
        if self._opening.size >= _ENOUGH:
            self._gaps += self._gaps_in(intervals)
            return
        seen = np.concatenate([self._opening, intervals])
        self._opening = seen[:_ENOUGH]
        self._gaps = self._gaps_in(seen)

    def _gaps_in(self, intervals: FloatArray) -> int:
        return int(np.count_nonzero(intervals > GAP * np.median(self._opening)))

    def intervals(self) -> tuple[float, int]:
        """Usual interval, s, and how many exceed GAP of it; 0 below two."""
        if self._opening.size < 2:
            return 0.0, 0
        return float(np.median(self._opening)), self._gaps


def apart(clocks: Sequence[Clock]) -> list[Finding]:
    """Say which streams of one file begin long after, or end long before, the others.

    Long is more than MAX_APART and more than GAP of the stream's own periods: what a sensor's
    driver does that starts late or dies.
    """
    spans = [(clock, *clock.span) for clock in clocks if clock.span is not None]
    earliest = min((first for _, first, _ in spans), default=0.0)
    latest = max((last for _, _, last in spans), default=0.0)
    late = [(clock, first - earliest) for clock, first, _ in spans]
    early = [(clock, latest - last) for clock, _, last in spans]
    said = []
    for distances, code in ((late, "streams-late"), (early, "streams-early")):
        found = {c.name: by for c, by in distances if by > max(MAX_APART, GAP * c.intervals()[0])}
        if found:
            said.append(Finding(code, tuple(found), max(found.values()), "s"))
    return said


class Skew:
    """Header times against the recorder's, over one topic: how many; the worst departure, s.

    A header that is never filled in (all zero) is no time and is not compared.
    """

    def __init__(self) -> None:
        self.count = 0
        self.worst = 0.0
        self._usual = np.nan
        self._far = 0

    def note(self, header: FloatArray, log: FloatArray) -> None:
        """Take in times of the same messages, (N,), s."""
        if not header.size or not header.any():
            return
        skew = header - log
        if not self.count:
            self._usual = float(np.median(skew))
        self.count += skew.size
        away = np.abs(skew - self._usual)
        self._far += int(np.count_nonzero(away > MAX_SKEW))
        self.worst = max(self.worst, float(away.max()))

    def findings(self, topic: str) -> list[Finding]:
        """Name where the two clocks part."""
        found = []
        if abs(self._usual) > MAX_CLOCK_OFFSET:
            found.append(Finding("header-clock-off", (topic,), self._usual, "s"))
        if self._far:
            values: dict[str, Value] = {
                "count": self.count,
                "departing": self._far,
                "limit": MAX_SKEW,
            }
            found.append(Finding("header-clock-departs", (topic,), self.worst, "s", values=values))
        return found
