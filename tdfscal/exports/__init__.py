"""A calibration in the formats of controllers and of calibration laboratories."""

from __future__ import annotations

from collections.abc import Callable

from tdfscal.exports.certificate import certificate
from tdfscal.exports.cheader import c_header
from tdfscal.exports.csvtable import csv_table
from tdfscal.exports.ros import ros
from tdfscal.exports.urdf import urdf
from tdfscal.files.calibration.document import Calibration

FORMATS: dict[str, Callable[[Calibration, str], str]] = {
    "urdf": urdf,
    "ros": ros,
    "csv": lambda calibration, parent: csv_table(calibration),
    "c": lambda calibration, parent: c_header(calibration),
    "dcc": lambda calibration, parent: certificate(calibration),
}
"""Format → writer of (calibration, parent frame)."""
