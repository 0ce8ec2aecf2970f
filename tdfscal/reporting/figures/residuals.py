"""The residual contact wrench: at each posture, over a motion, over frequency, of each axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tdfscal.catalogue import sentence
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import LeftOutStretch, PostureTable
from tdfscal.motioncal.blocks import Stretch
from tdfscal.records import FloatArray, IntArray
from tdfscal.reporting.figures import ink, style
from tdfscal.reporting.figures.style import Drawing, figure, legend_above, logarithmic, raster
from tdfscal.validation.in_motion import MovingValidation
from tdfscal.validation.residual_wrench import Validation

_UNITS = ("N", "N·m")
_BAND = 2.0
#: Share of a normal distribution within ±2 standard deviations.
_EXPECTED = 0.9545
#: Means further apart than this, s, are of different stretches.
_GAP = 2.5
Stretches = Sequence[Stretch] | Sequence[LeftOutStretch]


def at_postures(table: PostureTable | None) -> Drawing | None:
    """Length of the residual force and moment, posture by posture."""
    if table is None or not table.index:
        return None
    before = _lengths(table.force_before, table.moment_before)
    after = _lengths(table.force_after, table.moment_after)
    (f, m), (left_f, left_m) = (np.sqrt(np.mean(size**2, axis=0)) for size in (before, after))
    return Drawing(
        "residuals",
        "Residual contact wrench at each posture",
        f"Uncalibrated, a controller would take {f:.3g} N and {m:.3g} N·m for contact where there "
        f"is none; calibrated, {left_f:.2g} N and {left_m:.2g} N·m (rms, each posture predicted "
        "from the others).",
        lambda: _paint(np.array(table.index) + 1, before, after, "calibrated without this posture"),
    )


def over_motion(c: Calibration) -> Drawing | None:
    """Length of the residual force and moment over the time of a log in motion."""
    if c.motion is None or c.motion.residual is None:
        return None
    r = c.motion.residual
    before = np.column_stack([r.force_before, r.moment_before])
    after = np.column_stack([r.force_after, r.moment_after])
    return _over_time(np.array(r.time), before, after, c.motion.rejected, "calibrated")


def validated(v: Validation | MovingValidation) -> Drawing:
    """The same of a validation, by postures or over the motion."""
    said = "with this calibration"
    if isinstance(v, MovingValidation):
        r = v.residual
        return _over_time(r.time, r.before, r.after, v.rejected, said)
    before, after = (_lengths(w[:, :3], w[:, 3:]) for w in (v.nominal, v.calibrated))
    worst = int(after[:, 0].argmax())
    return Drawing(
        "validation",
        "Residual contact wrench at each posture",
        "Nothing should touch the terminal at these postures, so that no force should be left; "
        f"the largest is {after[worst, 0]:.2g} N, at posture {v.used[worst] + 1}.",
        lambda: _paint(v.used + 1, before, after, said),
    )


def _lengths(force: ArrayLike, moment: ArrayLike) -> FloatArray:
    """(K, 2), N and N·m."""
    each = [np.linalg.norm(np.asarray(vectors), axis=1) for vectors in (force, moment)]
    return np.stack(each, axis=1)


def _paint(number: IntArray, before: FloatArray, after: FloatArray, said: str) -> Figure:
    pixels = raster(len(number))
    mark = {"linestyle": "", "markersize": 2.0 if pixels else 4.5, "rasterized": pixels}
    square = {"marker": "s", "markerfacecolor": "white", **mark}
    fig, axes = _before_and_after(3.3, number, before, after, said, square, mark | {"marker": "o"})
    for ax, unit, old, new in zip(axes, _UNITS, before.T, after.T, strict=True):
        if not pixels:
            words = [
                f"posture {k}: {b:.3g} {unit} before, {a:.3g} {unit} after"
                for k, b, a in zip(number, old, new, strict=True)
            ]
            style.Tips(ax, number, new, words)
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
    fig = figure(height)
    axes = list(fig.subplots(2, 1, sharex=True))
    for k, (ax, label) in enumerate(zip(axes, ("force, N", "moment, N·m"), strict=True)):
        ax.plot(
            x, before[:, k], color=ink.ORANGE, label="before: nominal mounting, stated zeros",
            **looks[0],
        )  # fmt: skip
        ax.plot(x, after[:, k], color=ink.BLUE, label=f"after: {said}", **looks[1])
        if min(np.nanmin(before[:, k]), np.nanmin(after[:, k])) > 0:
            logarithmic(ax)
        ax.set_ylabel(label)
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
                why = s.reason if isinstance(s, LeftOutStretch) else sentence(s.reason)
                words = f"{s.begin:.1f} to {s.end:.1f} s: {why}"
                style.tip(ax.axvspan(s.begin, s.end, color=ink.PALE), words)
        axes[1].set_xlabel("time in the log, s")
        return fig

    return Drawing(
        "residual-over-time",
        "Residual contact wrench over the motion",
        "Nothing should be left while nothing touches the terminal; the residual force is "
        f"{np.sqrt(np.mean(after[:, 0] ** 2)):.2g} N (rms of means over a second)"
        f"{'; what is shaded was left out' if left_out else ''}.",
        paint,
    )


def components(table: PostureTable | None) -> Drawing | None:
    """Force and moment of each leave-one-out posture, axis by axis, against ±2σ."""
    if table is None or not table.index or table.force_std is None or table.moment_std is None:
        return None
    value = np.hstack([table.force_after, table.moment_after])
    std = np.hstack([table.force_std, table.moment_std])
    # An axis that says nothing has no uncertainty.
    score = np.divide(value, std, out=np.zeros_like(value), where=std > 0)
    number = np.array(table.index) + 1

    def paint() -> Figure:
        fig = figure(3.1)
        axes = fig.subplots(2, 1, sharex=True, sharey=True)
        for k, (ax, what, unit) in enumerate(zip(axes, ("force", "moment"), _UNITS, strict=True)):
            rows, sizes = score[:, 3 * k : 3 * k + 3], value[:, 3 * k : 3 * k + 3]
            ax.axhspan(-_BAND, _BAND, color=ink.PALE, alpha=0.5, linewidth=0)
            ax.axhline(0.0, color=ink.GREY, linewidth=0.6)
            style.marks(ax, number, rows)
            if not raster(rows.size):
                words = [_words(*of, unit) for of in zip(number, sizes, rows, strict=True)]
                largest = rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)]
                style.Tips(ax, number, largest, words, radius=5)
            ax.set_ylabel(f"{what}, std. unc.")
            ax.margins(y=0.1)
        _numbered(axes[1], "posture; pale: ±2 standard uncertainties")
        legend_above(axes[0], 3)
        return fig

    inside = float(np.mean(np.abs(score) <= _BAND))
    return Drawing(
        "components",
        "Residual of each axis against ±2σ",
        f"{inside:.0%} of the {score.size} residuals lie within ±2 standard uncertainties; "
        f"{_EXPECTED:.0%} are to be expected.",
        paint,
    )


def _words(posture: int, sizes: FloatArray, scores: FloatArray, unit: str) -> str:
    axes = zip("xyz", sizes, scores, strict=True)
    return f"posture {posture}: " + ", ".join(
        f"{a} {v:.2g} {unit} ({s:+.1f} σ)" for a, v, s in axes
    )


def spectrum(c: Calibration) -> Drawing | None:
    """Residual force over frequency, and the noise that the estimate weighed by."""
    if c.motion is None:
        return None
    motion, s = c.motion, c.motion.spectrum
    # Force noise of n sensors in three components, as the residual has it.
    noise = np.sqrt(3.0 * len(c.supports)) * np.array(s.force_noise)

    def paint() -> Figure:
        fig = figure(3.2)
        ax = fig.subplots()
        ax.plot(s.frequency, s.before, "s", markersize=4, color=ink.ORANGE, markerfacecolor="white",
                label="before: nominal mounting, stated values")  # fmt: skip
        ax.plot(s.frequency, s.after, "o", markersize=4, color=ink.BLUE, label="after: calibrated")
        ax.plot(s.frequency, noise, "-", color=ink.BLUE, linewidth=1, label="noise as estimated")
        logarithmic(ax, "xy")
        ax.set_xlabel("frequency, Hz")
        ax.set_ylabel("residual force, N/√Hz")
        legend_above(ax, 3)
        return fig

    return Drawing(
        "spectrum",
        "Residual force in motion, over frequency",
        f"In {motion.seconds:.0f} s of motion the calibration takes the slow residual down to "
        "the sensors' noise; the estimate weighs every frequency by the noise that it has there.",
        paint,
    )
