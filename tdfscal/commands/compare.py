"""`compare`: do calibrations agree within their uncertainties?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.catalogue import documents, told
from tdfscal.commands import options
from tdfscal.commands.arguments import SILENT
from tdfscal.commands.calibration import provisional, read_sources, sources_of
from tdfscal.commands.options import Option
from tdfscal.commands.result import Result, by_column
from tdfscal.comparison.compatibility import Comparison, judged_together
from tdfscal.errors import UsageError
from tdfscal.files.calibration.compared import compared
from tdfscal.findings import Finding
from tdfscal.records import ANGLES
from tdfscal.reporting.layout import Drawing
from tdfscal.reporting.several import comparison_document, comparison_report
from tdfscal.reporting.text import render


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class CompareResult(Result):
    """The first calibration against each of the others.

    pairs : one comparison each. rejected : names of those that the quality gate rejected.
    beside : what is said of rigs whose names differ, and of drafts. remarks : of each pair, on
    the data that both stand on.
    """

    pairs: tuple[Comparison, ...]
    rejected: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    remarks: tuple[tuple[Finding, ...], ...] = ()

    @property
    def verified(self) -> bool:
        """Every pair agrees, and none of it was rejected."""
        return all(pair.verified for pair in self.pairs)

    @property
    def notes(self) -> tuple[str, ...]:
        """Rejected and provisional calibrations, and rigs of other names."""
        rejected = (f"{name} was rejected by the quality gate" for name in self.rejected)
        return (*rejected, *self.beside)

    @property
    def exit_status(self) -> int:
        """1 unless all are accepted and compatible."""
        return 0 if self.verified and not self.rejected else 1

    @property
    def text(self) -> str:
        """Verdict, differences and E_n of each pair."""
        each = zip(self.pairs, self.remarks, strict=True)
        return "\n".join(render(comparison_report(pair, said)) for pair, said in each)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison, or all under `comparisons`, as plain JSON values."""
        each = [
            comparison_document(pair, {})
            | {"findings": documents((*filter(None, [pair.obstacle]), *said))}
            for pair, said in zip(self.pairs, self.remarks, strict=True)
        ]
        if len(each) == 1:
            return each[0]
        return {"verified": self.verified, "comparisons": each}

    def table(self) -> dict[str, list[Any]]:
        """One row per pair and angle: the difference, its standard uncertainty, E_n; rad."""
        rows = (
            (*pair.names, name, angle, pair.rpy[i, j], pair.rpy_std[i, j], pair.en[i, j])
            for pair in self.pairs
            for i, name in enumerate(pair.supports)
            for j, angle in enumerate(ANGLES)
        )
        return by_column("of against support angle difference std en", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return one figure per pair of two results: differences with expanded uncertainty."""
        from tdfscal.reporting.figures.angles import comparison

        return tuple(
            comparison(pair, k + 1)
            for k, pair in enumerate(self.pairs)
            if np.isfinite(pair.p_value)
        )


@options.command("compare last-month.yaml calibration.yaml")
def compare(
    *files: Annotated[
        options.Several,
        Option(
            "calibration files of one rig, two or more; the first is compared with each other",
            list[Path],
            "A B…",
        ),
    ],
    progress: options.Telling = SILENT,
) -> CompareResult:
    """Tell whether calibrations agree: differences, joint χ², E_n per angle, verdict.

    Raises
    ------
    UsageError
        There are fewer than two, or one cannot be read.
    DataError
        One is no calibration, or they are of different supports.
    """
    sources = sources_of(*files)
    if len(sources) < 2:
        raise UsageError("one calibration cannot be compared", hint="name two files or more")
    read = read_sources(sources)
    rejected = tuple(name for name, c in read if not c.accepted)
    first = read[0]
    pairs, remarks = list[Comparison](), list[tuple[Finding, ...]]()
    for other in read[1:]:
        pair, remark = compared(first, other)
        found = _obstacle(pair, rejected)
        if pair.obstacle is not None and found is not pair.obstacle:
            remark = (*remark, pair.obstacle)
        pairs.append(replace(pair, obstacle=found))
        remarks.append(remark)
    drafts = (told(found) for name, c in read for found in provisional(name, c))
    renamed = (
        f"{first[0]} is of {first[1].rig.name}, {name} of {c.rig.name}"
        for name, c in read[1:]
        if c.rig.name != first[1].rig.name
    )
    return CompareResult(judged_together(pairs), rejected, (*drafts, *renamed), tuple(remarks))


def _obstacle(pair: Comparison, rejected: tuple[str, ...]) -> Finding | None:
    """A calibration that was rejected, or of another rig, verifies nothing, whatever it says.

    Nor does one that stands on the same recordings.
    """
    blamed = tuple(name for name in pair.names if name in rejected)
    if not blamed or (pair.obstacle is not None and pair.obstacle.rejects):
        return pair.obstacle
    return Finding("compared-rejected", blamed, values={"names": " and ".join(blamed)})
