"""Angles over time: the control chart of a rig with its alarms."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.comparison.control_chart import Alarm
from tdfscal.comparison.history import Life
from tdfscal.numerics import so3
from tdfscal.records import ANGLES
from tdfscal.reporting.figures import style
from tdfscal.reporting.figures.style import Drawing, panels, signed
from tdfscal.significance import COVERAGE_FACTOR

Dates = npt.NDArray[np.object_]
_DAYS = 30.4375
_BAND: dict[str, Any] = {"facecolor": style.PALE, "edgecolor": style.GREY, "linewidth": 0.4}
#: Of a step, and of a creep.
_ALARMS: tuple[dict[str, Any], ...] = (
    {"color": style.RED},
    {"color": style.ORANGE, "linestyle": "-."},
)
#: A path that moves by less is said to rest, mrad.
_STILL = 1e-3
#: From this many checks on their whiskers would be a hedge: points alone.
_CROWDED = 60


def draw(life: Life) -> tuple[Drawing, ...]:
    """One figure per sensor that is known: its three angles.

    Those with alarms come first, the least probable first of all; an alarm of all sensors together
    stands in every one.
    """
    weight = {alarm.sensor: alarm.p_value for alarm in sorted(life.alarms, key=_improbability)}
    known = map(int, np.flatnonzero(life.known))
    return tuple(_of(life, i) for i in sorted(known, key=lambda i: weight.get(i, 2.0)))


def _improbability(alarm: Alarm) -> float:
    return -alarm.p_value


def date_of(month: float) -> datetime:
    """Date of a time in months since 1970."""
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=month * _DAYS)


def _of(life: Life, i: int) -> Drawing:
    own = [alarm for alarm in life.alarms if alarm.sensor in (i, None)]
    moved = 1e3 * float(np.abs(life.path[-1, i] - life.path[0, i]).max())
    way = f"moves by {moved:.2g} mrad" if moved >= _STILL else "does not move"
    calm = f"No alarm; between the first and the last check the path {way}."
    said = " ".join(_said(life, alarm) for alarm in own) or calm
    title = f"{life.supports[i]} over time"
    return Drawing(f"history-{i + 1}", title, said, lambda: _paint(life, i, own))


def _said(life: Life, alarm: Alarm) -> str:
    size = 1e3 * float(np.linalg.norm(alarm.turn))
    when = f"{date_of(life.month[alarm.onset]):%Y-%m-%d}"
    if alarm.sensor is None:
        what = "The load has changed" if alarm.kind == "load" else "All sensors together depart"
        return f"{what} on {when}."
    if alarm.kind == "creep":
        return f"Creep of {size:.2g} mrad a month since about {when}."
    return f"Step of {size:.2g} mrad seen on {when}."


def _paint(life: Life, i: int, own: list[Alarm]) -> Figure:
    fig, axes = panels(4.6, [f"{angle}, mrad" for angle in ANGLES], sharey=True)
    dates = np.array([date_of(month) for month in life.month])
    for j, ax in enumerate(axes):
        _angle(ax, life, i, j, dates)
        for alarm in own:
            ax.axvline(dates[alarm.onset], linewidth=1.2, **_ALARMS[alarm.kind == "creep"])
    locator = AutoDateLocator(minticks=3, maxticks=8)  # type: ignore[no-untyped-call]
    axes[-1].xaxis.set_major_locator(locator)
    axes[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    keys = [
        Line2D(
            [], [], marker="o", linestyle="", color=style.BLUE, markersize=4, label="check, k = 2"
        ),
        Line2D([], [], color=style.BLACK, linewidth=1.2, label="smoothed path"),
        Patch(**_BAND, label="its band, k = 2"),
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
    band, half = (1e3 * COVERAGE_FACTOR * std[:, i, j] for std in (life.path_std, life.rpy_std))
    limit = 1e3 * life.limit[:, i, j]
    ax.fill_between(dates, path - band, path + band, **_BAND)
    ax.plot(dates, path, color=style.BLACK, linewidth=1.2)
    for edge in (mean - limit, mean + limit):
        ax.plot(dates[shown], edge[shown], color=style.GREY, linestyle="--", linewidth=0.9)
    if len(dates) > _CROWDED:
        ax.plot(dates[shown], points[shown], "o", color=style.BLUE, markersize=2.2)
    else:
        ax.errorbar(
            dates[shown], points[shown], yerr=half[shown], fmt="o", color=style.BLUE,
            markersize=3.5, elinewidth=0.8, capsize=2,
        )  # fmt: skip
    now = f"now {signed(1e3 * float(life.path[-1, i, j]), '+.3f')} ± {band[-1]:.3f} mrad"
    ax.set_title(now, fontsize=7.5, loc="right", pad=2, color=style.GREY)
