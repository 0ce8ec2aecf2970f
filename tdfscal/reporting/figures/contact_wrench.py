"""The contact wrench over the time of a log, with and without the calibration."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above, raster

_LINES = ("-", "--", ":")


def draw(columns: Mapping[str, FloatArray], largest: float) -> Drawing:
    """Draw the columns of an applied log: time, fx … mz, and the same as raw_fx ….

    columns : (N,) each; s, N, N·m, LCS. largest : contact force of the log, N.
    """

    def paint() -> Figure:
        time = columns["time"] - columns["time"][0]
        pixels = raster(len(time))
        fig = figure(4.6)
        axes = fig.subplots(2, 1, sharex=True)
        for ax, letter, label in zip(axes, "fm", ("force, N", "torque, N·m"), strict=True):
            names = [letter + axis for axis in "xyz"]
            for name in names:
                raw = columns[f"raw_{name}"]
                ax.plot(time, raw, color=ink.PALE, linewidth=0.6, rasterized=pixels)
            for name, (_, _, colour), style in zip(names, ink.AXES, _LINES, strict=True):
                look = {"color": colour, "linewidth": 0.9, "rasterized": pixels}
                ax.plot(time, columns[name], style, label=name, **look)
            ax.axhline(0.0, color=ink.GREY, linewidth=0.6)
            ax.set_ylabel(label)
            legend_above(ax, 3)
        axes[1].set_xlabel("time since the first sample, s; pale: uncalibrated")
        return fig

    said = f"The largest contact force of the log is {largest:.3g} N."
    return Drawing("contact-wrench", "Contact wrench over the log", said, paint)
