"""The true mounting of a simulated rig."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.numerics import so3
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures.style import BLUE, INK, Drawing, figure


def draw(supports: tuple[str, ...], rpy: FloatArray, nominal: FloatArray) -> Drawing:
    """Turn from the nominal mounting; rpy, nominal : (n, 3), rad."""
    turn = 1e3 * so3.wrapped(rpy - nominal).ravel()
    return Drawing(
        "truth",
        "True mounting",
        f"The largest turn from the nominal mounting is {np.abs(turn).max():.3g} mrad.",
        lambda: _paint(supports, turn),
    )


def _paint(supports: tuple[str, ...], turn: FloatArray) -> Figure:
    place = np.arange(len(turn), dtype=float)
    fig = figure(0.9 + 0.23 * len(turn))
    ax = fig.subplots()
    ax.barh(place, turn, height=0.62, color=BLUE, edgecolor=INK, linewidth=0.4)
    ax.axvline(0.0, color=INK, linewidth=0.8)
    ax.set_yticks(place, [f"{name}  {angle}" for name in supports for angle in ANGLES])
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("turn from the nominal mounting, mrad")
    return fig
