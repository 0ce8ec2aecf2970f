"""Point files of a tracker session."""

from __future__ import annotations

from collections.abc import Callable
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
    _write(path, ["group,point,x,y,z"], points, ",", repr)


def _spatial_analyzer(path: Path, points: PointSet) -> None:
    head = [
        "// SpatialAnalyzer export",
        "// AXES = CARTESIAN: X,  Y,  Z (mm)",
        "// Group,  Point,  X,  Y,  Z",
        "",
    ]
    # Nanometres, a thousandth of what the instrument resolves.
    _write(path, head, points, ",  ", "{:.6f}".format)


def _write(
    path: Path, head: list[str], points: PointSet, between: str, text: Callable[[float], str]
) -> None:
    rows = zip(points.group, points.point, (MM * points.xyz).tolist(), strict=True)
    lines = [between.join([group, point, *map(text, xyz)]) for group, point, xyz in rows]
    write_text(path, "\n".join([*head, *lines]) + "\n")
