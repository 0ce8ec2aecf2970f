"""One look for all figures: readable in print, without colour, and by colour-blind readers."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from tdfscal.catalogue.numbers import typeset
from tdfscal.reporting.figures import Drawing as Drawing

if TYPE_CHECKING:
    import pandas as pd

BLACK, GREY, PALE = "#1a1a1a", "#6b6b6b", "#d9d9d9"
BLUE, ORANGE, GREEN, RED = "#0b5394", "#d55e00", "#117733", "#a50f15"
FILLS = ("#4f81bd", "#f2c14e", "#8fbf8f", "#d98880", "#b8a1d9", "#c9c9c9", "#7fcdbb", "#e0a3c8")
LINES = (BLUE, ORANGE, GREEN, "#7b3fa0", RED, GREY, "#0e7c7b", "#b3478f")
"""Of thin lines: dark enough on white, and so bright enough where a dark page turns them about."""
EDGE: dict[str, Any] = {"edgecolor": BLACK, "linewidth": 0.4}
"""Of bars."""
REJECTED: dict[str, Any] = {"facecolor": "white", "edgecolor": RED, "hatch": "////"}
"""Look of what was left out."""
HATCHES = ("", "///", "...", "\\\\\\", "xx", "--", "oo", "++")
"""Beside colours, so that areas differ in black and white."""
AXES = (("x", "o", BLUE), ("y", "s", ORANGE), ("z", "^", GREEN))
"""Name, mark and colour of each component of a vector."""
WIDTH = 7.3
"""Inches: the text width of an A4 page."""
DPI, _SCREEN_DPI = 200, 130
_RASTER_FROM = 400
_SETTINGS: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "text.parse_math": False,
    "axes.formatter.useoffset": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "tdfscal",
}


class Sheet(Figure):
    """A figure that a notebook shows by itself."""

    def _repr_png_(self) -> bytes:
        """The picture as PNG."""
        stream = io.BytesIO()
        self.savefig(stream, format="png", dpi=_SCREEN_DPI)
        return stream.getvalue()


def figure(height: float, *, arranged: bool = True) -> Figure:
    """Return an empty figure, `height` inches high; arranged: its parts make room for others."""
    return Sheet(figsize=(WIDTH, height), layout="constrained" if arranged else None)


def panels(height: float, labels: Sequence[str], **share: Any) -> tuple[Figure, list[Axes]]:
    """A figure of empty panels one above the other over a common axis, each with its label."""
    fig = figure(height)
    axes = list(fig.subplots(len(labels), 1, sharex=True, squeeze=False, **share)[:, 0])
    for ax, label in zip(axes, labels, strict=True):
        ax.set_ylabel(label)
    return fig, axes


def raster(count: int) -> bool:
    """Tell whether so many markers are better drawn as pixels than one by one."""
    return count > _RASTER_FROM


def signed(value: float, form: str) -> str:
    """Return a formatted number with a true minus where it is negative."""
    return typeset(f"{value:{form}}")


def _between_decades(axis: Axis, value: float, _: int) -> str:
    low, high = np.log10(axis.get_view_interval())
    few = np.floor(high) - np.ceil(low) < 1
    return f"{value:g}" if few and f"{value:e}"[0] in "25" else ""


def logarithmic(ax: Axes, which: str = "y") -> None:
    """Logarithmic axes, "x", "y" or "xy", with plain numbers at the decades.

    Where fewer than two decades are seen, at 2 and 5 too.
    """
    for name in which:
        getattr(ax, f"set_{name}scale")("log")
        axis = getattr(ax, f"{name}axis")
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(partial(_between_decades, axis)))


def beside(ax: Axes, text: str, x: float, y: float, off: float, **look: Any) -> None:
    """Small words beside a place in the axes, `off` points to its right, or to its left below 0."""
    ax.annotate(
        text, (x, y), xytext=(off, 0), textcoords="offset points", va="center",
        ha="left" if off > 0 else "right", fontsize=7.5, **look,
    )  # fmt: skip


def legend_above(ax: Axes, columns: int) -> None:
    """Legend over the axes, where it covers nothing."""
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, borderaxespad=0.3)


def legend_outside(fig: Figure, *axes: Axes) -> None:
    """Legend over the whole figure, of what is drawn in any of these axes."""
    drawn: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            drawn.setdefault(label, handle)
    fig.legend(drawn.values(), drawn, loc="outside upper left", ncols=min(4, len(drawn)))


def to_figure(drawing: Drawing) -> Figure:
    """Return the figure itself, for a notebook or to be changed."""
    with look():
        return drawing.paint()


def of_table(table: pd.DataFrame) -> Figure:
    """Return the numbers of a table over its rows, a line for each column."""
    with look():
        fig, (ax,) = panels(3.0, [""])
        for k, (name, column) in enumerate(table.select_dtypes("number").items()):
            ax.plot(column.to_numpy(), marker=".", color=LINES[k % len(LINES)], label=str(name))
        ax.set_xlabel("row of the table")
        legend_outside(fig, ax)
    return fig


def to_svg(drawing: Drawing) -> str:
    """SVG element for a page: no prologue, identifiers of its own, text as outlines."""
    with look():
        stream, drawn = io.StringIO(), drawing.paint()
        drawn.dpi = DPI
        # Not `savefig`, which walks over the whole figure once more before it draws.
        canvas: Any = FigureCanvasSVG(drawn)
        canvas.print_svg(stream, metadata={"Date": None})
    text = stream.getvalue()
    body = re.sub(r"\s*<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    # Several figures share one page, and identifiers must differ between them.
    return re.sub(
        r'(\bid="|url\(#|href="#)', lambda match: f"{match.group(1)}{drawing.name}-", body
    ).strip()


@contextmanager
def look() -> Iterator[None]:
    """Draw in the look of the reports, whatever the user's own settings of matplotlib are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        for name, value in _SETTINGS.items():
            mpl.rcParams[name] = value  # type: ignore[index]
        yield
