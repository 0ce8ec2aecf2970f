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
        motion,
        observability,
        residuals,
        rig,
        survey,
        timeline,
        uncertainty,
    )

    in_order = (
        *(angles.draw, angles.methods, residuals.draw, residuals.components, uncertainty.draw),
        *(timeline.draw, observability.draw, rig.draw, motion.spectrum, motion.draw),
        *(uncertainty.trials, survey.draw),
    )
    found = (draw(calibration) for draw in in_order)
    return tuple(drawing for drawing in found if drawing is not None)
