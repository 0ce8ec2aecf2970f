"""Which turns of the sensors the data determine: standard uncertainties against the limit."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.records import FloatArray
from tdfscal.reporting.figures.style import BLUE, GREY, INK, RED, Drawing, figure, logarithmic, tip
from tdfscal.selfcal.observability import Angle, Observability

#: rad; a turn no better known than this is not known at all.
_OPEN = 1.0
#: Inches of a bar.
_BAR = 0.19


def draw(seen: Observability, limit: float) -> Drawing:
    """One bar per turn; limit : rad, `acceptance.identifiable`."""
    known = sum(angle.identified for angle in seen.angles)
    said = (
        f"{known} of {len(seen.angles)} turns are determined: their standard uncertainty is below "
        f"{1e3 * limit:.3g} mrad, and below half of what was stated before the log."
    )
    return Drawing("determined", "What the data determine", said, lambda: _paint(seen, limit))


def _paint(seen: Observability, limit: float) -> Figure:
    angles = seen.angles
    std = np.array([angle.std for angle in angles])
    shown = 1e3 * np.clip(np.nan_to_num(std, nan=_OPEN, posinf=_OPEN), 0.0, _OPEN)
    fig = figure(0.8 + _BAR * len(angles))
    ax = fig.subplots()
    left = 0.5 * min(float(shown[shown > 0].min(initial=1e3 * limit)), 1e3 * limit)
    place = _places(angles)
    for y, width, angle in zip(place, shown, angles, strict=True):
        (bar,) = ax.barh(
            [y], [width - left], left=left, height=0.72, edgecolor=INK, linewidth=0.5,
            color=BLUE if angle.identified else "white", hatch="" if angle.identified else "////",
        )  # fmt: skip
        if not angle.identified:
            bar.set_edgecolor(RED)
        said = words(angle.std)
        tip(bar, f"{angle.name}: {said}")
        ax.annotate(
            said, (width, y), xytext=(4, 0), textcoords="offset points", va="center", fontsize=7.5
        )
    ax.axvline(1e3 * limit, color=INK, linewidth=1.2, linestyle="--")
    ax.annotate(
        f"limit {1e3 * limit:.3g} mrad", (1e3 * limit, 1.0), xycoords=("data", "axes fraction"),
        xytext=(3, 3), textcoords="offset points", fontsize=7.5,
    )  # fmt: skip
    logarithmic(ax, "x")
    ax.set_xlim(left, 4e3 * _OPEN)
    ax.set_yticks(place, [angle.name for angle in angles])
    ax.tick_params(axis="y", length=0, labelcolor=INK)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("standard uncertainty, mrad; hatched: not determined", color=INK)
    ax.spines["left"].set_color(GREY)
    return fig


def words(std: float) -> str:
    """A standard uncertainty in rad, as it is worth saying."""
    if not std < _OPEN:
        return "over 1 rad"
    return f"{1e3 * std:.0f} mrad" if std >= 0.1 else f"{1e3 * std:.2g} mrad"


def _places(angles: tuple[Angle, ...]) -> FloatArray:
    """Where the bars stand, those of one sensor together."""
    names = list(dict.fromkeys(angle.support for angle in angles))
    return np.array([k + 0.5 * names.index(angle.support) for k, angle in enumerate(angles)])
