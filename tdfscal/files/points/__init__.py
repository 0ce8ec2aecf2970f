"""Point files: plain CSV, SpatialAnalyzer exports, Leica-style headers, JSON."""

from __future__ import annotations

from tdfscal.files.points.reading import PointReading, read_point_file, read_points
from tdfscal.files.points.session import read_tracker_session
from tdfscal.files.points.units import to_metres

__all__ = [
    "PointReading",
    "read_point_file",
    "read_points",
    "read_tracker_session",
    "to_metres",
]
