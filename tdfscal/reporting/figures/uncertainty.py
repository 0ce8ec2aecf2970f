"""The uncertainty: what each source contributes, and Monte Carlo trials over the prediction."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import EDGES, Budget, MonteCarloResult
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.angles import by_angle
from tdfscal.reporting.figures.style import Drawing, figure, legend_outside, signed, tip
from tdfscal.significance import INTERVAL_COVERAGE

_ROOM_FOR_LABEL = 12.0
_ON_A_BAR: dict[str, Any] = {
    "ha": "center",
    "va": "center",
    "fontsize": 7.5,
    "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85},
}
_BARS: dict[str, Any] = {"facecolor": "#c6d6ea", "edgecolor": ink.BLACK, "linewidth": 0.5}
#: Ends of the linear interval, in standard uncertainties.
_LIMIT = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))
#: Width of a place in widths of its histogram, and height of a row in those of the highest bar.
_GAP, _ROW = 1.08, 1.4


def draw(c: Calibration) -> Drawing | None:
    """Stacked bars of the variance, per angle."""
    budget = c.budget
    if budget is None or not budget.sources:
        return None
    share = 100 * budget.shares.mean(axis=0)
    order = np.argsort(-share)
    said = f"{share[order[0]]:.0f} % of the variance is {budget.sources[order[0]]} on average"
    if len(order) > 1:
        said += f", {share[order[1]]:.0f} % {budget.sources[order[1]]}"
    return Drawing(
        "budget",
        "Where the uncertainty comes from",
        f"{said}: to lower the uncertainty, start there.",
        lambda: _paint(c, budget),
    )


def _paint(c: Calibration, budget: Budget) -> Figure:
    fig, (ax,), place = by_angle([support.name for support in c.mounted], head=1.1, row=0.24)
    left = np.zeros(len(place))
    for s, (source, share) in enumerate(zip(budget.sources, 100 * budget.shares.T, strict=True)):
        bars = ax.barh(
            place, share, left=left, height=0.78, color=ink.FILLS[s % len(ink.FILLS)],
            hatch=ink.HATCHES[(s + s // len(ink.FILLS)) % len(ink.HATCHES)], label=source,
            **ink.EDGE,
        )  # fmt: skip
        for bar, a, y, x, width in zip(bars, budget.angles, place, left, share, strict=True):
            tip(bar, f"{a.support} {a.angle}: {source} {width:.1f} %")
            if width >= _ROOM_FOR_LABEL:
                ax.text(x + width / 2, y, f"{width:.0f} %", **_ON_A_BAR)
        left += share
    for y, std in zip(place, c.rpy_std[c.determined].ravel(), strict=True):
        ax.text(101.5, y, f"{1e3 * std:.3f} mrad", va="center", fontsize=8)
    ax.text(101.5, place[0] - 1.0, "std. uncertainty", va="center", fontsize=7.5)
    ax.set_xlim(0, 100)
    ax.set_ylim(place[-1] + 0.6, place[0] - 0.6)
    ax.set_xlabel("share of the variance of the angle, %")
    ax.grid(visible=False)
    legend_outside(fig, ax)
    return fig


def trials(c: Calibration) -> Drawing | None:
    """One histogram per angle, with the normal curve of the linear uncertainty."""
    m = c.monte_carlo
    if m is None or m.histogram is None:
        return None
    counts = np.array(m.histogram, dtype=float)[c.determined]
    ratio = (np.array(m.rpy_std) / c.rpy_std)[c.determined]
    confirm = "confirm" if m.linear_interval_validated else "do not confirm"
    return Drawing(
        "trials",
        "Monte Carlo over the linear prediction",
        f"{m.trials} trials {confirm} the linear 95 % intervals; their standard deviations are "
        f"{ratio.min():.2f} to {ratio.max():.2f} times the linear ones.",
        lambda: _paint_trials(c, m, counts),
    )


def _paint_trials(c: Calibration, m: MonteCarloResult, counts: FloatArray) -> Figure:
    """A place per angle on one pair of axes, a sensor in each row, in standard uncertainties."""
    known = np.flatnonzero(c.determined)
    n = len(known)
    fig = figure(0.9 + 1.05 * n)
    ax = fig.subplots()
    width = float(EDGES[1] - EDGES[0])
    across, k = _GAP * float(EDGES[-1] - EDGES[0]), _LIMIT
    u = np.linspace(EDGES[0], EDGES[-1], 121)
    normal = 100 * width * np.exp(-(u**2) / 2) / np.sqrt(2 * np.pi)
    density = 100 * counts / np.maximum(counts.sum(axis=2, keepdims=True), 1.0)
    peak = max(float(density.max()), float(normal.max()))
    for row, i in enumerate(known):
        floor = -row * _ROW * peak
        for j in range(3):
            middle, std = j * across, c.rpy_std[i, j]
            height = density[row, j] + floor
            bars = ax.stairs(height, EDGES + middle, baseline=floor, fill=True, **_BARS)
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
    ax.set_xlim(EDGES[0] - 0.3, 2 * across + EDGES[-1] + 0.3)
    ax.set_ylim(-(n - 1) * _ROW * peak, 1.3 * peak)
    ax.grid(visible=False)
    ax.tick_params(labelsize=7)
    ax.set_xlabel("deviation from the estimate, std. unc. σ of the linear prediction")
    ax.set_ylabel("trials per bin, %", fontsize=7.5)
    keys = [
        Patch(**_BARS, label="trials"),
        Line2D([], [], color=ink.BLACK, linestyle=":", label="95 % of the trials"),
        Line2D([], [], color=ink.ORANGE, label="linear"),
        Line2D([], [], color=ink.ORANGE, linestyle="--", label="95 % linear"),
    ]
    fig.legend(handles=keys, loc="outside upper left", ncols=4)
    return fig
