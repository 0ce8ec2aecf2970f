"""What to expect of a plan, angle by angle."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.planning import Plan
from tdfscal.planning.moving_plan import MovingPlan
from tdfscal.records import ANGLES
from tdfscal.reporting.figures.style import BLUE, INK, PALE, Drawing, figure, legend_above


def draw(plan: Plan | MovingPlan) -> Drawing:
    """Standard uncertainty to expect of each angle, of the plan and of random ones."""
    what = "motions" if isinstance(plan, MovingPlan) else "postures"
    return Drawing(
        "plan",
        "Uncertainty to expect",
        f"The plan is {plan.improvement:.2f} times better than random {what}.",
        lambda: _paint(plan),
    )


def _paint(plan: Plan | MovingPlan) -> Figure:
    expected = 1e3 * plan.expected.rpy_std.ravel()
    place = np.arange(len(expected), dtype=float)
    fig = figure(0.9 + 0.23 * len(expected))
    ax = fig.subplots()
    ax.barh(place, 1e3 * plan.random.rpy_std.ravel(), height=0.75, color=PALE, label="random")
    ax.barh(place, expected, height=0.45, color=BLUE, edgecolor=INK, linewidth=0.4, label="plan")
    ax.set_yticks(place, [f"{name}  {angle}" for name in plan.rig.supports for angle in ANGLES])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("standard uncertainty, mrad")
    legend_above(ax, 2)
    return fig
