"""Two calibrations against each other, angle by angle."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.comparison.compatibility import Comparison
from tdfscal.records import ANGLES
from tdfscal.reporting.figures.style import BLUE, GREY, INK, RED, Drawing, figure


def draw(pair: Comparison, number: int = 1) -> Drawing:
    """Differences of the angles with their expanded uncertainty, k = 2."""
    return Drawing(
        f"comparison-{number}",
        f"{pair.names[0]} against {pair.names[1]}",
        f"{pair.verdict}.",
        lambda: _paint(pair),
    )


def _paint(pair: Comparison) -> Figure:
    value, std = 1e3 * pair.rpy.ravel(), 1e3 * pair.rpy_std.ravel()
    place = np.arange(len(value), dtype=float)
    beyond = pair.en.ravel() > 1.0
    fig = figure(0.9 + 0.23 * len(value))
    ax = fig.subplots()
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    for which, colour in ((~beyond, BLUE), (beyond, RED)):
        ax.errorbar(
            value[which], place[which], xerr=2.0 * std[which], fmt="o", markersize=3.5,
            color=INK, ecolor=colour, elinewidth=1.8, capsize=3.5,
        )  # fmt: skip
    ax.set_yticks(place, [f"{name}  {angle}" for name in pair.supports for angle in ANGLES])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("difference with expanded uncertainty (k = 2), mrad; red: E_n above 1")
    return fig
