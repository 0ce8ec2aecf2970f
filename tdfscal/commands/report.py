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
    CommandResult,
    angle_rows,
    by_column,
    read_sources,
    sources_of,
)
from tdfscal.files.calibration.document import defects
from tdfscal.files.outputs import PAGE_SUFFIXES
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.several import against_first, by_date, several_report
from tdfscal.reporting.traceability import Making


@record(eq=False)
class ReportResult(CommandResult):
    """Calibrations to look at. named : name and content of each, in the order given.

    compared : the oldest against each of the others, where there are several.
    """

    named: tuple[tuple[str, Calibration], ...]
    compared: CompareResult | None
    making: Making

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What must be known of each, and what tells several apart."""
        return defects(*self.named[0]) if self.compared is None else self.compared.findings

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out the one, or all side by side."""
        from tdfscal.reporting.calibration import calibration_report

        if self.compared is None:
            return replace(calibration_report(self.named[0][1], drawings), summary=())
        return replace(several_report(self.compared.compared, self.making, drawings), summary=())

    def document(self) -> dict[str, Any]:
        """Return the content of all files, and how several compare, as JSON values."""
        sealed = not self.named[0][1].unsealed
        found: dict[str, Any] = {"verified": sealed, "comparisons": []}
        if self.compared is not None:
            found = self.compared.document()
        return {"calibrations": [c.to_dict() for _, c in self.named], **found}

    def table(self) -> dict[str, list[Any]]:
        """One row per calibration and angle: calibration, created, support, angle …, in rad."""
        rows = ((name, c.created, *row) for name, c in self.named for row in angle_rows(c))
        return by_column(f"calibration created {ANGLE_COLUMNS}", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figures of the one, or those of all together."""
        return (self.compared or self.named[0][1]).drawings()


@options.command("report calibration.yaml --html report.html")
def report(
    *files: Annotated[
        options.Several,
        Option("calibration files; - for stdin", list[Path], "FILE"),
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
    command: str = "",
) -> ReportResult:
    """Summarise a calibration file, or several side by side and over time.

    Raises
    ------
    UsageError, DataError
        A file cannot be read, is no calibration, or they are of different supports.
    """
    named = tuple(read_sources(sources_of(*files)))
    several = CompareResult(against_first(sorted(named, key=by_date))) if named[1:] else None
    return ReportResult(named, several, Making(command, ()))
