"""A report on standard output: tables by rich on a terminal, plain text elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tdfscal.reporting.layout import Block, Facts, Items, Report, Table, legible
from tdfscal.reporting.text import WIDTH, render

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


def show(report: Report) -> None:
    """Print a report; NO_COLOR and TERM=dumb are obeyed."""
    if not sys.stdout.isatty():
        sys.stdout.write(render(report))
        return
    from rich.console import Console

    console = Console(highlight=False)
    console.width = min(console.width, WIDTH)
    show_on(console, report)


def show_on(console: Console, report: Report) -> None:
    """Print a report on a console that understands styles."""
    from rich.padding import Padding
    from rich.panel import Panel
    from rich.text import Text

    report = legible(report)
    colour = "green" if report.accepted else "red"
    head = Text(report.subtitle)
    if report.verdict:
        mark = "✓" if report.accepted else "✗"
        head = Text.assemble((f"{mark} {report.verdict}", f"bold {colour}"), f"  {report.subtitle}")
    if report.claim:
        head.append(f"\n{report.claim}")
    for reason in report.reasons:
        head.append(f"\n- {reason}")
    console.print(Panel(head, title=Text(report.title), title_align="left", border_style=colour))
    for block in (*report.brief(), *report.closing()):
        if isinstance(block, Items):
            console.print(Text(f"\n{block.caption}", style="bold"))
            for item in block.items:
                console.print(Padding(Text(f"- {item}"), (0, 0, 0, 1)))
        else:
            console.print(_renderable(block))


def _renderable(block: Block) -> RenderableType:
    from rich import box
    from rich.table import Table as Rich
    from rich.text import Text

    if isinstance(block, Table):
        title, header, left, rows = block.caption, block.header, block.left, block.rows
    elif isinstance(block, Facts):
        title, header, left, rows = "", ("", ""), 2, block.rows
    else:
        return Text(f"\n{block}")
    table = Rich(
        title=Text(title) if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
        show_header=isinstance(block, Table),
    )
    for place, name in enumerate(header):
        # Where it is narrow, the last column, of words, gives way.
        last = place == len(header) - 1
        table.add_column(name, justify="left" if place < left else "right", no_wrap=not last)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table
