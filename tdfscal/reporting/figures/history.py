"""Control chart of a rig: every angle over the dates of measurement, and what alarms saw."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

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
from tdfscal.records import ANGLES, BoolArray, FloatArray
from tdfscal.reporting.figures.ink import BLACK as INK
from tdfscal.reporting.figures.ink import BLUE, GREY, ORANGE, PALE, RED
from tdfscal.reporting.figures.style import Drawing, figure, signed
from tdfscal.significance import COVERAGE_FACTOR

Dates = npt.NDArray[np.object_]
_DAYS = 30.4375
#: A path that moves by less is said to rest, mrad.
_STILL = 1e-3
#: From this many checks on their whiskers would be a hedge: points alone.
_CROWDED = 60


def draw(life: Life) -> tuple[Drawing, ...]:
    """One figure per sensor that is known: three angles, and how surprising each check was."""
    return tuple(_of(life, int(i)) for i in np.flatnonzero(life.known))


def date_of(month: float) -> datetime:
    """Date of a time in months since 1970."""
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=month * _DAYS)


def _of(life: Life, i: int) -> Drawing:
    own = [alarm for alarm in life.alarms if alarm.sensor == i]
    name = life.supports[i]
    return Drawing(
        f"history-{i + 1}",
        f"{name} over time",
        " ".join(_said(life, alarm) for alarm in own) or _calm(life, i),
        lambda: _paint(life, i, own),
    )


def _calm(life: Life, i: int) -> str:
    change = 1e3 * float(np.abs(life.path[-1, i] - life.path[0, i]).max())
    if change < _STILL:
        return "No alarm; the path does not move between the first and the last check."
    return f"No alarm; between the first and the last check the path moves by {change:.2g} mrad."


def _said(life: Life, alarm: Alarm) -> str:
    size = 1e3 * float(np.linalg.norm(alarm.turn))
    when = f"{date_of(life.month[alarm.onset]):%Y-%m-%d}"
    if alarm.kind == "creep":
        return f"Creep of {size:.2g} mrad a month since about {when}."
    return f"Step of {size:.2g} mrad seen on {when}."


def _paint(life: Life, i: int, own: list[Alarm]) -> Figure:
    fig = figure(5.6)
    axes = fig.subplots(4, 1, sharex=True, gridspec_kw={"height_ratios": [3, 3, 3, 2]})
    dates = np.array([date_of(month) for month in life.month])
    shown = life.seen[:, i]
    for j, ax in enumerate(axes[:3]):
        _angle(ax, life, i, j, dates, shown)
        for alarm in own:
            _mark(ax, dates, alarm)
    _surprise(axes[3], life, i, dates)
    for alarm in own:
        _mark(axes[3], dates, alarm)
    keys = [
        Line2D([], [], marker="o", linestyle="", color=BLUE, markersize=4, label="check, k = 2"),
        Line2D([], [], color=INK, linewidth=1.2, label="smoothed path"),
        Patch(facecolor=PALE, edgecolor=GREY, linewidth=0.4, label="its band, k = 2"),
        Line2D([], [], color=GREY, linestyle="--", linewidth=0.9, label="mean ± limit"),
        Line2D([], [], color=RED, linewidth=1.2, label="step"),
        Line2D([], [], color=ORANGE, linewidth=1.2, linestyle="-.", label="creep"),
    ]
    fig.legend(handles=keys, loc="outside upper left", ncols=6, fontsize=7.5, columnspacing=1.2)
    return fig


def _angle(ax: Axes, life: Life, i: int, j: int, dates: Dates, shown: BoolArray) -> None:
    """Deviation of one angle from its first mean, mrad."""
    zero = life.mean[0, i, j]

    def mrad(angle: FloatArray) -> FloatArray:
        return 1e3 * so3.wrapped(angle - zero)

    path, band = mrad(life.path[:, i, j]), 1e3 * COVERAGE_FACTOR * life.path_std[:, i, j]
    mean, limit = mrad(life.mean[:, i, j]), 1e3 * life.limit[:, i, j]
    ax.fill_between(dates, path - band, path + band, color=PALE, edgecolor=GREY, linewidth=0.4)
    ax.plot(dates, path, color=INK, linewidth=1.2)
    for edge in (mean - limit, mean + limit):
        ax.plot(dates[shown], edge[shown], color=GREY, linestyle="--", linewidth=0.9)
    points = mrad(life.rpy[shown, i, j])
    if len(dates) > _CROWDED:
        ax.plot(dates[shown], points, "o", color=BLUE, markersize=2.2)
    else:
        half = 1e3 * COVERAGE_FACTOR * life.rpy_std[shown, i, j]
        ax.errorbar(
            dates[shown], points, yerr=half, fmt="o", color=BLUE, markersize=3.5,
            elinewidth=0.8, capsize=2,
        )  # fmt: skip
    ax.set_ylabel(f"{ANGLES[j]}, mrad")
    last = signed(1e3 * float(life.path[-1, i, j]), "+.3f")
    ax.set_title(
        f"now {last} ± {1e3 * COVERAGE_FACTOR * life.path_std[-1, i, j]:.3f} mrad",
        fontsize=7.5, loc="right", pad=2, color=GREY,
    )  # fmt: skip


def _surprise(ax: Axes, life: Life, i: int, dates: Dates) -> None:
    """How improbable the least probable test of a check is, against the level of the alarm."""
    p = np.clip(life.smallest[1:, i], 1e-12, 1.0)
    over = p <= life.level[1:]
    bars = -np.log10(p)
    width = 0.5 * float(np.median(np.diff(life.month))) * _DAYS if len(dates) > 2 else 10.0
    ax.bar(
        dates[1:], bars, width=max(width, 1.0), color=[RED if o else BLUE for o in over],
        hatch=None,
    )  # fmt: skip
    ax.plot(dates[1:], -np.log10(life.level[1:]), color=GREY, linestyle="--", linewidth=0.9)
    ax.set_ylabel("−log₁₀ p")
    ax.set_ylim(0, 12.5)
    locator = AutoDateLocator(minticks=3, maxticks=8)  # type: ignore[no-untyped-call]
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def _mark(ax: Axes, dates: Dates, alarm: Alarm) -> None:
    creeping = alarm.kind == "creep"
    ax.axvline(
        dates[alarm.onset],
        color=ORANGE if creeping else RED,
        linewidth=1.2,
        linestyle="-." if creeping else "-",
    )


__all__ = ["date_of", "draw"]
