"""What each source contributes to the variance of each angle."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import Budget
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, tip

_ROOM_FOR_LABEL = 12.0


def draw(c: Calibration) -> Drawing | None:
    """Stacked bars of the variance, per angle."""
    budget = c.budget
    if budget is None or not budget.sources:
        return None
    mean = _shares(budget).mean(axis=0)
    order = np.argsort(-mean)
    share = 100 * mean[order]
    said = f"{budget.sources[order[0]]} makes up {share[0]:.0f} % of the variance on average"
    if len(order) > 1:
        said += f", {budget.sources[order[1]]} {share[1]:.0f} %"
    said = said[0].upper() + said[1:]
    return Drawing(
        "budget",
        "Where the uncertainty comes from",
        f"{said}: to lower the uncertainty, start there.",
        lambda: _paint(c, budget),
    )


def _shares(budget: Budget) -> FloatArray:
    """(3n, sources), share of each angle's variance."""
    table = np.array([[a.variance[s] for s in budget.sources] for a in budget.angles])
    total = table.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(table, total, out=np.zeros_like(table), where=total > 0))


def _paint(c: Calibration, budget: Budget) -> Figure:
    share = 100 * _shares(budget)
    place = np.arange(len(share), dtype=float) + np.repeat(0.5 * np.arange(len(c.mounted)), 3)
    fig = figure(1.1 + 0.24 * len(share))
    ax = fig.subplots()
    left = np.zeros(len(share))
    for s, source in enumerate(budget.sources):
        bars = ax.barh(
            place,
            share[:, s],
            left=left,
            height=0.78,
            color=ink.FILLS[s % len(ink.FILLS)],
            hatch=ink.HATCHES[s % len(ink.HATCHES)],
            edgecolor=ink.BLACK,
            linewidth=0.4,
            label=source,
        )
        for bar, a, width in zip(bars, budget.angles, share[:, s], strict=True):
            tip(bar, f"{a.support} {a.angle}: {source} {width:.1f} %")
        for y, x, width in zip(place, left, share[:, s], strict=True):
            if width >= _ROOM_FOR_LABEL:
                ax.text(
                    x + width / 2,
                    y,
                    f"{width:.0f} %",
                    ha="center",
                    va="center",
                    fontsize=7.5,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85},
                )
        left += share[:, s]
    for y, angle, std in zip(place, budget.angles, c.rpy_std[c.determined].ravel(), strict=True):
        del angle
        ax.text(101.5, y, f"{1e3 * std:.3f} mrad", va="center", fontsize=8)
    ax.text(101.5, place[0] - 1.0, "std. uncertainty", va="center", fontsize=7.5)
    ax.set_yticks(place, [f"{a.support}  {a.angle}" for a in budget.angles])
    ax.set_xlim(0, 100)
    ax.set_ylim(place[-1] + 0.6, place[0] - 0.6)
    ax.set_xlabel("share of the variance of the angle, %")
    ax.grid(visible=False)
    columns = min(4, len(budget.sources))
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper left", ncols=columns)
    return fig
