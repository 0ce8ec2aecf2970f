"""Files for controllers."""

from __future__ import annotations

from collections.abc import Callable

from tdfscal.exports.formats import c_header, csv_table, ros, urdf
from tdfscal.files.calibration.document import Calibration

FORMATS: dict[str, Callable[[Calibration, str], str]] = {
    "urdf": urdf,
    "ros": ros,
    "csv": lambda calibration, parent: csv_table(calibration),
    "c": lambda calibration, parent: c_header(calibration),
}
"""Format → writer of (calibration, parent frame)."""
