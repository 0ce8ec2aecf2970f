"""The residual contact wrench at each posture: before and after, and each axis against ±2σ."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import PostureTable
from tdfscal.records import FloatArray, IntArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, Tips, figure, legend_above, logarithmic, raster
from tdfscal.validation.residual_wrench import Validation

_MARKS = (("x", "o", ink.BLUE), ("y", "s", ink.ORANGE), ("z", "^", ink.GREEN))
_BAND = 2.0
#: Share of a normal distribution within ±2 standard deviations.
_EXPECTED = 0.9545
_TINY = 1e-300


def draw(c: Calibration) -> Drawing | None:
    """Length of the residual force and moment, posture by posture."""
    return None if c.postures is None else of(c.postures)


def of(table: PostureTable) -> Drawing | None:
    """The same of a table."""
    if not table.index:
        return None
    before, after = _rms(_length(table.force_before)), _rms(_length(table.force_after))
    m_before, m_after = _rms(_length(table.moment_before)), _rms(_length(table.moment_after))
    return Drawing(
        "residuals",
        "Residual contact wrench at each posture",
        f"Uncalibrated, a controller would take {before:.3g} N and {m_before:.3g} N·m for contact "
        f"where there is none; calibrated, {after:.2g} N and {m_after:.2g} N·m (rms, each posture "
        "predicted from the others).",
        lambda: _paint(
            np.array(table.index) + 1,
            np.stack([_length(table.force_before), _length(table.moment_before)], axis=1),
            np.stack([_length(table.force_after), _length(table.moment_after)], axis=1),
            "after: calibrated without this posture",
        ),
    )


def _paint(number: IntArray, before: FloatArray, after: FloatArray, said: str) -> Figure:
    """Draw lengths (K, 2) of force and moment, N and N·m; said : what `after` is."""
    fig = figure(3.3)
    top, bottom = fig.subplots(2, 1, sharex=True)
    for k, (ax, label) in enumerate(((top, "force, N"), (bottom, "moment, N·m"))):
        _panel(ax, number, before[:, k], after[:, k], label, said)
    bottom.set_xlabel("posture")
    bottom.xaxis.get_major_locator().set_params(integer=True)
    legend_above(top, 2)
    return fig


def _panel(
    ax: Axes, number: IntArray, before: FloatArray, after: FloatArray, label: str, said: str
) -> None:
    pixels = raster(len(number))
    size = 2.0 if pixels else 4.5
    for value, marker, colour, inside, name in (
        (before, "s", ink.ORANGE, "white", "before: nominal mounting, stated zeros"),
        (after, "o", ink.BLUE, ink.BLUE, said),
    ):
        ax.plot(
            number, value, marker, markersize=size, color=colour, markerfacecolor=inside,
            label=name, rasterized=pixels,
        )  # fmt: skip
    if not pixels:
        unit = label.rpartition(" ")[2]
        words = [
            f"posture {k}: {b:.3g} {unit} before, {a:.3g} {unit} after"
            for k, b, a in zip(number, before, after, strict=True)
        ]
        Tips(ax, number, after, words)
    if min(before.min(), after.min()) > 0:
        logarithmic(ax)
    ax.set_ylabel(label)


def _length(vectors: tuple[tuple[float, float, float], ...]) -> FloatArray:
    return np.asarray(np.linalg.norm(np.array(vectors), axis=1))


def _rms(lengths: FloatArray) -> float:
    return float(np.sqrt(np.mean(lengths**2)))


def validated(v: Validation) -> Drawing:
    """Length of the residual force and moment, posture by posture."""
    before, after = (np.linalg.norm(w.reshape(-1, 2, 3), axis=2) for w in (v.nominal, v.calibrated))
    worst = int(after[:, 0].argmax())
    return Drawing(
        "validation",
        "Residual contact wrench at each posture",
        "Nothing should touch the terminal at these postures, so that no force should be left; "
        f"the largest is {after[worst, 0]:.2g} N, at posture {v.used[worst] + 1}.",
        lambda: _paint(v.used + 1, before, after, "after: with this calibration"),
    )


def components(c: Calibration) -> Drawing | None:
    """Force and moment of each leave-one-out posture, axis by axis."""
    return None if c.postures is None else components_of(c.postures)


def components_of(table: PostureTable) -> Drawing | None:
    """The same of a table."""
    if not table.index or table.force_std is None or table.moment_std is None:
        return None
    score = _scores(table, table.force_std, table.moment_std)
    inside = float(np.mean(np.abs(score) <= _BAND))
    said = (
        f"{inside:.0%} of the {score.size} residuals lie within ±2 standard uncertainties; "
        f"{_EXPECTED:.0%} are to be expected."
    )
    return Drawing(
        "components",
        "Residual of each axis against ±2σ",
        said,
        lambda: _paint_components(np.array(table.index) + 1, score, _values(table)),
    )


def _values(table: PostureTable) -> FloatArray:
    """(K, 6), N and N·m."""
    return np.hstack([np.array(table.force_after), np.array(table.moment_after)])


def _scores(table: PostureTable, *std: tuple[tuple[float, float, float], ...]) -> FloatArray:
    """(K, 6), residuals in their standard uncertainties; 0 where an axis says nothing."""
    scale = np.hstack([np.array(column) for column in std])
    return np.where(scale > 0, _values(table) / np.maximum(scale, _TINY), 0.0)


def _paint_components(number: IntArray, score: FloatArray, value: FloatArray) -> Figure:
    fig = figure(3.1)
    pixels = raster(score.size // 2)
    panels = fig.subplots(2, 1, sharex=True)
    for ax, columns, what, unit in (
        (panels[0], slice(0, 3), "force", "N"),
        (panels[1], slice(3, 6), "moment", "N·m"),
    ):
        ax.axhspan(-_BAND, _BAND, color=ink.PALE, alpha=0.5, linewidth=0)
        ax.axhline(0.0, color=ink.GREY, linewidth=0.6)
        for k, (axis, marker, colour) in enumerate(_MARKS):
            part = score[:, columns][:, k]
            place = number + 0.18 * (k - 1)
            ax.plot(place, part, marker, color=colour, markersize=3, label=axis, rasterized=pixels)
        if not pixels:
            rows, words = score[:, columns], []
            for posture, row, size in zip(number, rows, value[:, columns], strict=True):
                parts = ", ".join(
                    f"{a} {v:.2g} {unit} ({s:+.1f} σ)"
                    for (a, *_), v, s in zip(_MARKS, size, row, strict=True)
                )
                words.append(f"posture {posture}: {parts}")
            largest = rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)]
            Tips(ax, number, largest, words, radius=5)
        ax.set_ylabel(f"{what}, std. unc.")
    panels[1].set_xlabel("posture; pale: ±2 standard uncertainties")
    panels[1].xaxis.get_major_locator().set_params(integer=True)
    legend_above(panels[0], 3)
    return fig
