"""`tdfscal register`."""

from __future__ import annotations

import sys
from pathlib import Path

from tdfscal.cli.app import emit
from tdfscal.files.points import read_point_file
from tdfscal.reporting.registration import document, registration_report
from tdfscal.reporting.terminal import show
from tdfscal.trackercal import register


def run(measured: Path, reference: Path, *, unit: str | None, json: bool) -> None:
    """Register two point files and print the transform."""
    first = read_point_file(measured, length_unit=unit)
    second = read_point_file(reference, length_unit=unit)
    found = register(first.points, second.points)
    notes = (*first.notes, *second.notes)
    for note in notes:
        print(f"tdfscal: note: {note}", file=sys.stderr)
    if json:
        emit(document(found, notes))
    else:
        show(registration_report(found))
