"""What the results of all studies share: their files, and tables made of plain rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tdfscal.files.saving import make_folder, write_text
from tdfscal.files.writers.rows import save_rows
from tdfscal.reporting.layout import Report, Section
from tdfscal.reporting.studies import Row

if TYPE_CHECKING:
    import pandas as pd

    from tdfscal.reporting.figures.style import Drawing


def frame_of(rows: Iterable[Row]) -> pd.DataFrame:
    """Return a table of rows, the first of which names the columns."""
    import pandas as pd

    header, *body = rows
    return pd.DataFrame(body, columns=[str(name) for name in header])


PAGE = "study.html"


def write_study(
    folder: Path,
    tables: Mapping[str, Iterable[Row]],
    drawings: Sequence[Drawing],
    report: Report,
) -> list[str]:
    """Write tables (CSV), figures (PNG, SVG) and a page into a folder; return their names.

    Raises UsageError where they cannot be written.
    """
    from tdfscal.reporting.figures import style
    from tdfscal.reporting.html import render

    make_folder(folder)
    for name, rows in tables.items():
        save_rows(folder / name, rows)
    files = list(tables)
    for drawing in drawings:
        files += [path.name for path in style.save(drawing, folder)]
    shown = tuple(Section(d.title, (), d.reading, d) for d in drawings)
    write_text(folder / PAGE, render(replace(report, sections=report.sections + shown)))
    return [*files, PAGE]
