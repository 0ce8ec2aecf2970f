"""What all studies share: their counts checked, their tables of plain rows, their files."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from tdfscal.files.outputs import make_folder
from tdfscal.files.saving import save_rows, write_text
from tdfscal.reporting.layout import Report, Section
from tdfscal.reporting.studies import Row
from tdfscal.workflows.arguments import at_least
from tdfscal.workflows.result import Result

#: The page among a study's files.
PAGE = "study.html"


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class StudyResult(Result):
    """Base of the studies' results. files : that were written, by their names in the folder."""

    files: tuple[str, ...] = field(default=())

    @abstractmethod
    def to_report(self) -> Report:
        """Return the study in words and tables."""

    @abstractmethod
    def tables(self) -> Mapping[str, Iterable[Row]]:
        """Return each CSV file's rows, a header first; the main table is the first."""

    def table(self) -> dict[str, list[Any]]:
        """Return the first of `tables`."""
        header, *body = next(iter(self.tables().values()))
        return {str(name): [row[k] for row in body] for k, name in enumerate(header)}

    def saved(self, folder: Path | None) -> Self:
        """Write tables (CSV), figures (PNG, SVG) and a page into a folder; None writes none.

        Raises UsageError where they cannot be written.
        """
        if folder is None:
            return self
        from tdfscal.reporting.figures import style
        from tdfscal.reporting.html import render

        make_folder(folder)
        tables, drawings, report = self.tables(), self.drawings(), self.to_report()
        for name, rows in tables.items():
            save_rows(folder / name, rows)
        figures = [path.name for drawing in drawings for path in style.save(drawing, folder)]
        shown = tuple(Section(d.title, (), d.reading, d) for d in drawings)
        write_text(folder / PAGE, render(replace(report, sections=report.sections + shown)))
        return replace(self, files=(*tables, *figures, PAGE))


def processes(workers: int | None) -> int:
    """Return how many processes share the work: as asked for, else one per core.

    Raises UsageError for less than one.
    """
    at_least("--workers", 1 if workers is None else workers, 1)
    return workers or os.cpu_count() or 1
