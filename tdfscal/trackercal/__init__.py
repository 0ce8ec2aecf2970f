"""Installation rotations by laser tracker (Sect. 3.2) and registration of point files."""

from __future__ import annotations

from tdfscal.trackercal.axes import AxisFault, AxisTest
from tdfscal.trackercal.calibrate import TrackerCalibration, calibrate_tracker
from tdfscal.trackercal.matching import MatchedPoints, match_points
from tdfscal.trackercal.montecarlo import MonteCarlo
from tdfscal.trackercal.registering import PointRegistration, register
from tdfscal.trackercal.survey import RejectedPoint

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
