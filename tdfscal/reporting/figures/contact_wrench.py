"""The contact wrench over the time of a log, with and without the calibration."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above, raster

_PANELS = (("fx", "fy", "fz", "force, N"), ("mx", "my", "mz", "torque, N·m"))
_LINES = ((ink.BLUE, "-"), (ink.ORANGE, "--"), (ink.GREEN, ":"))


def draw(columns: Mapping[str, FloatArray], largest: float) -> Drawing:
    """Draw the columns of an applied log: time, fx … mz, and the same as raw_fx ….

    columns : (N,) each; s, N, N·m, LCS. largest : contact force of the log, N.
    """
    return Drawing(
        "contact-wrench",
        "Contact wrench over the log",
        f"The largest contact force of the log is {largest:.3g} N.",
        lambda: _paint(columns),
    )


def _paint(columns: Mapping[str, FloatArray]) -> Figure:
    time = columns["time"] - columns["time"][0]
    fig = figure(4.6)
    for ax, (*names, label) in zip(fig.subplots(2, 1, sharex=True), _PANELS, strict=True):
        for name in names:
            ax.plot(
                time, columns[f"raw_{name}"], color=ink.PALE, linewidth=0.6,
                rasterized=raster(len(time)),
            )  # fmt: skip
        for name, (colour, style) in zip(names, _LINES, strict=True):
            ax.plot(
                time, columns[name], color=colour, linestyle=style, linewidth=0.9,
                label=name, rasterized=raster(len(time)),
            )  # fmt: skip
        ax.axhline(0.0, color=ink.GREY, linewidth=0.6)
        ax.set_ylabel(label)
        legend_above(ax, 3)
    fig.axes[-1].set_xlabel("time since the first sample, s; pale: uncalibrated")
    return fig
