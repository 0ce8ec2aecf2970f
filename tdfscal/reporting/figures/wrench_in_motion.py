"""The residual contact wrench over the time of a motion, with the stretches that were left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.records import FloatArray
from tdfscal.reporting.figures.style import (
    BLUE,
    ORANGE,
    PALE,
    Drawing,
    figure,
    legend_above,
    logarithmic,
    tip,
)
from tdfscal.validation.in_motion import MovingValidation

_TITLE = "Residual contact wrench over the motion"
#: Means further apart than this, s, are of different stretches.
_GAP = 2.5
Stretches = Sequence[tuple[float, float, str]]


def draw(c: Calibration) -> Drawing | None:
    """Of a calibration: the course that its file holds."""
    if c.motion is None or c.motion.residual is None:
        return None
    r = c.motion.residual
    before = np.stack([np.array(r.force_before), np.array(r.moment_before)], axis=1)
    after = np.stack([np.array(r.force_after), np.array(r.moment_after)], axis=1)
    left_out = [(s.begin, s.end, s.reason) for s in c.motion.rejected]
    return _drawing(np.array(r.time), before, after, left_out, "calibrated")


def validation(v: MovingValidation) -> Drawing:
    """Of a validation."""
    r = v.residual
    left_out = [(s.begin, s.end, s.reason) for s in v.rejected]
    return _drawing(r.time, r.before, r.after, left_out, "with this calibration")


def _drawing(
    time: FloatArray, before: FloatArray, after: FloatArray, left_out: Stretches, said: str
) -> Drawing:
    grey = "; what is shaded was left out" if left_out else ""
    rms = np.sqrt(np.mean(after[:, 0] ** 2))
    return Drawing(
        "residual-over-time",
        _TITLE,
        "Nothing should be left while nothing touches the terminal; the residual force is "
        f"{rms:.2g} N (rms of means over a second){grey}.",
        lambda: _paint(time, before, after, left_out, said),
    )


def _paint(
    time: FloatArray, before: FloatArray, after: FloatArray, left_out: Stretches, said: str
) -> Figure:
    """Draw lengths (N, 2) of force and moment at times (N,), s."""
    fig = figure(4.0)
    axes = fig.subplots(2, 1, sharex=True)
    cuts = np.flatnonzero(np.diff(time) > _GAP) + 1
    for k, (ax, label) in enumerate(zip(axes, ("force, N", "moment, N·m"), strict=True)):
        for value, colour, name in (
            (before, ORANGE, "before: nominal mounting, stated zeros"),
            (after, BLUE, f"after: {said}"),
        ):
            for part, rows in enumerate(np.split(np.arange(len(time)), cuts)):
                ax.plot(
                    time[rows], value[rows, k], color=colour, linewidth=1.0,
                    label=name if part == 0 else None,
                )  # fmt: skip
        for begin, end, reason in left_out:
            tip(ax.axvspan(begin, end, color=PALE), f"{begin:.1f} to {end:.1f} s: {reason}")
        if min(before[:, k].min(), after[:, k].min()) > 0:
            logarithmic(ax)
        ax.set_ylabel(label)
    axes[-1].set_xlabel("time in the log, s")
    legend_above(axes[0], 2)
    return fig
