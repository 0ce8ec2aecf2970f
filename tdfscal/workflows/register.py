"""`register`: the rigid transform between two point files."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal import trackercal
from tdfscal.files.points import read_point_file
from tdfscal.reporting.registration import document, registration_report
from tdfscal.trackercal import PointRegistration
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.result import Result

if TYPE_CHECKING:
    import pandas as pd

    from tdfscal.reporting.figures.style import Drawing
    from tdfscal.reporting.layout import Report


@dataclass(frozen=True, slots=True, repr=False)
class RegisterResult(Result):
    """Best-fit transform reference → measured. registration : it. notes : of the files."""

    registration: PointRegistration
    notes: tuple[str, ...]

    def to_report(self) -> Report:
        """Return transform, uncertainty, residuals."""
        return registration_report(self.registration)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON values; m and rad."""
        return document(self.registration, self.notes)

    def to_frame(self) -> pd.DataFrame:
        """One row per point: its residual x, y, z and their length, in m."""
        import pandas as pd

        r = self.registration
        frame = pd.DataFrame(r.residual, columns=["x", "y", "z"])
        frame.insert(0, "point", r.names)
        frame["length"] = np.linalg.norm(r.residual, axis=1)
        return frame

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the residuals."""
        from tdfscal.reporting.figures.point_residuals import draw

        return (draw(self.registration),)


def register(
    measured: str | PathLike[str],
    reference: str | PathLike[str],
    *,
    unit: str | None = None,
    progress: Progress = SILENT,
) -> RegisterResult:
    """Fit the rigid transform from reference points to measured ones, with its uncertainty.

    Parameters
    ----------
    measured, reference : point files; the second is moved onto the first.
    unit : length unit of files that name none.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, DataError
        A file cannot be read, or the points do not belong together.
    NotIdentifiableError
        The points do not fix a transform.
    """
    del progress
    first = read_point_file(Path(measured), length_unit=unit)
    second = read_point_file(Path(reference), length_unit=unit)
    fit = trackercal.register(first.points, second.points)
    return RegisterResult(fit, (*first.notes, *second.notes))
