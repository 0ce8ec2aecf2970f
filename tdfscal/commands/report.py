"""`report`: one calibration summarised, or several side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike
from tdfscal.commands.compare import CompareResult
from tdfscal.commands.options import Option, silent
from tdfscal.commands.result import (
    ANGLE_COLUMNS,
    Calibration,
    angle_rows,
    by_column,
    read_sources,
    sources_of,
)
from tdfscal.files.outputs import PAGE_SUFFIXES
from tdfscal.frozen import record, replace
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.several import by_date


@record(eq=False)
class ReportResult(CompareResult):
    """Calibrations to look at in the order of time; the oldest against each of the others."""

    @property
    def verified(self) -> bool:
        """All agree; one by itself states its digest."""
        return super().verified if self.comparisons else not self.named[0][1].unsealed

    @property
    def exit_status(self) -> int:
        """0: they were looked at."""
        return 0

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out the one, or all side by side."""
        from tdfscal.reporting.calibration import calibration_report

        if self.comparisons:
            return replace(super().to_report(drawings), summary=())
        return replace(calibration_report(self.named[0][1], drawings), summary=())

    def document(self) -> dict[str, Any]:
        """Return the content of all files, and how several compare, as JSON values."""
        each = [Calibration.of(c).to_dict() for _, c in self.named]
        return {"calibrations": each, **super().document()}

    def table(self) -> dict[str, list[Any]]:
        """One row per calibration and angle: calibration, created, support, angle …, in rad."""
        rows = ((name, c.created, *row) for name, c in self.named for row in angle_rows(c))
        return by_column(f"calibration created {ANGLE_COLUMNS}", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figures of the one, or those of all together."""
        if self.comparisons:
            return super().drawings()
        return Calibration.of(self.named[0][1]).drawings()


@options.command("report calibration.yaml --html report.html")
def report(
    *files: Annotated[
        options.Several, Option("calibration files; - for stdin", list[Path], "FILE")
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
    progress: options.Telling = silent,
) -> ReportResult:
    """Summarise a calibration file, or several side by side and over time."""
    return ReportResult.of(sorted(read_sources(sources_of(*files)), key=by_date))
