"""The residual contact wrench at each posture, before and after."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import PostureTable
from tdfscal.records import FloatArray, IntArray
from tdfscal.reporting.figures.style import (
    BLUE,
    ORANGE,
    Drawing,
    Tips,
    figure,
    legend_above,
    logarithmic,
    raster,
)


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
        lambda: paint(
            np.array(table.index) + 1,
            np.stack([_length(table.force_before), _length(table.moment_before)], axis=1),
            np.stack([_length(table.force_after), _length(table.moment_after)], axis=1),
            "after: calibrated without this posture",
        ),
    )


def paint(number: IntArray, before: FloatArray, after: FloatArray, said: str) -> Figure:
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
    ax.plot(
        number,
        before,
        "s",
        markersize=size,
        markerfacecolor="white",
        color=ORANGE,
        label="before: nominal mounting, stated zeros",
        rasterized=pixels,
    )
    ax.plot(
        number,
        after,
        "o",
        markersize=size,
        color=BLUE,
        label=said,
        rasterized=pixels,
    )
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
