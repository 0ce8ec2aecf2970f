"""The log's timeline: dwells in use, rejected ones with their reasons, stretches left out."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import PostureTable
from tdfscal.files.calibration.log_time import clock
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.reporting.figures.style import FILLS, GREY, INK, PALE, RED, Drawing, figure, raster

SHOWN = 8
"""Reasons that the figure itself carries; a longer list belongs beside it."""
_CHARS = 96


def draw(c: Calibration) -> Drawing | None:
    """Lanes over the time of the log."""
    table = c.postures
    if table is None or not table.index:
        return None
    rejected = [r for r in (c.fit.rejected if c.fit else ()) if r.start is not None]
    total = len(table.index) + len(rejected)
    averaged = float(np.sum(np.array(table.end) - np.array(table.start)))
    said = f"{len(table.index)} of {total} dwells are in the fit"
    if clock(c).unit == "s":
        said += f", {averaged:.0f} s of force readings in all"
    said += f"; {len(rejected)} had to be rejected." if rejected else "; none had to be rejected."
    return Drawing("timeline", "The log and its dwells", said, lambda: _paint(c, table, rejected))


def _paint(c: Calibration, table: PostureTable, rejected: list[RejectedPosture]) -> Figure:
    time = clock(c)
    width = 0.9 if time.unit == "row" else 0.0
    lanes = ["in the fit", "rejected"] + (["no dwell"] if table.left_out else [])
    notes = _notes(c, rejected)
    fig = figure(0.75 + 0.34 * len(lanes) + 0.155 * (notes.count("\n") + 1 if notes else 0))
    ax = fig.subplots()
    pixels = raster(len(table.index))
    spans = [
        (s - time.origin, max(e - s, width)) for s, e in zip(table.start, table.end, strict=True)
    ]
    line = 0.0 if pixels else 0.5
    ax.broken_barh(
        spans, (-0.36, 0.72), facecolor=FILLS[0], edgecolor=INK, linewidth=line, rasterized=pixels
    )
    for r in rejected:
        if r.start is None or r.end is None:
            continue
        x, w = r.start - time.origin, max(r.end - r.start, width)
        ax.broken_barh(
            [(x, w)], (0.64, 0.72), facecolor="white", edgecolor=RED, hatch="////", linewidth=0.9
        )
        ax.annotate(
            f"{r.index + 1}",
            (x + w, 1),
            xytext=(2, 0),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
            fontweight="bold",
        )
    if not rejected:
        ax.text(0.01, 1, "none", transform=ax.get_yaxis_transform(), va="center", color=GREY)
    for piece in table.left_out or ():
        ax.broken_barh(
            [(piece.start - time.origin, max(piece.end - piece.start, width))],
            (1.64, 0.72),
            facecolor=PALE,
            edgecolor=GREY,
            hatch="...",
            linewidth=0.4,
        )
    ax.set_ylim(len(lanes) - 0.45, -0.5)
    ax.set_yticks(range(len(lanes)), lanes)
    ax.set_xlabel(time.label + (f"\n\n{notes}" if notes else ""), loc="left" if notes else "center")
    ax.grid(axis="y", visible=False)
    return fig


def _notes(c: Calibration, rejected: list[RejectedPosture]) -> str:
    """Reasons, numbered as the marks are."""
    time = clock(c)
    lines = []
    for r in rejected[:SHOWN]:
        where = time.stretch(r.start or 0.0, r.end or 0.0)
        lines += textwrap.wrap(
            f"Posture {r.index + 1} ({where}): {r.reason}", _CHARS, subsequent_indent="     "
        )
    if len(rejected) > SHOWN:
        lines.append(f"and {len(rejected) - SHOWN} more")
    return "\n".join(lines)
