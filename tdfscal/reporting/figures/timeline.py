"""Over time: dwells and forces of a log, contact wrenches, thresholds; the chart of a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.catalogue.entry import begun
from tdfscal.catalogue.numbers import measured, typeset, with_std
from tdfscal.comparison.control_chart import Alarm
from tdfscal.comparison.history import Life
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import DwellTable, PostureTable
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import clock, date_of, style
from tdfscal.reporting.figures.style import Drawing, legend_above, legend_outside, panels

#: Labels of panels: of each axis of the sensors, and of the contact wrench.
_FORCES, _WRENCH = ("Fx, N", "Fy, N", "Fz, N"), ("force, N", "torque, N·m")
_MARKERS = "osD^vPX*"
_LINES = ("-", "--", ":")
#: Of a log whose rows are postures: how wide each is.
_ROW = 0.9


def draw(c: Calibration) -> Drawing | None:
    """Mean forces of the dwells over the time of the log."""
    used, dwells, gone = c.postures, c.dwells, c.fit.rejected if c.fit else ()
    if used is None or not used.index or dwells is None:
        return None
    time = clock(c)
    said = f"{len(used.index)} of {len(used.index) + len(gone)} dwells are in the fit"
    if time.unit == "s":
        said += f", {np.sum(used.end) - np.sum(used.start):.0f} s of force readings in all"
    said += f"; {len(gone) or 'none'} had to be rejected{' (hatched)' * bool(gone)}."
    paint = partial(_paint, c, used, dwells, gone)
    of = " of the last campaign" * (len(c.campaigns) > 1)
    return Drawing("timeline", f"The log and its dwells{of}", said, paint)


def _paint(
    c: Calibration, used: PostureTable, dwells: DwellTable, gone: Sequence[RejectedPosture]
) -> Figure:
    """A panel per axis, a line per sensor; rejected dwells are hatched, other rests shaded."""
    time = clock(c)
    fig, axes = panels(3.4, _FORCES)

    def span(start: float, end: float) -> tuple[float, float]:
        shortest = _ROW if time.unit == "row" else 0.0
        return start - time.origin, start - time.origin + max(end - start, shortest)

    x = [0.5 * sum(span(*pair)) for pair in zip(dwells.start, dwells.end, strict=True)]
    pixels, force = style.raster(3 * len(x)), np.array(dwells.force)
    for k, ax in enumerate(axes):
        for i, support in enumerate(c.rig.supports):
            if "xyz"[k] in support.axes:
                look = _MARKERS[i % len(_MARKERS)], style.LINES[i % len(style.LINES)]
                ax.plot(
                    x, force[:, i, k], marker=look[0], color=look[1], label=support.name,
                    linewidth=0.7, markersize=3.2, rasterized=pixels,
                )  # fmt: skip
        for piece in used.left_out:
            ax.axvspan(*span(piece.start, piece.end), color=style.PALE)
        for r in gone:
            ax.axvspan(*span(r.start, r.end), linewidth=0.4, **style.REJECTED)
    for r in gone:
        place = span(r.start, r.end)[1], axes[0].get_ylim()[1]
        style.beside(axes[0], f"{r.index + 1}", *place, 2, fontweight="bold")
    axes[-1].set_xlabel(time.label)
    legend_outside(fig, *axes)
    return fig


def contact_wrench(columns: Mapping[str, FloatArray], largest: float) -> Drawing:
    """Draw the columns of an applied log: time, fx … mz, and the same as raw_fx ….

    columns : (N,) each; s, N, N·m, LCS. largest : contact force of the log, N.
    """

    def paint() -> Figure:
        time = columns["time"] - columns["time"][0]
        look: dict[str, Any] = {"linewidth": 0.9, "rasterized": style.raster(len(time))}
        fig, axes = panels(4.6, _WRENCH)
        for ax, letter in zip(axes, "fm", strict=True):
            for axis in "xyz":
                ax.plot(time, columns[f"raw_{letter}{axis}"], color=style.PALE, **look)
            for (axis, _, colour), line in zip(style.AXES, _LINES, strict=True):
                name = letter + axis
                ax.plot(time, columns[name], line, color=colour, label=name, **look)
            legend_above(ax, 3)
        axes[1].set_xlabel("time since the first sample, s; pale: uncalibrated")
        return fig

    said = f"The largest contact force of the log is {measured(largest, 3)} N."
    return Drawing("contact-wrench", "Contact wrench over the log", said, paint)


Dates = npt.NDArray[np.object_]
_BAND: dict[str, Any] = {"facecolor": style.PALE, "edgecolor": style.GREY, "linewidth": 0.4}
#: Of a step, and of a creep.
_ALARMS: tuple[dict[str, Any], ...] = (
    {"color": style.RED},
    {"color": style.ORANGE, "linestyle": "-."},
)
#: A path that moves by less is said to rest, mrad.
_STILL = 1e-3


def control_charts(life: Life, said: Callable[[Alarm], str]) -> tuple[Drawing, ...]:
    """One figure per sensor that is known: its three angles; said : an alarm in words.

    Those with alarms come first, the least probable first of all; an alarm of all sensors together
    stands in every one.
    """
    weight: dict[int | None, float] = {}
    for alarm in life.alarms:
        weight[alarm.sensor] = min(alarm.p_value, weight.get(alarm.sensor, 2.0))
    known = map(int, np.flatnonzero(life.known))
    found = []
    for i in sorted(known, key=lambda i: weight.get(i, 2.0)):
        own = [alarm for alarm in life.alarms if alarm.sensor in (i, None)]
        moved = 1e3 * float(np.abs(life.path[-1, i] - life.path[0, i]).max())
        way = f"moves by {measured(moved)} mrad" if moved >= _STILL else "does not move"
        calm = f"No alarm; between the first and the last check the path {way}."
        reading = " ".join(begun(said(alarm), ".") for alarm in own) or calm
        title, paint = f"{life.supports[i]} over time", partial(_paint_chart, life, i, own)
        found.append(Drawing(f"history-{i + 1}", title, reading, paint))
    return tuple(found)


def _paint_chart(life: Life, i: int, own: list[Alarm]) -> Figure:
    fig, axes = panels(4.6, [f"{angle}, mrad" for angle in ANGLES], sharey=True)
    dates = np.array([date_of(month) for month in life.month])
    for j, ax in enumerate(axes):
        _angle(ax, life, i, j, dates)
        for alarm in own:
            ax.axvline(dates[alarm.onset], linewidth=1.2, **_ALARMS[alarm.kind == "creep"])
    locator = AutoDateLocator(minticks=3, maxticks=8)  # type: ignore[no-untyped-call]
    axes[-1].xaxis.set_major_locator(locator)
    axes[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    dot: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 4}
    keys = [
        Line2D([], [], color=style.BLUE, label="check, 95 %", **dot),
        Line2D([], [], color=style.BLACK, linewidth=1.2, label="smoothed path"),
        Patch(**_BAND, label="its band, 95 %"),
        Line2D([], [], color=style.GREY, linestyle="--", linewidth=0.9, label="mean ± limit"),
        Line2D([], [], linewidth=1.2, label="step", **_ALARMS[False]),
        Line2D([], [], linewidth=1.2, label="creep", **_ALARMS[True]),
    ]
    fig.legend(handles=keys, loc="outside upper left", ncols=6, fontsize=7.5, columnspacing=1.2)
    return fig


def _angle(ax: Axes, life: Life, i: int, j: int, dates: Dates) -> None:
    """Deviation of one angle from its first mean, mrad."""
    shown = life.seen[:, i]
    path, mean, points = (
        1e3 * so3.wrapped(angle[:, i, j] - life.mean[0, i, j])
        for angle in (life.path, life.mean, life.rpy)
    )
    band, half = (1e3 * INTERVAL_FACTOR * std[:, i, j] for std in (life.path_std, life.rpy_std))
    limit = 1e3 * life.limit[:, i, j]
    ax.fill_between(dates, path - band, path + band, **_BAND)
    ax.plot(dates, path, color=style.BLACK, linewidth=1.2)
    for edge in (mean - limit, mean + limit):
        ax.plot(dates[shown], edge[shown], color=style.GREY, linestyle="--", linewidth=0.9)
    ax.errorbar(
        dates[shown], points[shown], yerr=half[shown], fmt="o", color=style.BLUE,
        markersize=3.5, elinewidth=0.8, capsize=2,
    )  # fmt: skip
    now = typeset(f"now {with_std(1e3 * float(life.path[-1, i, j]), band[-1], '+')} mrad")
    ax.set_title(now, fontsize=7.5, loc="right", pad=2, color=style.GREY)
