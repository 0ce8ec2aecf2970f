"""Thresholds over a path, what the calibration may fake there, and the contact seen from there."""

from __future__ import annotations

from matplotlib.figure import Figure

from tdfscal.detection.capability import Capability
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above
from tdfscal.significance import COVERAGE_FACTOR

_LINES = ("-", "--", ":")


def over_path(found: Capability, *, timed: bool) -> Drawing:
    """Draw a panel of forces and one of torques."""

    def paint() -> Figure:
        time = found.time - found.time[0]
        fig = figure(5.0)
        axes = fig.subplots(2, 1, sharex=True)
        for ax, letter, first, label in zip(
            axes, "fm", (0, 3), ("force, N", "torque, N·m"), strict=True
        ):
            for k, ((axis, _, colour), line) in enumerate(zip(ink.AXES, _LINES, strict=True)):
                c = first + k
                look = {"color": colour, "linewidth": 1.0, "linestyle": line}
                ax.plot(time, found.seen_from[:, c], label=f"{letter}{axis}", **look)
                ax.axhline(found.threshold[c], color=colour, linewidth=0.7, linestyle=line)
                fake = COVERAGE_FACTOR * found.calibration_std[:, c]
                ax.fill_between(time, 0.0, fake, color=colour, alpha=0.15, linewidth=0)
            ax.set_ylabel(label)
            ax.set_ylim(bottom=0.0)
            legend_above(ax, 3)
        axes[1].set_xlabel("time since the first sample, s" if timed else "posture")
        return fig

    return Drawing(
        "capability",
        "Smallest contact along the path",
        "Thick: the smallest contact seen; thin: its threshold; shaded: what calibration, zeros "
        "and postures may fake (k = 2).",
        paint,
    )
