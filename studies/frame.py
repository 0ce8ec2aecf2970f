"""What every study hands on: tables, figures, the paper's numbers beside its own; and its files."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.statistics import SAME, UNLIKELY, Estimate, drawn_alike
from tdfscal.errors import UsageError
from tdfscal.files.outputs import make_folder, replacing
from tdfscal.files.saving import write_text
from tdfscal.records import FloatArray
from tdfscal.reporting.layout import Block, Drawing, Facts, Items, Report, Section
from tdfscal.reporting.layout import Table as Shown

Cell = str | float | int | Estimate | None
#: Letters beside each other on a terminal, and on a page.
_TERMINAL, _PAGE = 80, 95
#: Of the document, and of the file among a study's that says whose folder it is.
FORMAT, DOCUMENT, PAGE = "tdfscal-study/1", "study.json", "study.html"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under named columns; the unit of a column stands after its comma.

    name : of its CSV file. left : columns of words. shown : on the page; else in the file only.
    """

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    left: int = 1
    shown: bool = True

    def blocks(self, width: int) -> list[Shown]:
        """As a report has it; columns beyond a width in letters go below, words whole."""
        cells = [list(self.columns), *(list(map(_text, row)) for row in self.rows)]
        widths = [2 + max(len(row[k]) for row in cells) for k in range(len(self.columns))]
        chosen, parts = list(range(self.left)), []
        for k in range(self.left, len(widths)):
            if len(chosen) > self.left and sum(widths[c] for c in (*chosen, k)) > width:
                parts.append(chosen)
                chosen = list(range(self.left))
            chosen.append(k)
        shown: list[Shown] = []
        for part in (*parts, chosen):
            head, *rows = (tuple(row[k] for k in part) for row in cells)
            shown.append(Shown("" if shown else self.caption, head, tuple(rows), self.left))
        return shown

    def csv(self) -> str:
        """Numbers to the last bit; a standard error and an interval have columns of their own."""
        parts = [_parts([row[k] for row in self.rows]) for k in range(len(self.columns))]
        head = [f"{c}{end}" for c, part in zip(self.columns, parts, strict=True) for end in part]
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(head)
        for row in self.rows:
            values = [_values(cell, part) for cell, part in zip(row, parts, strict=True)]
            writer.writerow([value for each in values for value in each])
        return f"# tdfscal study, {self.name}: {self.caption}\n{stream.getvalue()}"

    def document(self) -> list[dict[str, Any]]:
        """Rows by column."""
        return [dict(zip(self.columns, map(_plain, row), strict=True)) for row in self.rows]


@dataclass(frozen=True, slots=True)
class Beside:
    """A number of the paper that could have come out otherwise, beside ours.

    figure, quantity, unit. paper : as printed; bound : the paper's is a limit, ">" or "<".
    here : mean over the runs. draws : (N,), of each run, where the paper's number is of one rig as
    each of ours is: then it is asked where it lies among them; None: it is a mean as ours is.
    """

    figure: str
    quantity: str
    unit: str
    paper: float
    here: Estimate
    bound: str = ""
    draws: FloatArray | None = None

    @property
    def own(self) -> FloatArray:
        """Draws that there are (N,)."""
        return np.empty(0) if self.draws is None else self.draws[np.isfinite(self.draws)]

    @property
    def probability(self) -> float:
        """That one more run lies as far out as the paper's number; NaN where none can be told.

        Beyond a bound: that one more run keeps it.
        """
        return drawn_alike(self.paper, self.own, self.bound)

    @property
    def verdict(self) -> str:
        """Whether ours is the paper's; by the spread of the runs alone."""
        if np.isnan(self.here.value):
            return "no result"
        if self.draws is not None:
            p = self.probability
            return "undecided" if np.isnan(p) else "differs" if p < UNLIKELY else "possible"
        off, spread = self.here.value - self.paper, SAME * float(np.nan_to_num(self.here.std))
        if self.bound:
            off = -off if self.bound == ">" else off
            return "agrees" if off <= -spread else "differs" if off > spread else "undecided"
        return "agrees" if abs(off) <= spread else "differs"

    def row(self) -> tuple[Cell, ...]:
        """Of the table of all."""
        what = f"{self.quantity}, {self.unit}".removesuffix(", ")
        printed, p = f"{self.bound} {self.paper:.4g}".strip(), self.probability
        chance = "" if np.isnan(p) else f"{p:.2g}"
        return (self.figure, what, printed, self.here, chance, self.verdict)


@dataclass(frozen=True, slots=True)
class Study:
    """A study that was run.

    chosen : inputs that the paper does not give, and what of its numbers follows from them: name,
    value, reason or source. notes : sentences, each made of numbers of a run.
    """

    name: str
    title: str
    subtitle: str
    tables: tuple[Table, ...]
    beside: tuple[Beside, ...] = ()
    chosen: tuple[tuple[str, str, str], ...] = ()
    notes: tuple[str, ...] = ()
    drawings: tuple[Drawing, ...] = ()

    @property
    def all_tables(self) -> tuple[Table, ...]:
        """With those of the paper's numbers and of what was chosen."""
        found = list(self.tables)
        if self.beside:
            columns = ("where", "what", "paper", "here", "chance", "verdict")
            rows = tuple(each.row() for each in self.beside)
            found.append(Table("paper", "The paper's numbers beside ours", columns, rows, left=2))
        if self.chosen:
            head = ("chosen, since the paper does not say", "value", "why, or what follows")
            found.append(Table("chosen", "Inputs, not results", head, self.chosen, left=3))
        return tuple(found)

    @property
    def conclusion(self) -> str:
        """How many of the paper's numbers came out how; empty where none could differ."""
        if not self.beside:
            return ""
        verdicts = Counter(item.verdict for item in self.beside).most_common()
        counted = ", ".join(f"{count} {verdict}" for verdict, count in verdicts)
        return f"The paper's numbers that could have come out otherwise: {counted}."

    def report(self, width: int = _TERMINAL) -> Report:
        """Lay it out in words, figures and tables: what comes of it first."""
        tables: list[Block] = []
        for table in self.all_tables:
            if table.name == "chosen":
                tables.append(Facts(tuple((what, f"{v}; {why}") for what, v, why in self.chosen)))
            elif table.shown:
                tables += table.blocks(width)
        sections = [Section(d.title, (), d.reading, d) for d in self.drawings]
        sections.append(Section("Tables", tuple(tables)))
        if self.notes:
            sections.insert(0, Section("What the runs say", (Items("", self.notes),)))
        return Report(self.title, self.subtitle, claim=self.conclusion, sections=tuple(sections))

    def document(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "format": FORMAT,
            "name": self.name,
            "title": self.title,
            "setting": self.subtitle,
            "tables": {table.name: table.document() for table in self.all_tables if table.shown},
            "notes": list(self.notes),
        }

    def write(self, folder: Path) -> tuple[str, ...]:
        """Write tables (CSV), figures (PNG, PDF, SVG), page and document; return their names.

        Raises UsageError where the folder holds anything but a study, or cannot be written.
        """
        from tdfscal.reporting.html import render

        make_folder(folder)
        names = []
        for table in self.all_tables:
            names.append(f"{table.name}.csv")
            write_text(folder / names[-1], table.csv())
        figures = [p.name for drawing in self.drawings for p in save_drawing(drawing, folder)]
        write_text(folder / PAGE, render(self.report(_PAGE)))
        text = json.dumps(self.document(), ensure_ascii=False, allow_nan=False, indent=1)
        write_text(folder / DOCUMENT, text + "\n")
        return (*names, *figures, PAGE, DOCUMENT)


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds anything but a study, lest an input be replaced.

    Raises UsageError.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError("is no folder", where=str(folder), hint="name another with -o")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / DOCUMENT).is_file():
        raise UsageError(
            "the folder holds other files than a study's",
            where=str(folder),
            hint="name a new folder with -o",
        )


def _text(cell: Cell) -> str:
    if cell is None:
        return "–"
    return f"{cell:.4g}".replace("-", "−") if isinstance(cell, float) else str(cell)


def _plain(cell: Cell) -> Any:
    if isinstance(cell, Estimate):
        return {"value": _finite(cell.value), "standard_error": _finite(cell.std)}
    return _finite(cell) if isinstance(cell, float) else cell


def _parts(column: Iterable[Cell]) -> tuple[str, ...]:
    """Ends of the names of a column's own columns."""
    return ("", " standard error") if any(isinstance(c, Estimate) for c in column) else ("",)


def _values(cell: Cell, parts: tuple[str, ...]) -> tuple[Any, ...]:
    plain = _plain(cell)
    values = tuple(plain.values()) if isinstance(plain, dict) else (plain,)
    return (*values, *(None,) * (len(parts) - len(values)))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def save_drawing(drawing: Drawing, folder: Path) -> tuple[Path, ...]:
    """Write a figure as PNG, PDF and SVG; return the paths. Raises UsageError where that fails."""
    from tdfscal.reporting.figures.style import DPI, look, to_svg

    png, pdf, svg = (folder / f"{drawing.name}.{suffix}" for suffix in ("png", "pdf", "svg"))
    with replacing(png) as image, replacing(pdf) as page, look():
        drawn = drawing.paint()
        drawn.savefig(image, format="png", dpi=DPI)
        drawn.savefig(page, format="pdf", dpi=DPI, metadata={"CreationDate": None})
    write_text(svg, '<?xml version="1.0" encoding="utf-8"?>\n' + to_svg(drawing) + "\n")
    return png, pdf, svg
