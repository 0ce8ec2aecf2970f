"""Residuals of points: of the tracker's survey, and of a registration."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import JsonValue

from tdfscal.files.calibration.document import Calibration
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import WIDTH, Drawing, figure, legend_above, marks
from tdfscal.trackercal import PointRegistration

_CHARACTER = 0.075
"""Inches that a letter of a tick label takes, at most."""


def draw(c: Calibration) -> Drawing | None:
    """Residual of each point in µm and in its standard uncertainties."""
    found = _read(c.tracker)
    if found is None:
        return None
    names, residual, normalised = found
    worst = int(np.abs(normalised).max(axis=1).argmax())
    rms = 1e6 * float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))

    def paint() -> Figure:
        fig = figure(3.9)
        top, bottom = fig.subplots(2, 1, sharex=True)
        for ax, table in ((top, 1e6 * residual), (bottom, normalised)):
            marks(ax, np.arange(len(names)), table)
            ax.axhline(0, color=ink.GREY, linewidth=0.8)
        for limit in (-2, 2):
            bottom.axhline(limit, color=ink.BLACK, linewidth=0.8, linestyle="--")
        top.set_ylabel("residual, µm")
        bottom.set_ylabel("residual / its\nstd. uncertainty")
        _groups(bottom, top, names)
        legend_above(top, 3)
        return fig

    return Drawing(
        "survey",
        "Residuals of the tracker's points",
        f"The {len(names)} points fit within {rms:.3g} µm (rms); the worst is {names[worst]}, "
        f"{np.abs(normalised[worst]).max():.1f} standard uncertainties off.",
        paint,
    )


def _read(
    tracker: Mapping[str, JsonValue] | None,
) -> tuple[list[str], FloatArray, FloatArray] | None:
    """Names (N), residuals (N, 3) in m and in standard uncertainties, where the file has them."""
    kept = tracker.get("residuals") if tracker else None
    if not isinstance(kept, dict) or not isinstance(names := kept.get("points"), list) or not names:
        return None
    try:
        tables = [np.array(kept[key], dtype=float) for key in ("residual", "normalised")]
    except (KeyError, TypeError, ValueError):
        return None
    if any(table.shape != (len(names), 3) for table in tables):
        return None
    return [str(name) for name in names], tables[0], tables[1]


def _groups(bottom: Axes, top: Axes, names: list[str]) -> None:
    """Name the supports once each along the axis, with a line between them."""
    start, ticks, labels, upright = 0, [], [], True
    for group, members in groupby(name.split("/")[0] for name in names):
        size = len(list(members))
        ticks.append(start + (size - 1) / 2)
        labels.append(f"{group} ({size})")
        upright &= _CHARACTER * len(labels[-1]) < 0.88 * WIDTH * size / len(names)
        start += size
        for ax in (bottom, top):
            ax.axvline(start - 0.5, color=ink.GREY, linewidth=0.5, linestyle=":")
    bottom.set_xticks(ticks, labels, rotation=0 if upright else 90)
    bottom.set_xlabel("points: moves of each NCP first, then targets on each sensor")
    for ax in (bottom, top):
        ax.grid(axis="x", visible=False)
        ax.set_xlim(-0.7, len(names) - 0.3)


def registered(r: PointRegistration) -> Drawing:
    """Residual of each point in µm, by coordinate."""

    def paint() -> Figure:
        fig = figure(2.6)
        ax = fig.subplots()
        place = np.arange(len(r.names))
        for j, (axis, residual) in enumerate(zip("xyz", 1e6 * r.residual.T, strict=True)):
            ax.bar(place + 0.27 * (j - 1), residual, width=0.25, color=ink.FILLS[j], label=axis)
        ax.set_xticks(place, r.names, rotation=90 if len(r.names) > 8 else 0)
        ax.set_ylabel("residual, µm")
        ax.grid(axis="x", visible=False)
        legend_above(ax, 3)
        return fig

    said = f"The points fit within {1e6 * r.rms:.3g} µm rms."
    return Drawing("residuals", "Residuals of the points", said, paint)
