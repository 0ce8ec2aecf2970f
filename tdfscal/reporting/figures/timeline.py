"""Over time: contact wrenches of a log; the chart of a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import date_of, style
from tdfscal.reporting.figures.style import Drawing, legend_above, panels

_LINES = ("-", "--", ":")


def contact_wrench(columns: Mapping[str, FloatArray], largest: float) -> Drawing:
    """Draw the columns of an applied log: time, fx … mz, and the same as raw_fx ….

    columns : (N,) each; s, N, N·m, LCS. largest : contact force of the log, N.
    """

    def paint() -> Figure:
        time = columns["time"] - columns["time"][0]
        look: dict[str, Any] = {"linewidth": 0.9, "rasterized": style.raster(len(time))}
        fig, axes = panels(4.6, ("force, N", "torque, N·m"))
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
