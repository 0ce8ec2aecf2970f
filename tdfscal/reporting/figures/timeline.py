"""The log's timeline: dwells in use and rejected, stretches left out, forces of every dwell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence_model import DwellTable, PostureTable
from tdfscal.files.calibration.log_time import Clock, log_clock
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.files.rig.model import RigFile
from tdfscal.records import Dwells
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import (
    Drawing,
    beside,
    figure,
    legend_above,
    legend_outside,
    raster,
    tip,
)

#: Height of a panel of forces, inches.
_PANEL = 0.72
_MARKERS = "osD^vPX*"


@dataclass(frozen=True, slots=True)
class DwellLog:
    """The dwells of a log: in the fit, rejected, and all with their readings where kept."""

    rig: RigFile
    postures: PostureTable
    rejected: tuple[RejectedPosture, ...]
    dwells: DwellTable | None

    @property
    def clock(self) -> Clock:
        """How its time counts."""
        return log_clock(self.rig, self.postures, self.rejected)


def draw(c: Calibration) -> Drawing | None:
    """The log behind a calibration."""
    if c.postures is None:
        return None
    return of(DwellLog(c.rig, c.postures, c.fit.rejected if c.fit else (), c.dwells))


def of(log: DwellLog) -> Drawing | None:
    """Lanes over the time of the log, and the forces below."""
    table = log.postures
    if not table.index:
        return None
    rejected = [r for r in log.rejected if r.start is not None]
    total = len(table.index) + len(rejected)
    averaged = float(np.sum(np.array(table.end) - np.array(table.start)))
    said = f"{len(table.index)} of {total} dwells are in the fit"
    if log.clock.unit == "s":
        said += f", {averaged:.0f} s of force readings in all"
    said += f"; {len(rejected)} had to be rejected." if rejected else "; none had to be rejected."
    return Drawing("timeline", "The log and its dwells", said, lambda: _paint(log, rejected))


def _paint(log: DwellLog, rejected: list[RejectedPosture]) -> Figure:
    time, table = log.clock, log.postures
    width = 0.9 if time.unit == "row" else 0.0
    lanes = ["in the fit", "rejected"] + (["no dwell"] if table.left_out else [])
    heights = [0.34 * len(lanes)] + ([_PANEL] * 3 if log.dwells is not None else [])
    fig = figure(0.75 + sum(heights))
    panels = np.atleast_1d(
        fig.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights})
    )
    gone = [(r.start - time.origin, max(r.end - r.start, width), r.index + 1) for r in rejected
            if r.start is not None and r.end is not None]  # fmt: skip
    _lanes(panels[0], table, gone, lanes, width, time.origin)
    if log.dwells is not None:
        _forces(list(panels[1:]), log.rig, log.dwells, gone, width, time.origin)
        legend_outside(fig, panels[1])
    panels[-1].set_xlabel(time.label)
    return fig


def _lanes(
    ax: Axes,
    table: PostureTable,
    gone: list[tuple[float, float, int]],
    lanes: list[str],
    width: float,
    origin: float,
) -> None:
    """Dwells in the fit, rejected ones with their numbers, stretches that are no dwells."""
    pixels = raster(len(table.index))
    spans = [(s - origin, max(e - s, width)) for s, e in zip(table.start, table.end, strict=True)]
    ax.broken_barh(
        spans,
        (-0.36, 0.72),
        facecolor=ink.FILLS[0],
        edgecolor=ink.BLACK,
        linewidth=0.0 if pixels else 0.5,
        rasterized=pixels,
    )
    for x, w, number in gone:
        ax.broken_barh([(x, w)], (0.64, 0.72), linewidth=0.9, **ink.REJECTED)
        beside(ax, f"{number}", x + w, 1, 2, fontweight="bold")
    if not gone:
        ax.text(0.01, 1, "none", transform=ax.get_yaxis_transform(), va="center", color=ink.GREY)
    for piece in table.left_out or ():
        ax.broken_barh(
            [(piece.start - origin, max(piece.end - piece.start, width))],
            (1.64, 0.72),
            facecolor=ink.PALE,
            edgecolor=ink.GREY,
            hatch="...",
            linewidth=0.4,
        )
    ax.set_ylim(len(lanes) - 0.45, -0.5)
    ax.set_yticks(range(len(lanes)), lanes)
    ax.grid(axis="y", visible=False)


def _forces(
    panels: Sequence[Axes],
    rig: RigFile,
    dwells: DwellTable,
    gone: list[tuple[float, float, int]],
    width: float,
    origin: float,
) -> None:
    """Mean readings of each dwell, a panel per axis of the sensors, rejected dwells shaded."""
    start = np.array(dwells.start) - origin
    middle = start + np.maximum(np.array(dwells.end) - np.array(dwells.start), width) / 2
    force, pixels = np.array(dwells.force), raster(3 * len(start))
    for k, ax in enumerate(panels):
        for x, w, _ in gone:
            ax.axvspan(x, x + w, linewidth=0.4, **ink.REJECTED)
        for i, support in enumerate(rig.supports):
            if "xyz"[k] not in support.axes:
                continue
            (line,) = ax.plot(
                middle, force[i, :, k], linewidth=0.7, color=ink.LINES[i % len(ink.LINES)],
                marker=_MARKERS[i % len(_MARKERS)], markersize=3.2, markeredgecolor=ink.BLACK,
                markeredgewidth=0.3, label=support.name, rasterized=pixels,
            )  # fmt: skip
            low, high = force[i, :, k].min(), force[i, :, k].max()
            tip(line, f"{support.name} F{'xyz'[k]}: {low:.1f} to {high:.1f} N")
        ax.set_ylabel(f"F{'xyz'[k]}, N")


def found(dwells: Dwells) -> Drawing:
    """Length of each sensor's mean force, a bar over the time of every dwell."""
    return Drawing(
        "dwells",
        "Static dwells",
        f"{len(dwells)} dwells are found.",
        lambda: _paint_found(dwells),
    )


def _paint_found(dwells: Dwells) -> Figure:
    force = np.linalg.norm(dwells.force, axis=2)
    start = dwells.start - dwells.start[0]
    length = np.maximum(dwells.end - dwells.start, 0.0)
    fig = figure(2.6)
    ax = fig.subplots()
    for i, name in enumerate(dwells.supports):
        ax.hlines(
            force[:, i],
            start,
            start + length,
            color=ink.FILLS[i % len(ink.FILLS)],
            linewidth=3,
            label=name,
        )
        ax.plot(start, force[:, i], "|", color=ink.FILLS[i % len(ink.FILLS)], markersize=4)
    ax.set_xlabel("time since the first dwell, s")
    ax.set_ylabel("force, N")
    legend_above(ax, 4)
    return fig
