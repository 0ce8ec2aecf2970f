"""Installation rotations by laser tracker (Sect. 3.2) and registration of point files."""

from __future__ import annotations

from tdfscal.trackercal.best_fit import PointRegistration, register
from tdfscal.trackercal.judged_registration import RejectedPoint
from tdfscal.trackercal.monte_carlo import MonteCarlo
from tdfscal.trackercal.pipeline import TrackerCalibration, calibrate_tracker
from tdfscal.trackercal.point_matching import MatchedPoints, match_points
from tdfscal.trackercal.positioner_axes import AxisFault, AxisTest

__all__ = [
    "AxisFault",
    "AxisTest",
    "MatchedPoints",
    "MonteCarlo",
    "PointRegistration",
    "RejectedPoint",
    "TrackerCalibration",
    "calibrate_tracker",
    "match_points",
    "register",
]
