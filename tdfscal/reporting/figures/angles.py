"""The installation angles: with their intervals, by each method, against others, as planned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.comparison.compatibility import Comparison
from tdfscal.files.calibration.document import Calibration
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.planning import Plan
from tdfscal.planning.moving_plan import MovingPlan
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, beside, figure, legend_above, signed, tip
from tdfscal.significance import INCOMPATIBLE, INTERVAL_COVERAGE

#: Name, marker, colour and place of each method beside the others.
_METHODS = {
    "self": ("self-calibration", "s", ink.BLUE, -0.26),
    "tracker": ("laser tracker", "^", ink.ORANGE, 0.0),
    "joint": ("joint", "o", ink.BLACK, 0.26),
}


def draw(c: Calibration) -> Drawing:
    """Turn from the nominal mounting, and beside it the interval about each angle."""
    std = c.rpy_std[c.determined]
    i, j = np.unravel_index(int(std.argmax()), std.shape)
    a, b = np.unravel_index(int(std.argmin()), std.shape)
    return Drawing(
        "angles",
        "Installation angles",
        f"{ANGLES[j].capitalize()} of {c.mounted[i].name} is known to {1e3 * std[i, j]:.2g} mrad, "
        f"the least well; {ANGLES[b]} of {c.mounted[a].name} to {1e3 * std[a, b]:.2g} mrad, "
        "the best (standard uncertainties).",
        lambda: _paint(c),
    )


def _paint(c: Calibration) -> Figure:
    nominal = np.array([support.nominal_rpy for support in c.rig.supports])[c.determined]
    turn = 1e3 * so3.wrapped(c.rpy[c.determined] - nominal).ravel()
    low = 1e3 * np.array([s.interval.low for s in c.mounted]).ravel()
    high = 1e3 * np.array([s.interval.high for s in c.mounted]).ravel()
    value = 1e3 * c.rpy[c.determined].ravel()
    place = np.arange(len(value), dtype=float) + np.repeat(0.5 * np.arange(len(c.mounted)), 3)
    fig = figure(0.9 + 0.23 * len(value))
    left, right = fig.subplots(1, 2, sharey=True)
    labels = [f"{s.name}  {angle}" for s in c.mounted for angle in ANGLES]
    bars = left.barh(place, turn, height=0.62, color=ink.BLUE, edgecolor=ink.BLACK, linewidth=0.4)
    for bar, label, v, a, b in zip(bars, labels, value, low, high, strict=True):
        tip(bar, f"{label}: {v:.3f} mrad, 95 % from {a:.3f} to {b:.3f}")
    left.axvline(0, color=ink.BLACK, linewidth=0.8)
    reach = np.abs(turn).max() * 1.35 or 1.0
    left.set_xlim(min(0, turn.min()) - 0.3 * reach, max(0, turn.max()) + 0.3 * reach)
    for y, t in zip(place, turn, strict=True):
        beside(left, signed(t, "+.2f"), t, y, 4 if t >= 0 else -4)
    left.set_xlabel("turn from the nominal mounting, mrad")
    left.set_yticks(place, labels)
    left.invert_yaxis()
    right.errorbar(
        np.zeros_like(value),
        place,
        xerr=np.maximum(0, [value - low, high - value]),
        fmt="o",
        markersize=3.5,
        color=ink.BLACK,
        ecolor=ink.BLUE,
        elinewidth=1.8,
        capsize=3.5,
    )
    right.axvline(0, color=ink.GREY, linewidth=0.8)
    right.set_xlabel("95 % interval about the angle, mrad")
    right.tick_params(left=False)
    for ax in (left, right):
        ax.grid(axis="y", visible=False)
    return fig


def methods(c: Calibration) -> Drawing | None:
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
    return Drawing("methods", "Two methods against each other", said, lambda: _paint_methods(c))


def _paint_methods(c: Calibration) -> Figure:
    k = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))
    base = np.arange(3 * len(c.supports), dtype=float)
    base += np.repeat(0.5 * np.arange(len(c.supports)), 3)
    fig = figure(1.0 + 0.3 * len(base))
    ax = fig.subplots()
    each = [(m.method, np.array(m.rpy), np.array(m.rpy_std)) for m in c.methods or ()]
    for method, rpy, std in (*each, ("joint", c.rpy, c.rpy_std)):
        name, marker, colour, shift = _METHODS[method]
        ax.errorbar(
            1e3 * so3.wrapped(rpy - c.rpy).ravel(),
            base + shift,
            xerr=1e3 * k * std.ravel(),
            fmt=marker,
            markersize=4.5,
            color=colour,
            capsize=2.5,
            label=name,
        )
    ax.axvline(0, color=ink.GREY, linewidth=0.8)
    _named(ax, base, c.support_names)
    ax.set_xlabel("angle less the joint estimate, with its 95 % interval, mrad")
    legend_above(ax, 3)
    return fig


def comparison(pair: Comparison, number: int = 1) -> Drawing:
    """Differences of the angles with their expanded uncertainty, k = 2."""
    return Drawing(
        f"comparison-{number}",
        f"{pair.names[0]} against {pair.names[1]}",
        f"{pair.verdict}.",
        lambda: _paint_comparison(pair),
    )


def _paint_comparison(pair: Comparison) -> Figure:
    value, std = 1e3 * pair.rpy.ravel(), 1e3 * pair.rpy_std.ravel()
    place = np.arange(len(value), dtype=float)
    beyond = pair.en.ravel() > 1.0
    fig = figure(0.9 + 0.23 * len(value))
    ax = fig.subplots()
    ax.axvline(0.0, color=ink.GREY, linewidth=0.8)
    for which, colour in ((~beyond, ink.BLUE), (beyond, ink.RED)):
        ax.errorbar(
            value[which], place[which], xerr=2.0 * std[which], fmt="o", markersize=3.5,
            color=ink.BLACK, ecolor=colour, elinewidth=1.8, capsize=3.5,
        )  # fmt: skip
    _named(ax, place, pair.supports)
    ax.set_xlabel("difference with expanded uncertainty (k = 2), mrad; red: E_n above 1")
    return fig


def planned(plan: Plan | MovingPlan) -> Drawing:
    """Standard uncertainty to expect of each angle, of the plan and of random ones."""
    what = "motions" if isinstance(plan, MovingPlan) else "postures"
    return Drawing(
        "plan",
        "Uncertainty to expect",
        f"The plan is {plan.improvement:.2f} times better than random {what}.",
        lambda: _paint_planned(plan),
    )


def _paint_planned(plan: Plan | MovingPlan) -> Figure:
    expected = 1e3 * plan.expected.rpy_std.ravel()
    place = np.arange(len(expected), dtype=float)
    fig = figure(0.9 + 0.23 * len(expected))
    ax = fig.subplots()
    ax.barh(place, 1e3 * plan.random.rpy_std.ravel(), height=0.75, color=ink.PALE, label="random")
    ax.barh(
        place,
        expected,
        height=0.45,
        color=ink.BLUE,
        edgecolor=ink.BLACK,
        linewidth=0.4,
        label="plan",
    )
    _named(ax, place, plan.rig.supports)
    ax.set_xlabel("standard uncertainty, mrad")
    legend_above(ax, 2)
    return fig


def truth(supports: tuple[str, ...], rpy: FloatArray, nominal: FloatArray) -> Drawing:
    """Turn from the nominal mounting; rpy, nominal : (n, 3), rad."""
    turn = 1e3 * so3.wrapped(rpy - nominal).ravel()
    return Drawing(
        "truth",
        "True mounting",
        f"The largest turn from the nominal mounting is {np.abs(turn).max():.3g} mrad.",
        lambda: _paint_truth(supports, turn),
    )


def _paint_truth(supports: tuple[str, ...], turn: FloatArray) -> Figure:
    place = np.arange(len(turn), dtype=float)
    fig = figure(0.9 + 0.23 * len(turn))
    ax = fig.subplots()
    ax.barh(place, turn, height=0.62, color=ink.BLUE, edgecolor=ink.BLACK, linewidth=0.4)
    ax.axvline(0.0, color=ink.BLACK, linewidth=0.8)
    _named(ax, place, supports)
    ax.set_xlabel("turn from the nominal mounting, mrad")
    return fig


def _named(ax: Axes, place: FloatArray, supports: Sequence[str]) -> None:
    """Name the rows of the angles, which lie at `place`, from the top down."""
    ax.set_yticks(place, [f"{name}  {angle}" for name in supports for angle in ANGLES])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
