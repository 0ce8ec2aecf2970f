"""The installation angles with their 95 % intervals."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.numerics import so3
from tdfscal.records import ANGLES
from tdfscal.reporting.figures.style import BLUE, GREY, INK, Drawing, figure, signed, tip


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
    bars = left.barh(place, turn, height=0.62, color=BLUE, edgecolor=INK, linewidth=0.4)
    for bar, label, v, a, b in zip(bars, labels, value, low, high, strict=True):
        tip(bar, f"{label}: {v:.3f} mrad, 95 % from {a:.3f} to {b:.3f}")
    left.axvline(0, color=INK, linewidth=0.8)
    reach = np.abs(turn).max() * 1.35 or 1.0
    left.set_xlim(min(0, turn.min()) - 0.3 * reach, max(0, turn.max()) + 0.3 * reach)
    for y, t in zip(place, turn, strict=True):
        left.annotate(
            signed(t, "+.2f"),
            (t, y),
            xytext=(4 if t >= 0 else -4, 0),
            textcoords="offset points",
            ha="left" if t >= 0 else "right",
            va="center",
            fontsize=7.5,
        )
    left.set_xlabel("turn from the nominal mounting, mrad")
    left.set_yticks(place, labels)
    left.invert_yaxis()
    right.errorbar(
        np.zeros_like(value),
        place,
        xerr=np.maximum(0, [value - low, high - value]),
        fmt="o",
        markersize=3.5,
        color=INK,
        ecolor=BLUE,
        elinewidth=1.8,
        capsize=3.5,
    )
    right.axvline(0, color=GREY, linewidth=0.8)
    right.set_xlabel("95 % interval about the angle, mrad")
    right.tick_params(left=False)
    for ax in (left, right):
        ax.grid(axis="y", visible=False)
    return fig
