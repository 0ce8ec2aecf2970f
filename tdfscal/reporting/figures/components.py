"""Residuals of each axis in units of their standard uncertainties, against ±2."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import PostureTable
from tdfscal.records import FloatArray, IntArray
from tdfscal.reporting.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    Drawing,
    Tips,
    figure,
    legend_above,
    raster,
)

_MARKS = (("x", "o", BLUE), ("y", "s", ORANGE), ("z", "^", GREEN))
_BAND = 2.0
#: Share of a normal distribution within ±2 standard deviations.
_EXPECTED = 0.9545
_TINY = 1e-300


def draw(c: Calibration) -> Drawing | None:
    """Force and moment of each leave-one-out posture, axis by axis."""
    return None if c.postures is None else of(c.postures)


def of(table: PostureTable) -> Drawing | None:
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
        lambda: _paint(np.array(table.index) + 1, score, _values(table)),
    )


def _values(table: PostureTable) -> FloatArray:
    """(K, 6), N and N·m."""
    return np.hstack([np.array(table.force_after), np.array(table.moment_after)])


def _scores(table: PostureTable, *std: tuple[tuple[float, float, float], ...]) -> FloatArray:
    """(K, 6), residuals in their standard uncertainties; 0 where an axis says nothing."""
    scale = np.hstack([np.array(column) for column in std])
    return np.where(scale > 0, _values(table) / np.maximum(scale, _TINY), 0.0)


def _paint(number: IntArray, score: FloatArray, value: FloatArray) -> Figure:
    fig = figure(3.1)
    pixels = raster(score.size // 2)
    panels = fig.subplots(2, 1, sharex=True)
    for ax, columns, what, unit in (
        (panels[0], slice(0, 3), "force", "N"),
        (panels[1], slice(3, 6), "moment", "N·m"),
    ):
        ax.axhspan(-_BAND, _BAND, color=PALE, alpha=0.5, linewidth=0)
        ax.axhline(0.0, color=GREY, linewidth=0.6)
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
