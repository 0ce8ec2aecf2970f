"""Files for controllers."""

from __future__ import annotations

from collections.abc import Callable

from tdfscal.exports.formats import ContactThresholds, c_header, csv_table, ros, urdf
from tdfscal.files.calibration.document import Calibration

FORMATS: dict[str, Callable[[Calibration, str, ContactThresholds | None], str]] = {
    "urdf": lambda calibration, parent, limits: urdf(calibration, parent),
    "ros": ros,
    "csv": lambda calibration, parent, limits: csv_table(calibration),
    "c": lambda calibration, parent, limits: c_header(calibration, limits),
}
"""Format → writer of (calibration, parent frame, thresholds)."""
#: Formats that hold thresholds.
WITH_THRESHOLDS = ("ros", "c")
