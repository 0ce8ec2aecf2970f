"""The figures of a report: a module per subject, a function per claim; how they count time."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from tdfscal.frozen import field, record
from tdfscal.records import by_wall_clock

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tdfscal.files.calibration.document import Calibration


#: Of a month, on average.
_DAYS = 30.4375


@record
class Drawing:
    """A figure that is not drawn yet, with what it says.

    name : of its file. title : what is drawn. reading : its message, one sentence.
    paint : draws it; called once per rendering, since a Figure carries state.
    """

    name: str
    title: str
    reading: str
    paint: Callable[[], Figure] = field(repr=False)


def drawings(calibration: Calibration) -> tuple[Drawing, ...]:
    """Return every figure for which the file holds the data, in the order of reading."""
    # matplotlib is slow to import, as is all that reads a calibration: not before it is drawn.
    from tdfscal.reporting.figures import angles, residuals, timeline

    last = " of the last campaign" * (len(calibration.campaigns) > 1)
    found = (
        angles.draw(calibration),
        residuals.at_postures(calibration.postures, last),
        residuals.over_motion(calibration),
        residuals.survey(calibration),
        angles.budget(calibration),
        timeline.draw(calibration),
    )
    return tuple(drawing for drawing in found if drawing is not None)


@record
class Clock:
    """Origin is subtracted from times; label names what is then counted; unit goes with it."""

    origin: float
    label: str
    unit: str

    def stretch(self, start: float, end: float) -> str:
        """Words for a stretch of the log."""
        if self.unit == "row":
            return f"row {start:.0f}"
        return f"{start - self.origin:.1f} to {end - self.origin:.1f} {self.unit}"


def clock(c: Calibration) -> Clock:
    """The clock of a calibration's log: as it counts, a date from the first dwell on."""
    if any(recorder.rows == "postures" for recorder in c.rig.log or ()):
        return Clock(0.0, "row of the log", "row")
    starts = [r.start for r in c.fit.rejected] if c.fit is not None else []
    if c.postures is not None:
        starts += [*c.postures.start, *(s.start for s in c.postures.left_out)]
    return clock_from(min(starts, default=0.0))


def clock_from(first: float) -> Clock:
    """The clock of a log whose first time is this; of a date whole seconds are subtracted."""
    if not by_wall_clock(first):
        return Clock(0.0, "time in the log, s", "s")
    return Clock(float(int(first)), "time since the log's start, s", "s")


def date_of(month: float) -> datetime:
    """Date of a time in months since 1970."""
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=month * _DAYS)
