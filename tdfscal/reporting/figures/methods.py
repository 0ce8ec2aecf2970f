"""A joint result beside what each method alone says."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import ANGLES
from tdfscal.reporting.figures.style import BLUE, GREY, INK, ORANGE, Drawing, figure, legend_above
from tdfscal.significance import INCOMPATIBLE, INTERVAL_COVERAGE

_NAMES = {"self": "self-calibration", "tracker": "laser tracker"}
_LOOK = {"self": ("s", BLUE, -0.26), "tracker": ("^", ORANGE, 0.0)}


def draw(c: Calibration) -> Drawing | None:
    """Each method's angles less the joint ones, with 95 % intervals."""
    if not c.methods or c.tracker is None:
        return None
    p, en = c.tracker.get("consistency_p_value"), c.tracker.get("largest_en")
    said = "The two methods are drawn about their joint estimate."
    if isinstance(p, float) and isinstance(en, float):
        agree = "agree" if en <= 1 and p >= INCOMPATIBLE else "do not agree"
        said = (
            f"Self-calibration and tracker {agree} within their uncertainties: the largest E_n is "
            f"{en:.2f} (1 is the limit), p = {p:.2g} for all angles together."
        )
    return Drawing("methods", "Two methods against each other", said, lambda: _paint(c))


def _paint(c: Calibration) -> Figure:
    k = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))
    base = np.arange(3 * len(c.supports), dtype=float)
    base += np.repeat(0.5 * np.arange(len(c.supports)), 3)
    fig = figure(1.0 + 0.3 * len(base))
    ax = fig.subplots()
    for alone in c.methods or ():
        marker, colour, shift = _LOOK[alone.method]
        off = so3.wrapped(np.array(alone.rpy) - c.rpy)
        ax.errorbar(
            1e3 * off.ravel(),
            base + shift,
            xerr=1e3 * k * np.ravel(alone.rpy_std),
            fmt=marker,
            markersize=4.5,
            color=colour,
            capsize=2.5,
            label=_NAMES[alone.method],
        )
    ax.errorbar(
        np.zeros_like(base),
        base + 0.26,
        xerr=1e3 * k * c.rpy_std.ravel(),
        fmt="o",
        markersize=4.5,
        color=INK,
        capsize=2.5,
        label="joint",
    )
    ax.axvline(0, color=GREY, linewidth=0.8)
    ax.set_yticks(base, [f"{s.name}  {angle}" for s in c.supports for angle in ANGLES])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("angle less the joint estimate, with its 95 % interval, mrad")
    legend_above(ax, 3)
    return fig
