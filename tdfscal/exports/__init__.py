"""A calibration in the formats of controllers and of calibration laboratories."""

from __future__ import annotations

from collections.abc import Callable

from tdfscal.exports.certificate import certificate
from tdfscal.exports.cheader import c_header
from tdfscal.exports.csvtable import csv_table
from tdfscal.exports.ros import ros
from tdfscal.exports.thresholds import ContactThresholds
from tdfscal.exports.urdf import urdf
from tdfscal.files.calibration.document import Calibration

FORMATS: dict[str, Callable[[Calibration, str, ContactThresholds | None], str]] = {
    "urdf": lambda calibration, parent, limits: urdf(calibration, parent),
    "ros": ros,
    "csv": lambda calibration, parent, limits: csv_table(calibration),
    "c": lambda calibration, parent, limits: c_header(calibration, limits),
    "dcc": lambda calibration, parent, limits: certificate(calibration),
}
"""Format → writer of (calibration, parent frame, thresholds)."""
#: Formats that hold thresholds.
WITH_THRESHOLDS = ("ros", "c")
