"""What a report says, laid out once: words, tables and figures in the order of reading.

A builder turns a result into a `Report`; `text` and `html` print any report, and
add nothing of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, cast

from tdfscal.errors import visible
from tdfscal.records import ANGLES
from tdfscal.reporting.figures.drawing import Drawing as Drawing

Row = tuple[str, ...]


LISTED = 8
"""Sentences of a list that a terminal shows at most; two lists of them fill half a screen."""
ROWS = 10
"""Rows of a summary's table: with what stands above and below they fit a terminal's 24 lines."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a header; the first `left` columns are words, the others numbers."""

    caption: str
    header: Row
    rows: tuple[Row, ...]
    left: int = 1

    def brief(self) -> Table:
        """The same, cut to `ROWS` rows and the number of the others."""
        more = len(self.rows) - ROWS
        if more <= 0:
            return self
        last = (f"… {more} more", *[""] * (len(self.header) - 1))
        return replace(self, rows=(*self.rows[:ROWS], last))


@dataclass(frozen=True, slots=True)
class Facts:
    """Names with what is to be said of each."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Items:
    """A list of sentences under a caption."""

    caption: str
    items: tuple[str, ...]

    def brief(self) -> Items:
        """The same, cut to `LISTED` sentences and the number of the others."""
        more = len(self.items) - LISTED
        if more <= 0:
            return self
        kept = (*self.items[:LISTED], f"… and {more} more; a page or JSON lists them all")
        return Items(self.caption, kept)


#: A str is a paragraph.
Block = Table | Facts | Items | str


@dataclass(frozen=True, slots=True)
class Section:
    """Blocks that belong together, on a page under a title, with a figure.

    reading : what the figure shows, one sentence. page_only : details that text leaves out.
    """

    title: str
    blocks: tuple[Block, ...] = ()
    reading: str = ""
    drawing: Drawing | None = None
    page_only: bool = False


@dataclass(frozen=True, slots=True)
class Report:
    """A result as a reader meets it: verdict, reasons, evidence, what next.

    verdict : one or two words in capitals; none where nothing is judged. accepted,
    provisional : its colour.
    claim : what was achieved, in a sentence. tiles : name, number, remark; seen at a glance.
    number : of the report, on every printed page.
    summary : blocks that a terminal shows in place of the sections, unless asked for all.
    """

    title: str
    subtitle: str = ""
    verdict: str = ""
    accepted: bool = True
    provisional: bool = False
    claim: str = ""
    reasons: tuple[str, ...] = ()
    tiles: tuple[Row, ...] = ()
    summary: tuple[Block, ...] = ()
    sections: tuple[Section, ...] = ()
    warnings: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    created: str = ""
    number: str = ""

    @property
    def mark(self) -> str:
        """The verdict at a glance."""
        return "✗" if not self.accepted else "!" if self.provisional else "✓"

    def blocks(self, *, whole: bool = True) -> Iterator[Block]:
        """Blocks of a rendering without pages; warnings and advice are its end."""
        if self.summary and not whole:
            for block in self.summary:
                yield block.brief() if isinstance(block, Table) else block
            return
        for section in self.sections:
            for block in () if section.page_only else section.blocks:
                yield block.brief() if isinstance(block, Items) else block


def by_angle(names: Iterable[str], cells: Callable[[int, int], Iterable[str]]) -> tuple[Row, ...]:
    """Rows of a sensor's and an angle's name with the cells of this sensor and angle."""
    return tuple(
        (name, angle, *cells(i, j))
        for i, name in enumerate(names)
        for j, angle in enumerate(ANGLES)
    )


def legible(report: Report) -> Report:
    """The same with every character that does not print as a visible escape.

    Names, paths and foreign files may hold anything; drawings make outlines of their text.
    """
    return cast(Report, _mapped(report))


def _mapped(part: object) -> object:
    if isinstance(part, str):
        return visible(part)
    if isinstance(part, tuple):
        return tuple(map(_mapped, part))
    if isinstance(part, Report | Section | Table | Facts | Items):
        changes: dict[str, Any] = {f.name: _mapped(getattr(part, f.name)) for f in fields(part)}
        return type(part)(**changes)
    return part


def illustrated(
    drawings: tuple[Drawing, ...], blocks: Mapping[str, tuple[Block, ...]]
) -> list[Section]:
    """Sections of figures with the blocks beside them, by the figure's name; then blocks alone."""
    sections = [Section(d.title, blocks.get(d.name, ()), d.reading, d) for d in drawings]
    drawn = {drawing.name for drawing in drawings}
    alone = (beside for name, beside in blocks.items() if beside and name not in drawn)
    return [*sections, *(Section("", beside) for beside in alone)]
