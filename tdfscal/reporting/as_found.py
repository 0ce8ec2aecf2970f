"""As found and as left: a calibration against the one that the machine ran on before."""

from __future__ import annotations

import numpy as np

from tdfscal.comparison.compatibility import compare_pair
from tdfscal.files.calibration.document import Calibration
from tdfscal.records import ANGLES
from tdfscal.reporting.layout import Row, Section, Table
from tdfscal.reporting.phrases import utc
from tdfscal.significance import COVERAGE_FACTOR


def as_found(c: Calibration, name: str, previous: Calibration) -> Section:
    """Each angle before and now, the change, and whether it is more than both uncertainties.

    Raises DataError where the two are of different sensors.
    """
    pair = compare_pair(("as left", c.rotations()), (name, previous.rotations()))
    both = c.determined & previous.determined
    old = dict(zip(previous.support_names, previous.rpy, strict=True))
    rows: list[Row] = []
    for i in np.flatnonzero(both):
        support = pair.supports[i]
        for j, angle in enumerate(ANGLES):
            before, now = 1e3 * old[support][j], 1e3 * c.rpy[i, j]
            expanded = 1e3 * COVERAGE_FACTOR * pair.rpy_std[i, j]
            rows.append(
                (support, angle, f"{before:.3f}", f"{now:.3f}", f"{1e3 * pair.rpy[i, j]:+.3f}",
                 f"{expanded:.3f}", f"{pair.en[i, j]:.2f}")
            )  # fmt: skip
    header: Row = ("sensor", "angle", "as found", "as left", "change",
                   f"U, k = {COVERAGE_FACTOR:g}", "E_n")  # fmt: skip
    said = f"{pair.verdict[0].upper()}{pair.verdict[1:]}."
    if c.history:  # what stands on an earlier one is not independent of it
        header, rows = header[:-2], [row[:-2] for row in rows]
        said = "This calibration stands on earlier ones: its changes are not independent of them."
    caption = (
        f"Angles, mrad; as found: {name}, measured {_day(previous)}; as left: measured {_day(c)}"
    )
    return Section("As found, as left", (Table(caption, header, tuple(rows), left=2), said))


def _day(c: Calibration) -> str:
    return utc(c.measured.end if c.measured is not None else c.created)[:10]
