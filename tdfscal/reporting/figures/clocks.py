"""How the clocks of recorders that ran apart were brought together."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parts import ActivityResult
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_above


def draw(c: Calibration) -> Drawing | None:
    """What each recorder saw of the moves, by its own stamps and on the first one's clock."""
    kept = [(clock, clock.activity) for clock in c.clocks if clock.activity is not None]
    if not kept:
        return None

    def paint() -> Figure:
        fig = figure(0.6 + 2.6 * len(kept))
        axes = fig.subplots(2 * len(kept), 1, sharex=True, squeeze=False)[:, 0]
        for k, (clock, both) in enumerate(kept):
            (time, first), (own, second) = _courses(both)
            for ax, shift, how in (
                (axes[2 * k], 0.0, "each from its own first stamp"),
                (axes[2 * k + 1], both.lag, "on the first recorder's clock"),
            ):
                ax.plot(time, first, color=ink.BLUE, linewidth=1.0, label="first recorder")
                ax.plot(own - shift, second, color=ink.ORANGE, linewidth=1.0, linestyle="--",
                        label=clock.recorder)  # fmt: skip
                ax.set_yticks([])
                ax.set_ylabel("activity")
                ax.set_title(how, fontsize=7.5, loc="right", pad=2, color=ink.GREY)
            axes[2 * k + 1].set_xlabel("time, s")
            legend_above(axes[2 * k], 2)
        return fig

    known = " and ".join(f"± {1e3 * clock.offset_std:.2g} ms" for clock, _ in kept)
    said = f"The moves that each recorder saw: as stamped, and brought together to {known}."
    return Drawing("clocks", "Clocks of the recorders", said, paint)


def _courses(both: ActivityResult) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Times (B,), s, and activity (B,) of each recorder, from its least to its largest."""
    found: list[tuple[FloatArray, FloatArray]] = []
    for start, values in ((both.start, both.first), (both.second_start, both.second)):
        course: FloatArray = np.array(values, dtype=np.float64)
        time = np.asarray(start + both.width * (np.arange(len(course)) + 0.5), np.float64)
        if np.isfinite(course).any():
            course = (course - np.nanmin(course)) / max(
                float(np.nanmax(course) - np.nanmin(course)), 1e-9
            )
        found.append((time, course))
    return tuple(found)
