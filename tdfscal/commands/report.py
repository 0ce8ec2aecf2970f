"""`report`: one calibration summarised, or several side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT, PathLike
from tdfscal.commands.options import Option
from tdfscal.commands.result import (
    ANGLE_COLUMNS,
    Calibration,
    Result,
    angle_rows,
    by_column,
    read_sources,
    sources_of,
)
from tdfscal.files.outputs import PAGE_SUFFIXES
from tdfscal.frozen import record, replace
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.several import put_side_by_side, several_document, several_report


@record(eq=False)
class ReportResult(Result):
    """Calibrations to look at. named : name and content of each, in the order given."""

    named: tuple[tuple[str, Calibration], ...]

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out the one, or all side by side."""
        from tdfscal.reporting.calibration import calibration_report

        if len(self.named) > 1:
            return several_report(put_side_by_side(self.named), drawings)
        return replace(calibration_report(self.named[0][1], drawings), summary=())

    def document(self) -> dict[str, Any]:
        """Return the content of all files, and how several compare, as JSON values."""
        several = len(self.named) > 1
        return {
            "calibrations": [c.to_dict() for _, c in self.named],
            "comparison": several_document(put_side_by_side(self.named)) if several else None,
        }

    def table(self) -> dict[str, list[Any]]:
        """One row per calibration and angle: calibration, created, support, angle …, in rad."""
        rows = ((name, c.created, *row) for name, c in self.named for row in angle_rows(c))
        return by_column(f"calibration created {ANGLE_COLUMNS}", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figures of the one, or those of all together."""
        from tdfscal.reporting.figures.angles import differences

        if len(self.named) == 1:
            return self.named[0][1].drawings()
        pairs = put_side_by_side(self.named).pairs
        told = [pair for pair in pairs if np.isfinite(pair.p_value)]
        return (differences(told),) if told else ()


@options.command("report calibration.yaml --html report.html", html="html")
def report(
    *files: Annotated[
        options.Several,
        Option("calibration files; - for stdin", list[Path], "FILE", reads=True),
    ],
    html: Annotated[
        PathLike | None,
        Option(
            "also write one HTML page",
            Path | None,
            "FILE",
            shell="- for stdout",
            writes=PAGE_SUFFIXES,
            holds="html",
        ),
    ] = None,
    progress: options.Telling = SILENT,
) -> ReportResult:
    """Summarise a calibration file, or several side by side and over time.

    Raises
    ------
    UsageError, DataError
        A file cannot be read, is no calibration, or they are of different supports.
    """
    return ReportResult(tuple(read_sources(sources_of(*files))))
