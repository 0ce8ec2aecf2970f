"""The static dwells of a log and the forces in them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.records import Dwells
from tdfscal.reporting.figures.style import FILLS, Drawing, figure, legend_above


def draw(dwells: Dwells) -> Drawing:
    """Length of each sensor's mean force, a bar over the time of every dwell."""
    return Drawing(
        "dwells",
        "Static dwells",
        f"{len(dwells)} dwells are found.",
        lambda: _paint(dwells),
    )


def _paint(dwells: Dwells) -> Figure:
    force = np.linalg.norm(dwells.force, axis=2)
    start = dwells.start - dwells.start[0]
    length = np.maximum(dwells.end - dwells.start, 0.0)
    fig = figure(2.6)
    ax = fig.subplots()
    for i, name in enumerate(dwells.supports):
        ax.hlines(
            force[:, i], start, start + length, color=FILLS[i % len(FILLS)], linewidth=3, label=name
        )
        ax.plot(start, force[:, i], "|", color=FILLS[i % len(FILLS)], markersize=4)
    ax.set_xlabel("time since the first dwell, s")
    ax.set_ylabel("force, N")
    legend_above(ax, 4)
    return fig
