"""A calibration in the formats of controllers and of calibration laboratories."""

from __future__ import annotations

from collections.abc import Callable

from tdfscal.exports.certificate import certificate
from tdfscal.exports.cheader import c_header
from tdfscal.exports.csvtable import csv_table
from tdfscal.exports.ros import ros_launch, ros_parameters, ros_transforms
from tdfscal.exports.urdf import urdf
from tdfscal.files.calibration.document import Calibration


def _page(calibration: Calibration) -> str:
    """Return the certificate's page; what it takes to draw one is imported for it alone."""
    from tdfscal.exports.certificate_page import certificate_page

    return certificate_page(calibration)


FORMATS: dict[str, Callable[[Calibration, str], str]] = {
    "urdf": urdf,
    "ros": ros_transforms,
    "ros-parameters": ros_parameters,
    "ros-launch": ros_launch,
    "csv": lambda calibration, parent: csv_table(calibration),
    "c": lambda calibration, parent: c_header(calibration),
    "certificate": lambda calibration, parent: _page(calibration),
    "dcc": lambda calibration, parent: certificate(calibration),
}
"""Format → writer of (calibration, parent frame)."""
