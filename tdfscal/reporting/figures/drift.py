"""Angles over time: each calibration against the first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.comparison.compatibility import ANGLES, History
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure
from tdfscal.significance import COVERAGE_FACTOR

#: Days between first and last from which the axis is time, not order.
_DAYS = 1.0


def draw(h: History, letters: Sequence[str], days: Sequence[float]) -> Drawing:
    """One panel per angle; whiskers are the expanded uncertainty of the difference (k = 2)."""
    en = np.stack([c.en for c in h.against_first])
    f, i, j = (int(k) for k in np.unravel_index(int(en.argmax()), en.shape))
    said = (
        f"The largest change against {letters[0]} is {ANGLES[j]} of {h.supports[i]} in "
        f"{letters[f + 1]}: {1e3 * h.drift[f + 1, i, j]:+.3g} mrad, E_n = {en[f, i, j]:.2f}; "
        + ("beyond" if en[f, i, j] > 1 else "within")
        + " its uncertainty."
    ).replace("-", "−")
    return Drawing("drift", "Change of each angle", said, lambda: _paint(h, letters, days))


def _paint(h: History, letters: Sequence[str], days: Sequence[float]) -> Figure:
    n, over_time = len(h.supports), days[-1] - days[0] >= _DAYS
    x = np.array(days) if over_time else np.arange(len(letters), dtype=float)
    margin = 0.08 * (x[-1] - x[0]) if over_time else 0.5
    fig = figure(0.7 + 1.45 * n)
    grid = fig.subplots(n, 3, sharex=True, squeeze=False)
    for i in range(n):
        for j in range(3):
            ax = grid[i, j]
            half = COVERAGE_FACTOR * 1e3 * h.rpy_std[0, i, j]
            ax.axhspan(
                -half, half, facecolor=ink.PALE, edgecolor=ink.GREY, linewidth=0.4, hatch="...."
            )
            ax.axhline(0, color=ink.GREY, linewidth=0.8)
            for f in range(1, len(x)):
                over = h.against_first[f - 1].en[i, j] > 1
                ax.errorbar(
                    x[f],
                    1e3 * h.drift[f, i, j],
                    yerr=COVERAGE_FACTOR * 1e3 * h.drift_std[f, i, j],
                    fmt="X" if over else "o",
                    color=ink.RED if over else ink.BLUE,
                    markersize=6 if over else 4,
                    capsize=3,
                )
            ax.plot(x[0], 0, "D", color=ink.BLACK, markersize=4)
            ax.set_title(f"{h.supports[i]}  {ANGLES[j]}", fontsize=8, pad=2)
            ax.set_xlim(x[0] - margin, x[-1] + margin)
            if not over_time:
                ax.set_xticks(x, letters)
            if i == n - 1:
                ax.set_xlabel(
                    f"days since {letters[0]}" if over_time else "calibration, in order of creation"
                )
        grid[i, 0].set_ylabel("change, mrad")
    keys = [
        Line2D([], [], marker="D", linestyle="", color=ink.BLACK, label=f"{letters[0]}, the first"),
        Patch(facecolor=ink.PALE, edgecolor=ink.GREY, hatch="....", label="its uncertainty, k = 2"),
        Line2D([], [], marker="o", linestyle="", color=ink.BLUE, label="later, E_n ≤ 1"),
        Line2D([], [], marker="X", linestyle="", color=ink.RED, label="later, E_n > 1"),
    ]
    fig.legend(handles=keys, loc="outside upper left", ncols=4)
    return fig
