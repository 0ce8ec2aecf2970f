"""The figures of a report: each module draws one claim from a calibration file."""

from __future__ import annotations

from collections.abc import Sequence

from tdfscal.comparison.compatibility import History
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.figures import (
    angles,
    budget,
    components,
    drift,
    methods,
    observability,
    residuals,
    rig,
    spectrum,
    survey,
    timeline,
    trials,
    wrench_in_motion,
)
from tdfscal.reporting.figures.style import Drawing

_ALL = (
    angles.draw,
    methods.draw,
    residuals.draw,
    components.draw,
    budget.draw,
    timeline.draw,
    observability.draw,
    rig.draw,
    spectrum.draw,
    wrench_in_motion.draw,
    trials.draw,
    survey.draw,
)


def drawings(calibration: Calibration) -> tuple[Drawing, ...]:
    """Return every figure for which the file holds the data, in the order of reading."""
    found = (draw(calibration) for draw in _ALL)
    return tuple(drawing for drawing in found if drawing is not None)


def several_drawings(
    history: History, letters: Sequence[str], days: Sequence[float]
) -> tuple[Drawing, ...]:
    """Return the figures of several calibrations; days since the first."""
    return (drift.draw(history, letters, days),)
