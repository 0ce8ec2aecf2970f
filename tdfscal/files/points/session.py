"""The four point files of a laser-tracker survey."""

from __future__ import annotations

from pathlib import Path

from tdfscal.files.points.reading import read_point_file
from tdfscal.records import Instrument, TrackerSession


def read_tracker_session(
    *,
    instrument: Instrument,
    drawing: float,
    length_unit: str | None,
    nominal: Path,
    targets: Path,
    servo: Path,
    moves: Path,
) -> tuple[TrackerSession, tuple[str, ...]]:
    """Read a survey and the notes on its files; errors as `read_point_file`.

    drawing : m, standard uncertainty of the nominal points. length_unit : where a file names none.
    """
    files = [read_point_file(p, length_unit=length_unit) for p in (nominal, targets, servo, moves)]
    session = TrackerSession(instrument, drawing, *(file.points for file in files))
    return session, tuple(note for file in files for note in file.notes)
