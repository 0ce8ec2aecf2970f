"""Residuals of a registration, point by point."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.reporting.figures.style import FILLS, Drawing, figure, legend_above
from tdfscal.trackercal import PointRegistration


def draw(r: PointRegistration) -> Drawing:
    """Residual of each point in µm, by coordinate."""
    return Drawing(
        "residuals",
        "Residuals of the points",
        f"The points fit within {1e6 * r.rms:.3g} µm rms.",
        lambda: _paint(r),
    )


def _paint(r: PointRegistration) -> Figure:
    fig = figure(2.6)
    ax = fig.subplots()
    place = np.arange(len(r.names), dtype=float)
    for j, axis in enumerate("xyz"):
        ax.bar(
            place + 0.27 * (j - 1), 1e6 * r.residual[:, j], width=0.25, color=FILLS[j], label=axis
        )
    ax.set_xticks(place, r.names, rotation=90 if len(r.names) > 8 else 0)
    ax.set_ylabel("residual, µm")
    ax.grid(axis="x", visible=False)
    legend_above(ax, 3)
    return fig
