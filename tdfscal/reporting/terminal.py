"""A report on standard output: with colours on a terminal, plain text elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from tdfscal.reporting.layout import Report, legible
from tdfscal.reporting.text import parts, render, width

if TYPE_CHECKING:
    from rich.console import Console


def show(report: Report) -> None:
    """Print a report; NO_COLOR and TERM=dumb are obeyed."""
    if not sys.stdout.isatty():
        sys.stdout.write(render(report))
        return
    from rich.console import Console

    show_on(Console(highlight=False, width=width()), report)


def show_on(console: Console, report: Report) -> None:
    """Print a report on a console that understands styles: the verdict framed, captions bold."""
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
        caption, body = parts(block)
        for line in caption:
            console.print(Text(line, style="bold"))
        console.print(Text("\n".join([*body, ""])))
