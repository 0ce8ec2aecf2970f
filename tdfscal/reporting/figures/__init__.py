"""The figures of a report: a module per subject, a function per claim."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tdfscal.reporting.figures.drawing import Drawing

if TYPE_CHECKING:
    from tdfscal.files.calibration.document import Calibration


def drawings(calibration: Calibration) -> tuple[Drawing, ...]:
    """Return every figure for which the file holds the data, in the order of reading."""
    # matplotlib is slow to import, as is all that reads a calibration: not before it is drawn.
    from tdfscal.reporting.figures import (
        angles,
        clocks,
        observability,
        residuals,
        rig,
        survey,
        timeline,
        uncertainty,
    )

    found = (
        angles.draw(calibration),
        angles.methods(calibration),
        residuals.at_postures(calibration.postures),
        residuals.components(calibration.postures),
        uncertainty.draw(calibration),
        timeline.draw(calibration),
        clocks.draw(calibration),
        observability.draw(calibration),
        rig.draw(calibration),
        residuals.over_motion(calibration),
        residuals.spectrum(calibration),
        uncertainty.trials(calibration),
        survey.draw(calibration),
    )
    return tuple(drawing for drawing in found if drawing is not None)
