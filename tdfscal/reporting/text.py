"""A report as plain text, readable without colour and by a screen reader."""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence

from tdfscal.catalogue.numbers import FIXED
from tdfscal.reporting.layout import Block, Facts, Report, Table, legible

#: A line of text, and how a terminal shows it.
Line = tuple[str, str]
WIDTH = 80
_LISTS = ("Warnings", "What next")
#: Lines of a terminal; of them those of the files that were written.
LINES, _FILES = 24, 2
_LEAST_WIDTH = 40
#: Columns that facts need beside their names; else they stand below.
_BESIDE = 32


def render(report: Report, *, whole: bool = True) -> str:
    """Return the report in 80 columns, or fewer on a narrow terminal; else its summary."""
    return "".join(f"{line}\n" for line, _ in _lines(report, whole=whole))


def shown(report: Report, *, whole: bool = True) -> str:
    """Return the same as standard output shows it: on a terminal verdict and captions stand out.

    NO_COLOR and TERM=dumb are obeyed.
    """
    if not sys.stdout.isatty():
        return render(report, whole=whole)
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, width=width())
    with console.capture() as printed:
        for line, style in _lines(report, whole=whole):
            console.print(Text(line, style=style), soft_wrap=True)
    return printed.get()


def _lines(report: Report, *, whole: bool) -> list[Line]:
    """Verdict, reasons, blocks, warnings, what next."""
    report = legible(report, "-")
    colour = "red" if not report.accepted else "yellow" if report.provisional else "green"
    title = f"{report.title}: {report.verdict}" if report.verdict else report.title
    lines = [(line, f"bold {colour}") for line in wrapped(title, "", "")]
    for paragraph in (report.subtitle, report.claim):
        lines += _plain(wrapped(paragraph, "", ""))
    lines += _plain(bullets(report.reasons))
    for block in report.blocks(whole=whole):
        lines += _captioned(*parts(block))
    short = bool(report.summary) and not whole
    room = LINES - _FILES - len(lines) if short else math.inf
    kept, spaced = _fitting(report, room), True
    for caption, items, count in zip(_LISTS, (report.warnings, report.advice), kept, strict=True):
        if count < len(items):
            first = {0: "", 1: "the first of "}.get(count, f"the first {count} of ")
            caption += f" ({first}{len(items)}; -v shows all)"
        if items:
            lines += _captioned([caption], bullets(items[:count]))[not spaced :]
            spaced = count > 0
    if report.number and not short:
        lines += _captioned([f"Report {report.number}"], [])
    return lines


def _plain(lines: Iterable[str]) -> list[Line]:
    return [(line, "") for line in lines]


def _captioned(caption: Sequence[str], body: Sequence[str]) -> list[Line]:
    return [("", ""), *((line, "bold") for line in caption), *_plain(body)]


def _fitting(report: Report, room: float) -> list[int]:
    """How many warnings and how much of what next fit into so many lines: warnings give way first.

    What would mend a rejected result is never left out.
    """
    lists = [
        [len(wrapped(f"- {item}")) for item in items] for items in (report.warnings, report.advice)
    ]
    kept = [len(items) for items in lists]
    least = (0, min(1, kept[1]) if report.accepted else kept[1])

    def taken() -> int:
        each = zip(lists, kept, strict=True)
        return sum(1 + (n > 0) + sum(items[:n]) for items, n in each if items)

    for k, floor in ((0, 1), (1, least[1]), (0, 0)):
        while kept[k] > floor and taken() > room:
            kept[k] -= 1
    return kept


def width() -> int:
    """Columns to write: 80, or what COLUMNS or the terminal says where that is less."""
    return min(WIDTH, max(_LEAST_WIDTH, shutil.get_terminal_size((WIDTH, 24)).columns))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Align columns: the first `left` to the left, the others to the right.

    What is wider than half a line is cut; where columns do not fit beside each other, they go on
    below, with those at the left repeated.
    """
    room = width()
    cells = [[_fit(cell.replace(FIXED, " "), room // 2) for cell in row] for row in (header, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    fixed = list(range(left))
    parts = [fixed.copy()]
    for c in range(left, len(widths)):
        if len(parts[-1]) > left and sum(widths[k] + 2 for k in (*parts[-1], c)) > room:
            parts.append(fixed.copy())
        parts[-1].append(c)
    aligned = [
        [cell.ljust(w) if c < left else cell.rjust(w)
         for c, (cell, w) in enumerate(zip(row, widths, strict=True))]
        for row in cells
    ]  # fmt: skip
    folded = [
        ["  " + "  ".join(row[c] for c in part).rstrip() for row in aligned] for part in parts
    ]
    return [line for part in folded for line in ("", *part)][1:]


def _fit(cell: str, room: int) -> str:
    """Cut from the middle, where names differ least."""
    if len(cell) <= room:
        return cell
    tail = (room - 1) // 2
    return f"{cell[: room - 1 - tail]}…{cell[len(cell) - tail :]}"


def wrapped(text: str, indent: str = "  ", hanging: str = "  ") -> list[str]:
    """Fold a paragraph to the width."""
    lines = textwrap.wrap(
        text,
        width(),
        initial_indent=indent,
        subsequent_indent=indent + hanging,
        break_on_hyphens=False,
    )
    return [line.replace(FIXED, " ") for line in lines]


def bullets(items: Iterable[str]) -> list[str]:
    """A list, each item folded to the width."""
    return [line for item in items for line in wrapped(f"- {item}")]


def parts(block: Block) -> tuple[list[str], list[str]]:
    """Lines of a block's caption, and of what stands under it."""
    if isinstance(block, str):
        return [], wrapped(block, "", "")
    if isinstance(block, Facts):
        return [], _facts(block)
    caption = wrapped(block.caption, "", "")
    if isinstance(block, Table):
        return caption, table(block.header, block.rows, block.left)
    return caption, bullets(block.items)


def _facts(facts: Facts) -> list[str]:
    label = max((len(name) for name, _ in facts.rows), default=0)
    if width() - label < _BESIDE:
        each = ((wrapped(name, "", ""), wrapped(text)) for name, text in facts.rows)
        return [line for name, text in each for line in (*name, *text)]
    return [
        line
        for name, text in facts.rows
        for line in wrapped(f"{name.ljust(label)}  {text}", "", " " * (label + 2))
    ]
