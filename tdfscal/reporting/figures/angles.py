"""The installation angles: with their intervals, against others, as planned; their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.catalogue import sentence
from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import coverage, measured, two_digits
from tdfscal.comparison.compatibility import Comparison
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import Budget
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import (
    Drawing,
    beside,
    figure,
    legend_outside,
    signed,
)

#: Letters that fit below one of two panels.
_LETTERS = 48
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
        f"Standard uncertainties from {measured(1e3 * std[a, b])} mrad ({ANGLES[b]} of "
        f"{c.mounted[a].name}) to {measured(1e3 * std[i, j])} mrad ({ANGLES[j]} of "
        f"{c.mounted[i].name}){'' if c.accepted else ', were the result sound'}.",
        lambda: _paint(c),
    )


def _paint(c: Calibration) -> Figure:
    nominal = np.array([support.nominal_rpy for support in c.rig.supports])[c.determined]
    turn = 1e3 * so3.wrapped(c.rpy[c.determined] - nominal).ravel()
    low = 1e3 * np.array([s.interval.low for s in c.mounted], dtype=np.float64).ravel()
    high = 1e3 * np.array([s.interval.high for s in c.mounted], dtype=np.float64).ravel()
    value = 1e3 * c.rpy[c.determined].ravel()
    fig, (left, right), place = by_angle([s.name for s in c.mounted], 2)
    left.axvline(0, color=style.BLACK, linewidth=0.8)
    left.set_xlabel("turn from the nominal mounting, mrad")
    left.barh(place, turn, height=0.62, color=style.BLUE, **style.EDGE)
    reach = np.abs(turn).max() * 1.35 or 1.0
    left.set_xlim(min(0, turn.min()) - 0.3 * reach, max(0, turn.max()) + 0.3 * reach)
    for y, t in zip(place, turn, strict=True):
        beside(left, signed(t, "+.2f"), t, y, 4 if t >= 0 else -4)
    ends = np.maximum(0, [value - low, high - value])
    right.errorbar(0 * value, place, xerr=ends, color=style.BLACK, ecolor=style.BLUE, **_WHISKERS)
    right.axvline(0, color=style.GREY, linewidth=0.8)
    _gate(right, 1e3 * c.limit_half_width, float(np.nanmax(ends)), coverage(c.accepted))
    right.tick_params(left=False)
    return fig


def _gate(ax: Axes, limit: float, widest: float, covered: str) -> None:
    """Where the quality gate rejects, mrad: drawn where intervals come near, else said."""
    said = f"the gate rejects beyond ±{measured(limit)} mrad"
    if limit < _NEAR * widest:
        said += " (dashed)"
        for end in (-limit, limit):
            ax.axvline(end, color=style.RED, linestyle="--", linewidth=1.2)
    ax.set_xlabel(fill(f"interval about the angle, mrad, {covered}; {said}", _LETTERS))


def differences(pairs: Sequence[Comparison]) -> Drawing:
    """Differences of the angles with half their 95 % intervals, a whisker per pair."""
    least = min(pairs, key=lambda pair: pair.p_value)
    title = " and ".join(
        dict.fromkeys(f"{pair.names[0]} against {pair.names[1]}" for pair in pairs)
    )
    if len(pairs) > 1:
        title = f"Change of each angle against {pairs[0].names[1]}"
    said = f"{begun(sentence(least.obstacle or least.finding))}."
    return Drawing("differences", title, said, lambda: _differences(pairs))


def _differences(pairs: Sequence[Comparison]) -> Figure:
    """Of each angle a whisker per pair, from the top down in their order."""
    step = 0.8 / len(pairs)
    fig, (ax,), place = by_angle(pairs[0].supports, head=1.1, row=0.16 + 0.1 * len(pairs))
    ax.axvline(0.0, color=style.GREY, linewidth=0.8)
    for k, pair in enumerate(pairs):
        y = place + (k - 0.5 * (len(pairs) - 1)) * step
        value = 1e3 * pair.rpy.ravel()
        half = np.nan_to_num(1e3 * INTERVAL_FACTOR * pair.rpy_std.ravel())  # of no two results
        beyond = pair.en.ravel() > 1.0
        for which, colour in ((~beyond, style.BLUE), (beyond, style.RED)):
            ax.errorbar(value[which], y[which], xerr=half[which], color=colour, **_WHISKERS)
        for x, at in zip(value + half, y, strict=True):
            if len(pairs) > 1:
                beside(ax, PurePath(pair.names[0]).name, x, at, 4)
    ax.set_xlabel("difference, mrad, 95 %; red: E_n above 1")
    return fig


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
            place, share, left=left, height=0.78, color=style.FILLS[s % len(style.FILLS)],
            hatch=style.HATCHES[(s + s // len(style.FILLS)) % len(style.HATCHES)], label=source,
            **style.EDGE,
        )  # fmt: skip
        for y, x, width in zip(place, left, share, strict=True):
            if width >= _ROOM_FOR_LABEL:
                ax.text(x + width / 2, y, f"{width:.0f} %", **_ON_A_BAR)
        left += share
    for y, std in zip(place, c.rpy_std[c.determined].ravel(), strict=True):
        ax.text(101.5, y, f"{two_digits(1e3 * std)} mrad", va="center", fontsize=8)
    ax.text(101.5, place[0] - 1.0, "std. uncertainty", va="center", fontsize=7.5)
    ax.set_xlim(0, 100)
    ax.set_ylim(place[-1] + 0.6, place[0] - 0.6)
    ax.set_xlabel("share of the variance of the angle, %")
    ax.grid(visible=False)
    legend_outside(fig, ax)
    return fig
