"""Monte Carlo trials over the linear prediction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import Histogram
from tdfscal.files.calibration.parts import MonteCarloResult
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import ANGLES
from tdfscal.reporting.figures.style import INK, ORANGE, Drawing, figure
from tdfscal.significance import INTERVAL_COVERAGE


def draw(c: Calibration) -> Drawing | None:
    """One histogram per angle, with the normal curve of the linear uncertainty."""
    m = c.monte_carlo
    if m is None or m.histogram is None:
        return None
    histogram = m.histogram
    ratio = (np.array(m.rpy_std) / c.rpy_std)[c.determined]
    confirm = "confirm" if m.linear_interval_validated else "do not confirm"
    return Drawing(
        "trials",
        "Monte Carlo over the linear prediction",
        f"{m.trials} trials {confirm} the linear 95 % intervals; their standard deviations are "
        f"{ratio.min():.2f} to {ratio.max():.2f} times the linear ones.",
        lambda: _paint(c, m, histogram),
    )


def _paint(c: Calibration, m: MonteCarloResult, histogram: Histogram) -> Figure:
    known = np.flatnonzero(c.determined)
    n = len(known)
    fig = figure(0.55 + 1.35 * n)
    grid = fig.subplots(n, 3, sharey=True, squeeze=False)
    edges = np.array(histogram.edges)
    k = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))
    u = np.linspace(edges[0], edges[-1], 121)
    for row, i in enumerate(known):
        for j in range(3):
            ax, std = grid[row, j], 1e3 * c.rpy_std[i, j]
            counts = np.array(histogram.counts[i][j], dtype=float)
            density = 100 * counts / (counts.sum() or 1.0)
            ax.stairs(density, edges * std, fill=True, color="#c6d6ea", edgecolor=INK)
            ax.stairs(density, edges * std, color=INK, linewidth=0.5)
            curve = 100 * np.diff(edges)[0] * np.exp(-(u**2) / 2) / np.sqrt(2 * np.pi)
            ax.plot(u * std, curve, color=ORANGE, linewidth=1.4)
            for side in (-1, 1):
                ax.axvline(side * k * std, color=ORANGE, linewidth=1.0, linestyle="--")
            for end in (m.low[i][j], m.high[i][j]):
                off = 1e3 * (end - c.rpy[i, j])
                ax.axvline(off, color=INK, linewidth=1.0, linestyle=":")
            ax.set_title(f"{c.supports[i].name}  {ANGLES[j]}", fontsize=8, pad=2)
            ax.xaxis.set_major_locator(MaxNLocator(5))
            ax.grid(visible=False)
            ax.tick_params(labelsize=7)
            if row == n - 1:
                ax.set_xlabel("deviation from the estimate, mrad")
        grid[row, 0].set_ylabel("trials per bin, %", fontsize=7.5)
    fig.legend(handles=_keys(), loc="outside upper left", ncols=4)
    return fig


def _keys() -> list[Line2D | Patch]:
    return [
        Patch(facecolor="#c6d6ea", edgecolor=INK, linewidth=0.5, label="trials"),
        Line2D([], [], color=INK, linestyle=":", label="95 % of the trials"),
        Line2D([], [], color=ORANGE, label="linear"),
        Line2D([], [], color=ORANGE, linestyle="--", label="95 % linear"),
    ]
