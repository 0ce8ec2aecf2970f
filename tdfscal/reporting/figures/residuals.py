"""What is left: of the contact wrench at each posture, over a motion; of points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.catalogue.numbers import measured
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


def at_postures(table: PostureTable | None, of: str = "") -> Drawing | None:
    """Length of the residual force and moment, posture by posture; of : a pool, which campaign."""
    if table is None or not table.index:
        return None
    before, after = np.array(table.before), np.array(table.after)
    (f, m), (left_f, left_m) = (np.sqrt(np.mean(size**2, axis=0)) for size in (before, after))
    said = "calibrated without this posture"
    return Drawing(
        "residuals",
        f"Residual contact wrench at each posture{of}",
        f"Uncalibrated, a controller would take {measured(f, 3)} N and {measured(m, 3)} N·m for "
        f"contact where there is none; calibrated, {measured(left_f)} N and {measured(left_m)} N·m "
        "(rms, each posture predicted from the others).",
        lambda: _at_postures(np.array(table.index) + 1, before, after, said),
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
        f"the largest is {measured(after[worst, 0])} N, at posture {v.used[worst] + 1}.",
        lambda: _at_postures(v.used + 1, before, after, said),
    )


def _at_postures(number: IntArray, before: FloatArray, after: FloatArray, said: str) -> Figure:
    look = {"linestyle": "", "markersize": 2.0 if raster(len(number)) else 4.5}
    fig, axes = _before_and_after(number, before, after, said, "posture", **look)
    axes[1].xaxis.get_major_locator().set_params(integer=True)  # type: ignore[call-arg]
    return fig


def _before_and_after(
    x: FloatArray | IntArray,
    before: FloatArray,
    after: FloatArray,
    said: str,
    label: str,
    **look: Any,
) -> tuple[Figure, list[Axes]]:
    """Force above moment, of lengths (K, 2); said : what `after` is."""
    fig, axes = style.panels(3.6, ("force, N", "moment, N·m"))
    look |= {"rasterized": raster(len(x)), "markerfacecolor": "white"}
    marks = ("s", "o") if "markersize" in look else ("", "")
    nominal = "before: nominal mounting, stated zeros"
    for k, ax in enumerate(axes):
        ax.plot(x, before[:, k], marks[0], color=style.ORANGE, label=nominal, **look)
        ax.plot(x, after[:, k], marks[1], color=style.BLUE, label=f"after: {said}", **look)
        if min(np.nanmin(before[:, k]), np.nanmin(after[:, k])) > 0:
            logarithmic(ax)
    axes[1].set_xlabel(label)
    legend_above(axes[0], 2)
    return fig, axes


def _over_time(
    time: FloatArray, before: FloatArray, after: FloatArray, left_out: Stretches, said: str
) -> Drawing:
    """Lengths (N, 2) of the residual force and moment at times (N,), s."""

    def paint() -> Figure:
        cuts = np.flatnonzero(np.diff(time) > _GAP) + 1
        x, old, new = (np.insert(v, cuts, np.nan, axis=0) for v in (time, before, after))
        fig, axes = _before_and_after(x, old, new, said, "time in the log, s", linewidth=1.0)
        for ax in axes:
            for s in left_out:
                ax.axvspan(s.begin, s.end, color=style.PALE)
        return fig

    return Drawing(
        "residual-over-time",
        "Residual contact wrench over the motion",
        "Nothing should be left while nothing touches the terminal; the residual force is "
        f"{measured(np.sqrt(np.mean(after[:, 0] ** 2)))} N (rms of means over a second)"
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
        f"The {len(names)} points fit within {measured(rms, 3)} µm (rms); the worst is "
        f"{names[worst]}, {np.abs(normalised[worst]).max():.1f} standard uncertainties off.",
        lambda: _points(names, normalised),
    )


def _points(names: Sequence[str], residual: FloatArray) -> Figure:
    """Components (K, 3) of each point's residual; a line between groups, named once each."""
    fig, (ax,) = style.panels(2.6, ("residual / its\nstd. uncertainty",))
    for k, (axis, marker, colour) in enumerate(style.AXES):
        x = np.arange(len(names)) + 0.2 * (k - 1)
        pixels = raster(residual.size)
        ax.plot(
            x, residual[:, k], marker, color=colour, markersize=3.2, label=axis, rasterized=pixels
        )
    ax.axhline(0, color=style.GREY, linewidth=0.8)
    sizes = [(name, len(list(own))) for name, own in groupby(n.split("/")[0] for n in names)]
    ends = np.cumsum([size for _, size in sizes])
    labels = [f"{name} ({size})" if size > 1 else name for name, size in sizes]
    for end in ends[:-1]:
        ax.axvline(end - 0.5, color=style.GREY, linewidth=0.5, linestyle=":")
    narrow = any(
        _CHARACTER * len(label) > 0.88 * style.WIDTH * size / len(names)
        for label, (_, size) in zip(labels, sizes, strict=True)
    )
    middle = ends - [(size + 1) / 2 for _, size in sizes]
    ax.set_xticks(middle, labels, rotation=90 if narrow else 0)
    ax.set_xlabel("points: moves of each NCP first, then targets on each sensor")
    ax.grid(axis="x", visible=False)
    ax.set_xlim(-0.7, len(names) - 0.3)
    legend_above(ax, 3)
    return fig
