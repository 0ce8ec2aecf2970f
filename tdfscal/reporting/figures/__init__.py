"""The figures of a report: a module per subject, a function per claim."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from tdfscal.frozen import field, record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tdfscal.files.calibration.document import Calibration


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

    found = (
        angles.draw(calibration),
        residuals.at_postures(calibration.postures),
        residuals.over_motion(calibration),
        residuals.survey(calibration),
        angles.budget(calibration),
        timeline.draw(calibration),
        residuals.spectrum(calibration),
    )
    return tuple(drawing for drawing in found if drawing is not None)
