"""A report as plain text, readable without colour and by a screen reader."""

from __future__ import annotations

import math
import re
import sys
import textwrap
from collections.abc import Iterable, Sequence

from tdfscal.catalogue.numbers import FIXED
from tdfscal.reporting.layout import Block, Facts, Report, Table, legible

WIDTH = 80
#: Lines of a terminal; of them those of the files that were written.
LINES, _FILES = 24, 2


def render(report: Report, *, whole: bool = True) -> str:
    """Return verdict, reasons, blocks, warnings, what next in 80 columns; else its summary."""
    report = legible(report, "-")
    title = f"{report.title}: {report.verdict}" if report.verdict else report.title
    lines = [line for text in (title, report.subtitle, report.claim) for line in wrapped(text)]
    lines += bullets(report.reasons)
    for block in report.blocks(whole=whole):
        lines += ["", *_block(block)]
    short = bool(report.summary) and not whole
    room = LINES - _FILES - len(lines) if short else math.inf
    kept = _fitting(report.advice, room, 1 if report.accepted else len(report.advice))
    told = f" (the first {f'{kept} ' * (kept > 1)}of {len(report.advice)}; -v shows all)"
    caption = "What next" + told * (kept < len(report.advice))
    for name, items in (("Warnings", report.warnings), (caption, report.advice[:kept])):
        if items:
            lines += ["", name, *bullets(items)]
    if report.number and not short:
        lines += ["", f"Report {report.number}"]
    return "".join(f"{line}\n" for line in lines)


def shown(report: Report, *, whole: bool = True) -> str:
    """Return the same as standard output shows it: on a terminal the verdict has its colour.

    NO_COLOR and TERM=dumb are obeyed.
    """
    text = render(report, whole=whole)
    if not sys.stdout.isatty():
        return text
    from rich.console import Console
    from rich.text import Text

    colour = "red" if not report.accepted else "yellow" if report.provisional else "green"
    first, end, others = text.partition("\n")
    console = Console(highlight=False)
    with console.capture() as printed:
        console.print(Text(first, style=f"bold {colour}"), soft_wrap=True, end=end)
    return printed.get() + others


def _fitting(advice: Sequence[str], room: float, least: int) -> int:
    """How much of what next fits into so many lines.

    What would mend a rejected result is never left out.
    """
    kept = len(advice)
    while kept > least and 2 + len(bullets(advice[:kept])) > room:
        kept -= 1
    return kept


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Align columns: the first `left` to the left, the others to the right.

    What is wider than half a line is cut; where columns do not fit beside each other, they go on
    below, with those at the left repeated.
    """
    cells = [[_fit(cell.replace(FIXED, " ")) for cell in row] for row in (header, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    fixed = list(range(left))
    parts = [fixed.copy()]
    for c in range(left, len(widths)):
        if len(parts[-1]) > left and sum(widths[k] + 2 for k in (*parts[-1], c)) > WIDTH:
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


def _fit(cell: str, room: int = WIDTH // 2) -> str:
    """Cut from the middle, where names differ least."""
    if len(cell) <= room:
        return cell
    tail = (room - 1) // 2
    return f"{cell[: room - 1 - tail]}…{cell[len(cell) - tail :]}"


def wrapped(text: str, indent: str = "", hanging: str = "") -> list[str]:
    """Fold a paragraph to the width; what stands in backticks is pasted, and never broken."""
    lines = textwrap.wrap(
        re.sub("`[^`]*`", lambda code: code[0].replace(" ", FIXED), text),
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + hanging,
        break_on_hyphens=False,
        break_long_words="`" not in text,
    )
    return [line.replace(FIXED, " ") for line in lines]


def bullets(items: Iterable[str]) -> list[str]:
    """A list, each item folded to the width."""
    return [line for item in items for line in wrapped(f"- {item}", "  ", "  ")]


def _block(block: Block) -> list[str]:
    """Lines of a block, its caption first."""
    if isinstance(block, str):
        return wrapped(block)
    if isinstance(block, Facts):
        label = max((len(name) for name, _ in block.rows), default=0)
        named = ((f"{name.ljust(label)}  {text}", " " * (label + 2)) for name, text in block.rows)
        return [line for text, hanging in named for line in wrapped(text, "", hanging)]
    if isinstance(block, Table):
        return [*wrapped(block.caption), *table(block.header, block.rows, block.left)]
    return [*wrapped(block.caption), *bullets(block.items)]
