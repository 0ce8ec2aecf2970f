"""Point files of a tracker session."""

from __future__ import annotations

from pathlib import Path

from tdfscal.files.outputs import make_folder
from tdfscal.files.saving import write_text
from tdfscal.records import PointSet, TrackerSession

MM = 1000.0


def write_session(folder: Path, session: TrackerSession) -> None:
    """nominal.csv and servo.csv (plain), targets.csv and moves.csv (SpatialAnalyzer); all in mm."""
    make_folder(folder)
    _plain(folder / "nominal.csv", session.nominal)
    _plain(folder / "servo.csv", session.servo)
    _spatial_analyzer(folder / "targets.csv", session.targets)
    _spatial_analyzer(folder / "moves.csv", session.moves)


def _plain(path: Path, points: PointSet) -> None:
    lines = ["group,point,x,y,z"]
    for group, point, xyz in zip(
        points.group, points.point, (MM * points.xyz).tolist(), strict=True
    ):
        lines.append(",".join([group, point, *map(repr, xyz)]))
    write_text(path, "\n".join(lines) + "\n")


def _spatial_analyzer(path: Path, points: PointSet) -> None:
    # Nanometres, a thousandth of what the instrument resolves.
    lines = [
        "// SpatialAnalyzer export",
        "// AXES = CARTESIAN: X,  Y,  Z (mm)",
        "// Group,  Point,  X,  Y,  Z",
        "",
    ]
    for group, point, xyz in zip(
        points.group, points.point, (MM * points.xyz).tolist(), strict=True
    ):
        lines.append(",  ".join([group, point, *(f"{v:.6f}" for v in xyz)]))
    write_text(path, "\n".join(lines) + "\n")
