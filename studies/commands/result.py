"""What all studies share: their counts checked, their tables of plain rows, their files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Self, cast

from tdfscal.checks.same_rig import require_agreement
from tdfscal.files.output_places import check_folder
from tdfscal.files.outputs import make_folder, protect
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.saving import save_rows, write_text
from tdfscal.reporting.layout import Drawing, Report, Section
from tdfscal.workflows.arguments import PathLike, at_least, one
from tdfscal.workflows.calibration import Calibration, CalibrationSource, read_source
from tdfscal.workflows.campaign import inputs_read, rig_named
from tdfscal.workflows.result import Result

#: The page among a study's files.
PAGE = "study.html"


@dataclass(frozen=True, slots=True, repr=False, kw_only=True)
class StudyResult(Result):
    """Base of the studies' results. files : that were written, by their names in the folder."""

    files: tuple[str, ...] = field(default=())

    #: Of the study, and of the module that lays it out.
    _name: ClassVar[str]

    def _content(self) -> tuple[Any, ...]:
        """What the functions of that module take."""
        return tuple(getattr(self, f.name) for f in fields(self) if f.name != "files")

    def _laid_out(self, what: str) -> Any:
        # The module draws: it is imported where it is needed.
        module = import_module(f"studies.reports.{self._name}")
        return getattr(module, what)(*self._content())

    def to_report(self) -> Report:
        """Return the study in words and tables."""
        return cast(Report, self._laid_out("report"))

    def to_dict(self) -> dict[str, Any]:
        """Return the study as plain JSON values, SI units."""
        name = f"tdfscal-study-{self._name.replace('_', '-')}/1"
        return {"format": name, **self._laid_out("document"), "files": list(self.files)}

    def tables(self) -> dict[str, Iterable[dict[str, Any]]]:
        """Return the rows of each CSV file, by their columns; the main table is the first."""
        return cast(dict[str, Iterable[dict[str, Any]]], self._laid_out("tables"))

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figures."""
        return cast(tuple[Drawing, ...], self._laid_out("drawings"))

    def table(self) -> dict[str, list[Any]]:
        """Return the first of `tables`."""
        rows = list(next(iter(self.tables().values())))
        return {name: [row[name] for row in rows] for name in rows[0]}

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
        for name, each in tables.items():
            rows = list(each)
            save_rows(folder / name, [tuple(rows[0]), *(tuple(row.values()) for row in rows)])
        figures = [path.name for drawing in drawings for path in style.save(drawing, folder)]
        shown = tuple(Section(d.title, (), d.reading, d) for d in drawings)
        write_text(folder / PAGE, render(replace(report, sections=report.sections + shown)))
        return replace(self, files=(*tables, *figures, PAGE))


def start(
    rig: PathLike, output: PathLike | None, *files: Path | None
) -> tuple[LoadedRig, Path | None]:
    """Load the rig, and look whether the folder can be written; files : what else is read.

    Raises UsageError, RigError.
    """
    folder = one(output)
    protect(inputs_read(rig=Path(rig), files=[file for file in files if file is not None]))
    loaded = rig_named(rig)
    if folder is not None:
        check_folder(folder)
    return loaded, folder


def calibrations_named(
    sources: Sequence[CalibrationSource], rig: LoadedRig, taken: Sequence[str] = ()
) -> dict[str, Calibration]:
    """Load calibrations of the rig; each goes by its file's name, numbered where that is taken.

    Raises UsageError for a calibration of another rig; else as `load_calibration`.
    """
    named: dict[str, Calibration] = {}
    for source in sources:
        path, loaded = read_source(source)
        require_agreement(loaded.loaded_rig(path).rig, rig.rig, path)
        name = Path(path).stem
        named[f"{name}-{len(named) + 1}" if name in (*named, *taken) else name] = loaded
    return named


def check_runs(runs: int, seed: int, least: int = 1) -> None:
    """Raise UsageError for too few runs, or a seed that is none."""
    at_least("--runs", runs, least)
    at_least("--seed", seed, 0)


def processes(workers: int | None) -> int:
    """Return how many processes share the work: as asked for, else one per core.

    Raises UsageError for less than one.
    """
    at_least("--workers", workers, 1)
    return workers or os.cpu_count() or 1
