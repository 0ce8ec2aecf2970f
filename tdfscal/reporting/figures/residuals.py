"""What is left: of the contact wrench at each posture, over a motion; of points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.catalogue.numbers import rounded
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import LeftOutStretch, PostureTable
from tdfscal.motioncal.blocks import Stretch
from tdfscal.records import FloatArray, IntArray
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import Drawing, legend_above, logarithmic, raster
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation

#: Means further apart than this, s, are of different stretches.
_GAP = 2.5
#: Inches that a letter of a tick label takes, at most.
_CHARACTER = 0.075
Stretches = Sequence[Stretch] | Sequence[LeftOutStretch]


def at_postures(table: PostureTable | None) -> Drawing | None:
    """Length of the residual force and moment, posture by posture."""
    if table is None or not table.index:
        return None
    before, after = np.array(table.before), np.array(table.after)
    (f, m), (left_f, left_m) = (np.sqrt(np.mean(size**2, axis=0)) for size in (before, after))
    return Drawing(
        "residuals",
        "Residual contact wrench at each posture",
        f"Uncalibrated, a controller would take {rounded(f, 3)} N and {rounded(m, 3)} N·m for "
        f"contact where there is none; calibrated, {rounded(left_f)} N and {rounded(left_m)} N·m "
        "(rms, each posture predicted from the others).",
        lambda: _paint(np.array(table.index) + 1, before, after, "calibrated without this posture"),
    )


def over_motion(c: Calibration) -> Drawing | None:
    """Length of the residual force and moment over the time of a log in motion."""
    if c.motion is None:
        return None
    r = c.motion.residual
    before, after = np.array(r.before), np.array(r.after)
    return _over_time(np.array(r.time), before, after, c.motion.rejected, "calibrated")


def validated(v: Validation | MovingValidation) -> Drawing:
    """The same of a validation, by postures or over the motion."""
    said = "with this calibration"
    if isinstance(v, MovingValidation):
        r = v.residual
        return _over_time(r.time, r.before, r.after, v.rejected, said)
    before, after = (np.linalg.norm(w.reshape(-1, 2, 3), axis=2) for w in (v.nominal, v.calibrated))
    worst = int(after[:, 0].argmax())
    return Drawing(
        "validation",
        "Residual contact wrench at each posture",
        "Nothing should touch the terminal at these postures, so that no force should be left; "
        f"the largest is {rounded(after[worst, 0])} N, at posture {v.used[worst] + 1}.",
        lambda: _paint(v.used + 1, before, after, said),
    )


def _paint(number: IntArray, before: FloatArray, after: FloatArray, said: str) -> Figure:
    pixels = raster(len(number))
    mark = {"linestyle": "", "markersize": 2.0 if pixels else 4.5, "rasterized": pixels}
    square = {"marker": "s", "markerfacecolor": "white", **mark}
    fig, axes = _before_and_after(3.3, number, before, after, said, square, mark | {"marker": "o"})
    _numbered(axes[1], "posture")
    return fig


def _numbered(ax: Any, label: str) -> None:
    """Ticks at whole numbers."""
    ax.set_xlabel(label)
    ax.xaxis.get_major_locator().set_params(integer=True)


def _before_and_after(
    height: float,
    x: FloatArray | IntArray,
    before: FloatArray,
    after: FloatArray,
    said: str,
    *looks: dict[str, Any],
) -> tuple[Figure, list[Axes]]:
    """Force above moment, of lengths (K, 2); said : what `after` is. looks : of both."""
    fig, axes = style.panels(height, ("force, N", "moment, N·m"))
    for k, ax in enumerate(axes):
        ax.plot(
            x, before[:, k], color=style.ORANGE, label="before: nominal mounting, stated zeros",
            **looks[0],
        )  # fmt: skip
        ax.plot(x, after[:, k], color=style.BLUE, label=f"after: {said}", **looks[1])
        if min(np.nanmin(before[:, k]), np.nanmin(after[:, k])) > 0:
            logarithmic(ax)
    legend_above(axes[0], 2)
    return fig, axes


def _over_time(
    time: FloatArray, before: FloatArray, after: FloatArray, left_out: Stretches, said: str
) -> Drawing:
    """Lengths (N, 2) of the residual force and moment at times (N,), s."""

    def paint() -> Figure:
        cuts = np.flatnonzero(np.diff(time) > _GAP) + 1
        x, old, new = (np.insert(v, cuts, np.nan, axis=0) for v in (time, before, after))
        line = {"linewidth": 1.0}
        fig, axes = _before_and_after(4.0, x, old, new, said, line, line)
        for ax in axes:
            for s in left_out:
                ax.axvspan(s.begin, s.end, color=style.PALE)
        axes[1].set_xlabel("time in the log, s")
        return fig

    return Drawing(
        "residual-over-time",
        "Residual contact wrench over the motion",
        "Nothing should be left while nothing touches the terminal; the residual force is "
        f"{rounded(np.sqrt(np.mean(after[:, 0] ** 2)))} N (rms of means over a second)"
        f"{'; what is shaded was left out' if left_out else ''}.",
        paint,
    )


def survey(c: Calibration) -> Drawing | None:
    """Residual of each point of the tracker, as multiples of its standard uncertainty."""
    kept = c.tracker.residuals if c.tracker else None
    if kept is None or not kept.points:
        return None
    names, normalised = kept.points, np.array(kept.normalised)
    worst = int(np.abs(normalised).max(axis=1).argmax())
    rms = 1e6 * float(np.sqrt(np.mean(np.sum(np.square(kept.residual), axis=1))))
    return Drawing(
        "survey",
        "Residuals of the tracker's points",
        f"The {len(names)} points fit within {rounded(rms, 3)} µm (rms); the worst is "
        f"{names[worst]}, {np.abs(normalised[worst]).max():.1f} standard uncertainties off.",
        lambda: _points(names, normalised),
    )


def _points(names: Sequence[str], residual: FloatArray) -> Figure:
    """Components (K, 3) of each point's residual; a line between groups, named once each."""
    fig, (ax,) = style.panels(2.6, ("residual / its\nstd. uncertainty",))
    style.marks(ax, np.arange(len(names)), residual)
    ax.axhline(0, color=style.GREY, linewidth=0.8)
    start, ticks, labels, upright = 0, [], [], True
    for group, members in groupby(name.split("/")[0] for name in names):
        size = len(list(members))
        ticks.append(start + (size - 1) / 2)
        labels.append(f"{group} ({size})" if size > 1 else group)
        upright &= _CHARACTER * len(labels[-1]) < 0.88 * style.WIDTH * size / len(names)
        start += size
        ax.axvline(start - 0.5, color=style.GREY, linewidth=0.5, linestyle=":")
    ax.set_xticks(ticks, labels, rotation=0 if upright else 90)
    ax.set_xlabel("points: moves of each NCP first, then targets on each sensor")
    ax.grid(axis="x", visible=False)
    ax.set_xlim(-0.7, len(names) - 0.3)
    legend_above(ax, 3)
    return fig
