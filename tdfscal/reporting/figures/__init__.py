"""The figures of a report: each module draws one claim from a calibration file."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from tdfscal.comparison.compatibility import History
from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.figures.drawing import Drawing

#: Modules in the order of reading; imported when something is drawn, for matplotlib is slow.
_IN_ORDER = (
    *("angles", "methods", "residuals", "components", "budget", "timeline", "observability"),
    *("rig", "spectrum", "wrench_in_motion", "trials", "survey"),
)


def drawings(calibration: Calibration) -> tuple[Drawing, ...]:
    """Return every figure for which the file holds the data, in the order of reading."""
    modules = (import_module(f"{__name__}.{name}") for name in _IN_ORDER)
    found = (module.draw(calibration) for module in modules)
    return tuple(drawing for drawing in found if drawing is not None)


def several_drawings(
    history: History, letters: Sequence[str], days: Sequence[float]
) -> tuple[Drawing, ...]:
    """Return the figures of several calibrations; days since the first."""
    from tdfscal.reporting.figures import drift

    return (drift.draw(history, letters, days),)
