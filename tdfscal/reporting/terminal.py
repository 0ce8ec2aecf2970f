"""A calibration on standard output: tables by rich on a terminal, plain text elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.summary import summarise
from tdfscal.reporting.text import WIDTH, render

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def show(calibration: Calibration) -> None:
    """Print one calibration; NO_COLOR and TERM=dumb are obeyed."""
    if not sys.stdout.isatty():
        sys.stdout.write(render(calibration))
        return
    from rich.console import Console

    console = Console(highlight=False)
    console.width = min(console.width, WIDTH)
    show_on(console, calibration)


def show_on(console: Console, calibration: Calibration) -> None:
    """Print one calibration on a console that understands styles."""
    from rich.padding import Padding
    from rich.panel import Panel
    from rich.text import Text

    s = summarise(calibration)
    colour = "green" if s.accepted else "red"
    mark = "✓" if s.accepted else "✗"
    head = Text.assemble((f"{mark} {s.verdict}", f"bold {colour}"), f"  {s.subtitle}")
    for reason in s.reasons:
        head.append(f"\n- {reason}")
    console.print(Panel(head, title=Text(s.title), title_align="left", border_style=colour))
    console.print(_rows(s.angle_title, *s.angle_table(), left=2))
    if s.zeros:
        console.print(_rows("Zero offsets, N", ("sensor", "x", "y", "z"), s.zeros))
    if s.proof:
        header = ("", "rms before", "rms after", "largest before", "largest after")
        console.print(_rows("Contact wrench left at postures held out", header, s.proof))
    facts = _rows("", ("", ""), s.facts)
    facts.show_header = False
    facts.columns[1].justify = "left"
    console.print(facts)
    for heading, items in (
        ("Rejected postures", s.rejected),
        ("Warnings", s.warnings),
        ("What next", s.advice),
    ):
        if items:
            console.print(Text(f"\n{heading}", style="bold"))
            for item in items:
                console.print(Padding(Text(f"- {item}"), (0, 0, 0, 1)))


def _rows(
    title: str,
    header: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
    left: int = 1,
) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title) if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    for place, name in enumerate(header):
        # Where it is narrow, the last column, of words, gives way.
        last = place == len(header) - 1
        table.add_column(name, justify="left" if place < left else "right", no_wrap=not last)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table
