"""Monte Carlo trials over the linear prediction."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import Histogram
from tdfscal.files.calibration.parts import MonteCarloResult
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import ANGLES
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, signed, tip
from tdfscal.significance import INTERVAL_COVERAGE

#: Ends of the linear interval, in standard uncertainties.
_LIMIT = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))
#: Width of a place in widths of its histogram, and height of a row in those of the highest bar.
_GAP, _ROW = 1.08, 1.4


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
    """A place per angle on one pair of axes, a sensor in each row, in standard uncertainties."""
    known = np.flatnonzero(c.determined)
    n = len(known)
    fig = figure(0.9 + 1.05 * n)
    ax = fig.subplots()
    edges = np.array(histogram.edges)
    width = float(edges[1] - edges[0])
    across, k = _GAP * float(edges[-1] - edges[0]), _LIMIT
    u = np.linspace(edges[0], edges[-1], 121)
    normal = 100 * width * np.exp(-(u**2) / 2) / np.sqrt(2 * np.pi)
    counts = np.array(histogram.counts, dtype=float)[known]
    density = 100 * counts / np.maximum(counts.sum(axis=2, keepdims=True), 1.0)
    peak = max(float(density.max()), float(normal.max()))
    for row, i in enumerate(known):
        floor = -row * _ROW * peak
        for j in range(3):
            middle, std = j * across, c.rpy_std[i, j]
            bars = ax.stairs(
                density[row, j] + floor, edges + middle, baseline=floor, fill=True,
                color="#c6d6ea", edgecolor=ink.BLACK, linewidth=0.5,
            )  # fmt: skip
            tip(bars, f"{c.supports[i].name} {ANGLES[j]}: 1 std. unc. is {1e3 * std:.3f} mrad")
            ax.plot(u + middle, normal + floor, color=ink.ORANGE, linewidth=1.4)
            high = floor + 1.06 * peak
            ax.vlines(middle + np.array([-k, k]), floor, high, color=ink.ORANGE, linewidth=1.0,
                      linestyle="--")  # fmt: skip
            ends = middle + (np.array([m.low[i][j], m.high[i][j]]) - c.rpy[i, j]) / std
            ax.vlines(ends, floor, high, color=ink.BLACK, linewidth=1.0, linestyle=":")
            ax.text(
                middle, floor + 1.1 * peak,
                f"{c.supports[i].name}  {ANGLES[j]}, σ = {1e3 * std:.3g} mrad",
                ha="center", va="bottom", fontsize=8,
            )  # fmt: skip
    marks = np.array([-3.0, -_LIMIT, 0.0, _LIMIT, 3.0])
    ax.set_xticks(
        [mark + j * across for j in range(3) for mark in marks],
        [signed(mark, ".3g") for _ in range(3) for mark in marks],
    )
    ticks = [(value - row * _ROW * peak, f"{value:g}") for row in range(n) for value in (0, 5, 10)]
    ax.set_yticks([place for place, _ in ticks], [name for _, name in ticks])
    ax.set_xlim(edges[0] - 0.3, 2 * across + edges[-1] + 0.3)
    ax.set_ylim(-(n - 1) * _ROW * peak, 1.3 * peak)
    ax.grid(visible=False)
    ax.tick_params(labelsize=7)
    ax.set_xlabel("deviation from the estimate, std. unc. σ of the linear prediction")
    ax.set_ylabel("trials per bin, %", fontsize=7.5)
    fig.legend(handles=_keys(), loc="outside upper left", ncols=4)
    return fig


def _keys() -> list[Line2D | Patch]:
    return [
        Patch(facecolor="#c6d6ea", edgecolor=ink.BLACK, linewidth=0.5, label="trials"),
        Line2D([], [], color=ink.BLACK, linestyle=":", label="95 % of the trials"),
        Line2D([], [], color=ink.ORANGE, label="linear"),
        Line2D([], [], color=ink.ORANGE, linestyle="--", label="95 % linear"),
    ]
