"""Plain text in 80 columns: readable without colour, in a file, and by a screen reader."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from tdfscal.files.calibration.document import Calibration
from tdfscal.reporting.summary import Summary, summarise

WIDTH = 80
_NARROWEST = 8


def render(calibration: Calibration) -> str:
    """One calibration as text."""
    return "\n".join(_lines(summarise(calibration))) + "\n"


def table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Align columns: the first `left` to the left, the others to the right.

    Where they do not fit the width, the widest column of words gives way.
    """
    cells = [list(header), *(list(row) for row in rows)]
    words = [c for c in range(len(header)) if c < left or not _numeric(row[c] for row in rows)]
    widths = [max(len(row[c]) for row in cells) for c in range(len(header))]
    while words and 2 * len(widths) + sum(widths) > WIDTH:
        widest = max(words, key=lambda c: widths[c])
        if widths[widest] <= _NARROWEST:
            break
        widths[widest] -= 1
    return [
        "  "
        + "  ".join(
            _fit(cell, width).ljust(width) if c < left else _fit(cell, width).rjust(width)
            for c, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]


def _numeric(column: Iterable[str]) -> bool:
    return all(not cell or not cell[0].isalpha() for cell in column)


def _fit(cell: str, width: int) -> str:
    """Cut from the middle, where names differ least."""
    if len(cell) <= width:
        return cell
    tail = (width - 1) // 2
    return f"{cell[: width - 1 - tail]}…{cell[len(cell) - tail :]}"


def wrapped(text: str, indent: str = "  ", hanging: str = "  ") -> list[str]:
    """Fold a paragraph to the width."""
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + hanging,
        break_long_words=False,
    )


def _lines(s: Summary) -> list[str]:
    lines = [f"{s.title}: {s.verdict}", *wrapped(s.subtitle, "", "")]
    lines += [line for reason in s.reasons for line in wrapped(f"- {reason}")]
    lines += ["", s.angle_title]
    lines += table(*s.angle_table(), left=2)
    if s.zeros:
        lines += ["", "Zero offsets, N", *table(["sensor", "x", "y", "z"], s.zeros)]
    if s.proof:
        lines += [
            "",
            "Contact wrench that remains at postures held out, about the LCS origin",
            *table(["", "rms before", "rms after", "largest before", "largest after"], s.proof),
        ]
    lines.append("")
    label = max((len(name) for name, _ in s.facts), default=0)
    for name, text in s.facts:
        lines += wrapped(f"{name.ljust(label)}  {text}", "", " " * (label + 2))
    for heading, items in (
        ("Rejected postures", s.rejected),
        ("Warnings", s.warnings),
        ("What next", s.advice),
    ):
        if items:
            lines += ["", heading]
            lines += [line for item in items for line in wrapped(f"- {item}")]
    return lines
