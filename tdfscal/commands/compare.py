"""`compare`: do calibrations agree within their uncertainties?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.catalogue import documents
from tdfscal.commands import options
from tdfscal.commands.options import Option, silent
from tdfscal.commands.result import CommandResult, by_column, each_angle, read_sources, sources_of
from tdfscal.comparison.compatibility import Comparison
from tdfscal.errors import UsageError
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.several import Several, comparison_document, several_report
from tdfscal.reporting.traceability import Making


@record(eq=False)
class CompareResult(CommandResult, Several):
    """The first calibration against each of the others, always the later minus the earlier one."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Whether each pair agrees, what keeps it from that, and what must be known of each."""
        each = zip(self.comparisons, self.remarks, strict=True)
        said = (_of_pair(pair) + remarks for pair, remarks in each)
        return (*(found for pair in said for found in pair), *self.defects)

    @property
    def exit_status(self) -> int:
        """1 unless all are accepted and compatible."""
        return 0 if self.verified else 1

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out verdict, differences and E_n of each pair."""
        return several_report(self, Making(self.command, ()), drawings)

    def document(self) -> dict[str, Any]:
        """Return whether all agree, and each comparison, as plain JSON values."""
        each = []
        for pair, said in zip(self.comparisons, self.remarks, strict=True):
            own = (one for one in self.defects if set(one.subject) & set(pair.names))
            found = documents((*_of_pair(pair), *said, *own))
            each.append(comparison_document(pair) | {"findings": found})
        return {"verified": self.verified, "comparisons": each}

    def table(self) -> dict[str, list[Any]]:
        """One row per pair and angle: the difference, its standard uncertainty, E_n; rad."""
        rows = (
            (*pair.names, *row)
            for pair in self.comparisons
            for row in each_angle(pair.supports, pair.rpy, pair.rpy_std, pair.en)
        )
        return by_column("of against support angle difference std en", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of all differences with expanded uncertainty."""
        from tdfscal.reporting.figures.angles import differences

        return (differences(self.comparisons),)


@options.command("compare last-month.yaml calibration.yaml")
def compare(
    *files: Annotated[
        options.Several,
        Option(
            "calibration files of one rig, two or more: the first against each of the others",
            list[Path],
            "A B…",
        ),
    ],
    progress: options.Telling = silent,
) -> CompareResult:
    """Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict.

    Each difference is the later calibration minus the earlier one, by the dates of measurement.
    `report A B… --html FILE` makes a page of it.
    """
    sources = sources_of(*files)
    if len(sources) < 2:
        raise UsageError("one calibration cannot be compared", hint="name two files or more")
    return CompareResult.of(read_sources(sources))


def _of_pair(pair: Comparison) -> tuple[Finding, ...]:
    """That they are not compatible, where that can be told, and what keeps them from verifying."""
    told_apart = np.isfinite(pair.p_value) and not pair.compatible
    return (*((pair.finding,) if told_apart else ()), *filter(None, [pair.obstacle]))
