"""The installation angles: with their intervals, by each method, against others, as planned.

And their uncertainty: what each source contributes, Monte Carlo trials over the prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.catalogue import sentence
from tdfscal.comparison.compatibility import Comparison, History, verdict
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import EDGES, Budget, MonteCarloResult
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile, p_text
from tdfscal.planning.moving_plan import MovingPlan
from tdfscal.planning.plan import Plan
from tdfscal.records import ANGLES, BoolArray, FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import (
    Drawing,
    beside,
    figure,
    legend_above,
    legend_outside,
    signed,
)
from tdfscal.significance import COVERAGE_FACTOR, INTERVAL_COVERAGE

#: Widest intervals within which the gate's limit leaves them legible.
_NEAR = 4.0
_WHISKERS: dict[str, Any] = {"fmt": "o", "markersize": 3.5, "elinewidth": 1.8, "capsize": 3.5}
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


def by_angle(
    supports: Sequence[str], columns: int = 1, head: float = 0.9, row: float = 0.23
) -> tuple[Figure, list[Axes], FloatArray]:
    """A figure with a row per angle from the top down, its columns, and where the rows lie.

    head, row : heights, inches.
    """
    sensors = len(supports)
    place = np.arange(3.0 * sensors) + np.repeat(0.5 * np.arange(sensors), 3)
    fig = figure(head + row * len(place))
    axes = list(fig.subplots(1, columns, sharey=True, squeeze=False)[0])
    axes[0].set_yticks(place, [f"{name}  {angle}" for name in supports for angle in ANGLES])
    axes[0].invert_yaxis()
    for ax in axes:
        ax.grid(axis="y", visible=False)
    return fig, axes, place


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
    low = 1e3 * np.array([s.interval.low for s in c.mounted], dtype=np.float64).ravel()
    high = 1e3 * np.array([s.interval.high for s in c.mounted], dtype=np.float64).ravel()
    value = 1e3 * c.rpy[c.determined].ravel()
    fig, (left, right), place = by_angle([s.name for s in c.mounted], 2)
    _turns(left, place, turn)
    reach = np.abs(turn).max() * 1.35 or 1.0
    left.set_xlim(min(0, turn.min()) - 0.3 * reach, max(0, turn.max()) + 0.3 * reach)
    for y, t in zip(place, turn, strict=True):
        beside(left, signed(t, "+.2f"), t, y, 4 if t >= 0 else -4)
    ends = np.maximum(0, [value - low, high - value])
    right.errorbar(0 * value, place, xerr=ends, color=ink.BLACK, ecolor=ink.BLUE, **_WHISKERS)
    right.axvline(0, color=ink.GREY, linewidth=0.8)
    _gate(right, 1e3 * c.limit_half_width, float(np.nanmax(ends)))
    right.tick_params(left=False)
    return fig


def _gate(ax: Axes, limit: float, widest: float) -> None:
    """Where the quality gate rejects, mrad: drawn where intervals come near, else said."""
    said = f"the gate rejects beyond ±{limit:.3g}"
    if limit < _NEAR * widest:
        said += " (dashed)"
        for end in (-limit, limit):
            ax.axvline(end, color=ink.RED, linestyle="--", linewidth=1.2)
    ax.set_xlabel(f"95 % interval about the angle, mrad;\n{said}")


def _turns(ax: Axes, place: FloatArray, turn: FloatArray) -> None:
    """Bars of the turns from the nominal mounting, mrad."""
    ax.axvline(0, color=ink.BLACK, linewidth=0.8)
    ax.set_xlabel("turn from the nominal mounting, mrad")
    ax.barh(place, turn, height=0.62, color=ink.BLUE, **ink.EDGE)


def methods(c: Calibration) -> Drawing | None:
    """Each method's angles less the joint ones, with 95 % intervals."""
    if not c.methods or c.tracker is None:
        return None
    k = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))
    each = [(m.method, np.array(m.rpy), np.array(m.rpy_std)) for m in c.methods]
    rows = [
        (name, so3.wrapped(rpy - c.rpy), k * std, np.zeros(rpy.shape, dtype=np.bool_))
        for name, rpy, std in (*each, ("joint", c.rpy, c.rpy_std))
    ]
    label = "angle less the joint estimate, with its 95 % interval, mrad"
    p = c.tracker.get("consistency_p_value")
    said = "The two methods are drawn about their joint estimate."
    if isinstance(p, float):
        (_, own, own_std), (_, other, other_std) = each
        apart = so3.wrapped(own - other)
        en = np.abs(apart) / (COVERAGE_FACTOR * np.hypot(own_std, other_std))
        names = ("self-calibration", "tracker")
        found = verdict(names, c.support_names, apart, en, p, np.ones(len(en)))
        said = f"{sentence(found)}."
    for disagreement in c.found("methods-disagree"):
        said = f"{disagreement.text}."
    title = "Two methods against each other"
    return Drawing("methods", title, said, lambda: _whiskers(c.support_names, rows, label))


def comparison(pair: Comparison, number: int = 1) -> Drawing:
    """Differences of the angles with their expanded uncertainty, k = 2."""
    title = f"{pair.names[0]} against {pair.names[1]}"
    said = f"{sentence(pair.obstacle or pair.finding)}."
    return Drawing(f"comparison-{number}", title, said, lambda: _changes([pair]))


def drift(h: History) -> Drawing:
    """Changes of every later calibration against the first, of those that can be told."""
    pairs = [pair for pair in h.against_first if np.isfinite(pair.p_value)]
    en = np.nan_to_num(np.stack([pair.en for pair in pairs]))
    f, i, j = (int(k) for k in np.unravel_index(int(en.argmax()), en.shape))
    worst = pairs[f]
    said = (
        f"The largest change against {worst.names[1]} is {ANGLES[j]} of {h.supports[i]} in "
        f"{worst.names[0]}: {signed(1e3 * float(worst.rpy[i, j]), '+.3g')} mrad, "
        f"E_n = {en[f, i, j]:.2f}; the two are {'' if worst.compatible else 'not '}"
        f"compatible, {p_text(worst.finding.p_value or 0.0)}."
    )
    return Drawing("drift", "Change of each angle", said, lambda: _changes(pairs))


def _changes(pairs: Sequence[Comparison]) -> Figure:
    rows = [(p.names[0], p.rpy, COVERAGE_FACTOR * p.rpy_std, p.en > 1.0) for p in pairs]
    label = "difference with expanded uncertainty (k = 2), mrad; red: E_n above 1"
    return _whiskers(pairs[0].supports, rows, label)


def _whiskers(
    supports: Sequence[str],
    rows: Sequence[tuple[str, FloatArray, FloatArray, BoolArray]],
    label: str,
) -> Figure:
    """Of each angle a whisker per row, from the top down in their order.

    rows : what each is of, its values (n, 3) and their half widths, rad, and which stand out.
    """
    step = 0.8 / len(rows)
    fig, (ax,), place = by_angle(supports, head=1.1, row=0.16 + 0.1 * len(rows))
    ax.axvline(0.0, color=ink.GREY, linewidth=0.8)
    for k, (name, values, halves, beyond) in enumerate(rows):
        y = place + (k - 0.5 * (len(rows) - 1)) * step
        value, half = 1e3 * values.ravel(), 1e3 * halves.ravel()
        for which, colour in ((~beyond.ravel(), ink.BLUE), (beyond.ravel(), ink.RED)):
            ax.errorbar(value[which], y[which], xerr=half[which], color=colour, **_WHISKERS)
        for x, at in zip(value + half, y, strict=True):
            if len(rows) > 1:
                beside(ax, name, x, at, 4)
    ax.set_xlabel(label)
    return fig


def planned(plan: Plan | MovingPlan) -> Drawing:
    """Standard uncertainty to expect of each angle, of the plan and of random ones."""

    def paint() -> Figure:
        fig, (ax,), place = by_angle(plan.rig.supports)
        random, expected = (1e3 * f.rpy_std.ravel() for f in (plan.random, plan.expected))
        ax.barh(place, random, height=0.75, color=ink.PALE, label="random")
        ax.barh(place, expected, height=0.45, color=ink.BLUE, label="plan", **ink.EDGE)
        ax.set_xlabel("standard uncertainty, mrad")
        legend_above(ax, 2)
        return fig

    what = "motions" if isinstance(plan, MovingPlan) else "postures"
    said = f"The plan is {plan.improvement:.2f} times better than random {what}."
    return Drawing("plan", "Uncertainty to expect", said, paint)


def truth(supports: tuple[str, ...], rpy: FloatArray, nominal: FloatArray) -> Drawing:
    """Turn from the nominal mounting; rpy, nominal : (n, 3), rad."""
    turn = 1e3 * so3.wrapped(rpy - nominal).ravel()

    def paint() -> Figure:
        fig, (ax,), place = by_angle(supports)
        _turns(ax, place, turn)
        return fig

    said = f"The largest turn from the nominal mounting is {np.abs(turn).max():.3g} mrad."
    return Drawing("truth", "True mounting", said, paint)


def budget(c: Calibration) -> Drawing | None:
    """Stacked bars of the variance, per angle."""
    found = c.budget
    if found is None or not found.sources:
        return None
    share = 100 * found.shares.mean(axis=0)
    order = np.argsort(-share)
    said = f"{share[order[0]]:.0f} % of the variance is {found.sources[order[0]]} on average"
    if len(order) > 1:
        said += f", {share[order[1]]:.0f} % {found.sources[order[1]]}"
    return Drawing(
        "budget",
        "Where the uncertainty comes from",
        f"{said}: to lower the uncertainty, start there.",
        lambda: _paint_budget(c, found),
    )


def _paint_budget(c: Calibration, budget: Budget) -> Figure:
    fig, (ax,), place = by_angle([support.name for support in c.mounted], head=1.1, row=0.24)
    left = np.zeros(len(place))
    for s, (source, share) in enumerate(zip(budget.sources, 100 * budget.shares.T, strict=True)):
        ax.barh(
            place, share, left=left, height=0.78, color=ink.FILLS[s % len(ink.FILLS)],
            hatch=ink.HATCHES[(s + s // len(ink.FILLS)) % len(ink.HATCHES)], label=source,
            **ink.EDGE,
        )  # fmt: skip
        for y, x, width in zip(place, left, share, strict=True):
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
    return Drawing(
        "trials",
        "Monte Carlo over the linear prediction",
        f"{m.trials} trials {m.verdict} the linear 95 % intervals; their standard deviations are "
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
            ax.stairs(height, EDGES + middle, baseline=floor, fill=True, **_BARS)
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
