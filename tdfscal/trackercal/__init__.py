"""Installation rotations by laser tracker (Sect. 3.2) and registration of point files."""

from __future__ import annotations

from tdfscal.trackercal.best_fit import PointRegistration, register
from tdfscal.trackercal.pipeline import TrackerCalibration, calibrate_tracker
from tdfscal.trackercal.point_matching import match_points

__all__ = [
    "PointRegistration",
    "TrackerCalibration",
    "calibrate_tracker",
    "match_points",
    "register",
]
