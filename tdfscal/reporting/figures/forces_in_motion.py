"""The forces over the time of a motion, with the stretches that were left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.log_time import clock_from
from tdfscal.motioncal.contact import Stretch
from tdfscal.motioncal.streams import Slow
from tdfscal.reporting.figures.style import INK, LINES, RED, Drawing, figure, tip

#: Instants of a line at most; more are not to be told apart.
_INSTANTS = 1500


def draw(slow: Slow, rejected: Sequence[Stretch]) -> Drawing:
    """A panel per axis of the sensors, a line per sensor."""
    said = f"{slow.time[-1] - slow.time[0]:.0f} s of the log are in motion"
    lost = sum(s.end - s.begin for s in rejected)
    said += f"; {lost:.0f} s in {len(rejected)} stretches (hatched) were left out." if lost else "."
    return Drawing("forces", "The log and its forces", said, lambda: _paint(slow, rejected))


def _paint(slow: Slow, rejected: Sequence[Stretch]) -> Figure:
    time = clock_from(float(slow.time[0]))
    fig = figure(3.4)
    every = max(1, len(slow.time) // _INSTANTS)
    x, force = slow.time[::every] - time.origin, slow.force[::every]
    panels = fig.subplots(3, 1, sharex=True)
    for k, ax in enumerate(panels):
        for s in rejected:
            span = ax.axvspan(
                s.begin - time.origin, s.end - time.origin,
                facecolor="white", edgecolor=RED, hatch="////", linewidth=0.4,
            )  # fmt: skip
            tip(span, s.reason)
        for i, name in enumerate(slow.supports):
            y = force[:, i, k]
            if not np.isfinite(y).any():
                continue
            (line,) = ax.plot(x, y, color=LINES[i % len(LINES)], linewidth=1.1, label=name)
            tip(line, f"{name} F{'xyz'[k]}: {np.nanmin(y):.1f} to {np.nanmax(y):.1f} N")
        ax.set_ylabel(f"F{'xyz'[k]}, N", color=INK)
    panels[-1].set_xlabel(time.label)
    fig.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside upper left",
        ncols=min(len(slow.supports), 4),
    )
    return fig
