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
    from tdfscal.reporting.figures import angles, residuals

    last = " recorded last" * (len(calibration.campaigns) > 1)
    found = (
        angles.draw(calibration),
        residuals.at_postures(calibration.postures, last),
        residuals.over_motion(calibration),
        residuals.survey(calibration),
        angles.budget(calibration),
    )
    return tuple(drawing for drawing in found if drawing is not None)


def origin(first: float) -> float:
    """What is subtracted from the times of a log whose first is this: whole seconds of a date."""
    return float(int(first)) if by_wall_clock(first) else 0.0


def date_of(month: float) -> datetime:
    """Date of a time in months since 1970."""
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=month * _DAYS)
