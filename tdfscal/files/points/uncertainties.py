"""From the uncertainties that a point file prints to standard uncertainties."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import DataError
from tdfscal.files.points.columns import Columns
from tdfscal.records import FloatArray
from tdfscal.significance import COVERAGE_FACTOR


def coverage_of(columns: Columns, named: float | None, source: str) -> tuple[float, list[str]]:
    """Factor k of a file's uncertainties, and a note on it; named : by a line of the file."""
    if columns.expanded:
        if named not in (None, 1.0, COVERAGE_FACTOR):
            raise DataError(
                f"has U(95) columns and names a coverage of {named:g} sigma",
                where=source,
                hint="correct one of them",
            )
        return COVERAGE_FACTOR, [
            f"{source}: U(95) is taken as an expanded uncertainty, u = U(95)/{COVERAGE_FACTOR:g}"
        ]
    if named is not None:
        return named, [f"{source}: its uncertainties are of {named:g} sigma, as it says"]
    if columns.bare:
        return 1.0, [
            f"{source}: its uncertainties are taken as standard ones (1 sigma); no line says more"
        ]
    return 1.0, []


def standard_uncertainties(
    numbers: FloatArray, digit: float, coverage: float, source: str
) -> tuple[FloatArray | None, list[str]]:
    """Standard uncertainties (N, 3) in the file's unit, None where no point has one, and notes.

    numbers : (N, 3), as printed; rows of NaN where the cells are blank. digit : worth of their
    last digit. A zero beside other uncertainties was rounded: it is anything below half a digit,
    and the end of that interval is taken. Zeros throughout state nothing.
    """
    stated = np.isfinite(numbers).all(axis=1)
    if not np.any(numbers[stated] > 0):
        kind = "are all zero" if stated.any() else "are all blank"
        return None, [f"{source}: its uncertainties {kind}, which states none"]
    notes = []
    if np.any(numbers[stated] == 0):
        notes.append(f"{source}: uncertainties printed as 0 are taken as {digit / 2:g}, as rounded")
    if not stated.all():
        notes.append(f"{source}: {np.sum(~stated)} point(s) have no uncertainty")
    return np.where(numbers == 0, digit / 2, numbers) / coverage, notes
