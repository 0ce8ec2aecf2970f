"""A report as plain text, readable without colour and by a screen reader; with colours, framed."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from tdfscal.reporting.layout import LISTED, Block, Facts, Report, Table, legible

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 80
#: Lines of a terminal; of them those of the files that were written.
LINES, _FILES = 24, 2
_LEAST_WIDTH = 40
_NARROWEST = 8


def render(report: Report, *, whole: bool = True) -> str:
    """Return the report in 80 columns, or fewer on a narrow terminal; else its summary."""
    report = legible(report)
    lines = wrapped(f"{report.title}: {report.verdict}" if report.verdict else report.title, "", "")
    lines += wrapped(report.subtitle, "", "")
    lines += wrapped(report.claim, "", "")
    lines += _bullets(report.reasons)
    for caption, body in _parts(report, len(lines), whole=whole):
        lines += ["", *caption, *body]
    return "\n".join(lines) + "\n"


def shown(report: Report, *, whole: bool = True) -> str:
    """Return the report as standard output shows it; NO_COLOR and TERM=dumb are obeyed."""
    if not sys.stdout.isatty():
        return render(report, whole=whole)
    from rich.console import Console

    console = Console(highlight=False, width=width())
    with console.capture() as printed:
        show_on(console, report, whole=whole)
    return printed.get()


def show_on(console: Console, report: Report, *, whole: bool = True) -> None:
    """Print a report on a console that understands styles: the verdict framed, captions bold."""
    from rich.panel import Panel
    from rich.text import Text

    report = legible(report)
    colour = "red" if not report.accepted else "yellow" if report.provisional else "green"
    head = Text(report.subtitle)
    if report.verdict:
        head = Text.assemble(
            (f"{report.mark} {report.verdict}", f"bold {colour}"), f"  {report.subtitle}"
        )
    if report.claim:
        head.append(f"\n{report.claim}")
    for reason in report.reasons:
        head.append(f"\n- {reason}")
    frame = Panel(head, title=Text(report.title), title_align="left", border_style=colour)
    above = console.render_lines(frame, pad=False)
    console.print(frame)
    # A prompt's line comes after it.
    for k, (caption, body) in enumerate(_parts(report, len(above) + 1, whole=whole)):
        if k and whole:
            console.print()
        for line in caption:
            console.print(Text(line, style="bold"))
        console.print(Text("\n".join(body)))


def _parts(report: Report, above: int, *, whole: bool) -> Iterator[tuple[list[str], list[str]]]:
    """Captions and lines of a report's blocks, warnings and advice.

    above : lines of what stands before them. In a summary, warnings and advice share what is left
    of a terminal's lines.
    """
    found = [parts(block) for block in report.blocks(whole=whole)]
    captions, lists = ("Warnings", "What next"), (report.warnings, report.advice)
    sentences = [[wrapped(f"- {item}") for item in items] for items in lists]
    counts = [len(items) for items in sentences]
    if report.summary and not whole:
        room = LINES - _FILES - above - sum(1 + len(c) + len(b) for c, b in found)
        counts = _fitting(sentences, room)
        if not report.accepted:  # and what would mend it is not left out
            counts[-1] = len(report.advice)
    yield from found
    shown, cut, unseen = "-v or --html FILE shows", " … (-v)", list[str]()
    for caption, items, count in zip(captions, sentences, counts, strict=True):
        if items and not count:
            hidden = f"{len(items)}; {shown} them"
            if len(items) == 1:  # its begin says more than that there is one
                hidden = " ".join(items[0]).strip(" -")
            unseen = [textwrap.shorten(f"{caption}: {hidden}", width(), placeholder=cut)]
        elif items:
            rest = [f"  … {len(items) - count} more: {shown} all"] if count < len(items) else []
            if count == len(items) - 1:  # its line says as much as that there is one
                begun = " ".join(items[count])
                rest = [f"  {textwrap.shorten(begun, width() - 2, placeholder=cut)}"]
            above_it, unseen = unseen, []
            yield [*above_it, caption], [*(line for item in items[:count] for line in item), *rest]
    if unseen:
        yield unseen, []
    if report.number and (whole or not report.summary):
        yield [f"Report {report.number}"], []


def _fitting(lists: Sequence[Sequence[list[str]]], room: int) -> list[int]:
    """How many sentences of each list fit so many lines: first one of each, the last list first."""
    counts = [0, *(min(1, len(items)) for items in lists[1:])]

    def taken() -> int:
        return sum(
            1 + (count > 0) + sum(map(len, items[:count])) + (0 < count < len(items))
            for items, count in zip(lists, counts, strict=True)
            if items
        )

    for most in (1, LISTED):
        for k in reversed(range(len(lists))):
            while counts[k] < min(most, len(lists[k])):
                counts[k] += 1
                if taken() > room:
                    counts[k] -= 1
                    break
    return counts


def width() -> int:
    """Columns to write: 80, or what COLUMNS or the terminal says where that is less."""
    return min(WIDTH, max(_LEAST_WIDTH, shutil.get_terminal_size((WIDTH, 24)).columns))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Align columns: the first `left` to the left, the others to the right.

    Where they do not fit the width, the widest column of words gives way; where that is not
    enough, columns go on below, with those at the left repeated.
    """
    cells = [list(header), *(list(row) for row in rows)]
    words = [c for c in range(len(header)) if c < left or not _numeric(row[c] for row in rows)]
    widths = [max(len(row[c]) for row in cells) for c in range(len(header))]
    room, whole = width(), widths.copy()
    while words and 2 * len(widths) + sum(widths) > room:
        widest = max(words, key=lambda c: widths[c])
        if widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    if 2 * len(widths) + sum(widths) > room:  # it folds anyhow: then as little as can be is cut
        beside = sum(taken + 2 for taken in widths[:left])
        fits = [c >= left and beside + whole[c] + 2 <= room for c in range(len(widths))]
        widths = [w if fit else n for w, n, fit in zip(whole, widths, fits, strict=True)]
    lines: list[str] = []
    for chosen in _folded(widths, left, room):
        lines += [""] if lines else []
        for row in cells:
            fitted = (_fit(row[c], widths[c]) for c in chosen)
            aligned = (
                cell.ljust(widths[c]) if c < left else cell.rjust(widths[c])
                for c, cell in zip(chosen, fitted, strict=True)
            )
            lines.append("  " + "  ".join(aligned).rstrip())
    return lines


def _folded(widths: Sequence[int], left: int, room: int) -> Iterator[list[int]]:
    """Columns of each part of a table that is too wide."""
    fixed = list(range(left))
    chosen = fixed.copy()
    for c in range(left, len(widths)):
        if len(chosen) > left and sum(widths[k] + 2 for k in (*chosen, c)) > room:
            yield chosen
            chosen = fixed.copy()
        chosen.append(c)
    yield chosen


def _numeric(column: Iterable[str]) -> bool:
    return all(not cell or not cell[0].isalpha() for cell in column)


def _fit(cell: str, room: int) -> str:
    """Cut from the middle, where names differ least."""
    if len(cell) <= room:
        return cell
    tail = (room - 1) // 2
    return f"{cell[: room - 1 - tail]}…{cell[len(cell) - tail :]}"


def wrapped(text: str, indent: str = "  ", hanging: str = "  ") -> list[str]:
    """Fold a paragraph to the width."""
    return textwrap.wrap(
        text,
        width(),
        initial_indent=indent,
        subsequent_indent=indent + hanging,
        break_on_hyphens=False,
    )


def _bullets(items: Iterable[str]) -> list[str]:
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
    return caption, _bullets(block.items)


def _facts(facts: Facts) -> list[str]:
    label = max((len(name) for name, _ in facts.rows), default=0)
    return [
        line
        for name, text in facts.rows
        for line in wrapped(f"{name.ljust(label)}  {text}", "", " " * (label + 2))
    ]
