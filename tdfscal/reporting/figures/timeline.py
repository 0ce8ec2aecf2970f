"""Over time: dwells and forces of a log, contact wrenches, thresholds; the chart of a rig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdfscal.catalogue.numbers import rounded, typeset, with_std
from tdfscal.comparison.control_chart import Alarm
from tdfscal.comparison.history import Life
from tdfscal.detection.capability import Capability
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.evidence import DwellTable, PostureTable
from tdfscal.files.calibration.parts import RejectedPosture
from tdfscal.files.rig.model import RigFile
from tdfscal.frozen import record
from tdfscal.motioncal.blocks import Stretch
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics import so3
from tdfscal.numerics.streams import covered
from tdfscal.records import ANGLES, FloatArray
from tdfscal.reporting.figures import Clock, clock_from, date_of, log_clock, style
from tdfscal.reporting.figures.style import Drawing, legend_above, legend_outside, panels
from tdfscal.significance import COVERAGE_FACTOR

#: Labels of panels: of each axis of the sensors, and of the contact wrench.
_FORCES, _WRENCH = ("Fx, N", "Fy, N", "Fz, N"), ("force, N", "torque, N·m")
#: Height of a panel of forces, inches.
_PANEL = 0.72
_MARKERS = "osD^vPX*"
_LINES = ("-", "--", ":")
#: Instants of a line at most; more are not to be told apart.
_INSTANTS = 1500
#: Begin and end of what was left out, s of the axis.
Gone = Sequence[tuple[float, float]]


@record
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
    rejected = log.rejected
    total = len(table.index) + len(rejected)
    averaged = float(np.sum(np.array(table.end) - np.array(table.start)))
    said = f"{len(table.index)} of {total} dwells are in the fit"
    if log.clock.unit == "s":
        said += f", {averaged:.0f} s of force readings in all"
    said += f"; {len(rejected)} had to be rejected." if rejected else "; none had to be rejected."
    return Drawing("timeline", "The log and its dwells", said, lambda: _paint(log))


def _paint(log: DwellLog) -> Figure:
    time, table, dwells = log.clock, log.postures, log.dwells
    shortest = 0.9 if time.unit == "row" else 0.0

    def ends(start: float, end: float) -> tuple[float, float]:
        begin = start - time.origin
        return begin, begin + max(end - start, shortest)

    used = [ends(*pair) for pair in zip(table.start, table.end, strict=True)]
    gone = [ends(r.start, r.end) for r in log.rejected]
    pieces = [ends(s.start, s.end) for s in table.left_out]
    heights = [0.34 * (3 if pieces else 2)] + ([_PANEL] * 3 if dwells is not None else [])
    labels = ("", *_FORCES)[: len(heights)]
    fig, axes = panels(0.75 + sum(heights), labels, gridspec_kw={"height_ratios": heights})
    _lanes(axes[0], used, gone, pieces)
    for r, (_, end) in zip(log.rejected, gone, strict=True):
        style.beside(axes[0], f"{r.index + 1}", end, 1, 2, fontweight="bold")
    if dwells is not None:
        middle = np.mean([ends(*pair) for pair in zip(dwells.start, dwells.end, strict=True)], 1)
        measured = [[axis in support.axes for axis in "xyz"] for support in log.rig.supports]
        force = np.where(measured, dwells.force, np.nan)
        names = [support.name for support in log.rig.supports]
        look: dict[str, Any] = {"linewidth": 0.7, "markersize": 3.2, "markeredgewidth": 0.3}
        look |= {"markeredgecolor": style.BLACK, "rasterized": style.raster(3 * len(middle))}
        _forces(axes[1:], names, middle, force, gone, _MARKERS, **look)
        legend_outside(fig, *axes[1:])
    axes[-1].set_xlabel(time.label)
    return fig


def _lanes(ax: Axes, used: Gone, gone: Gone, pieces: Gone) -> None:
    """Dwells in the fit, rejected ones, stretches that are no dwells."""
    pixels = style.raster(len(used))
    plain: dict[str, Any] = {"facecolor": style.FILLS[0], "edgecolor": style.BLACK}
    plain |= {"linewidth": 0.0 if pixels else 0.5, "rasterized": pixels}
    dotted = {"facecolor": style.PALE, "edgecolor": style.GREY, "hatch": "...", "linewidth": 0.4}
    lanes = [("in the fit", used, plain), ("rejected", gone, {"linewidth": 0.9, **style.REJECTED})]
    lanes += [("no dwell", pieces, dotted)] if pieces else []
    for lane, (_, spans, look) in enumerate(lanes):
        ax.broken_barh([(a, b - a) for a, b in spans], (lane - 0.36, 0.72), **look)
    if not gone:
        ax.text(0.01, 1, "none", transform=ax.get_yaxis_transform(), va="center", color=style.GREY)
    ax.set_ylim(len(lanes) - 0.45, -0.5)
    ax.set_yticks(range(len(lanes)), [name for name, *_ in lanes])
    ax.grid(axis="y", visible=False)


def _forces(
    axes: Iterable[Axes],
    supports: Sequence[str],
    time: FloatArray,
    force: FloatArray,
    gone: Gone,
    markers: str,
    **line: Any,
) -> None:
    """Readings (N, n, 3), a panel per axis of the sensors; what was left out is shaded."""
    for k, ax in enumerate(axes):
        for begin, end in gone:
            ax.axvspan(begin, end, linewidth=0.4, **style.REJECTED)
        for i, name in enumerate(supports):
            y = force[:, i, k]
            if np.isfinite(y).any():
                ax.plot(
                    time, y, color=style.LINES[i % len(style.LINES)], label=name,
                    marker=markers[i % len(markers)], **line,
                )  # fmt: skip


def moving(slow: Slow, rejected: Sequence[Stretch]) -> Drawing:
    """Forces of a log in motion: a panel per axis of the sensors, a line per sensor."""

    def paint() -> Figure:
        time = clock_from(float(slow.time[0]))
        fig, axes = panels(3.4, _FORCES)
        every = max(1, len(slow.time) // _INSTANTS)
        x, force = slow.time[::every] - time.origin, slow.force[::every]
        gone = [(s.begin - time.origin, s.end - time.origin) for s in rejected]
        _forces(axes, slow.supports, x, force, gone, " ", linewidth=1.1)
        axes[-1].set_xlabel(time.label)
        legend_outside(fig, *axes)
        return fig

    said = f"{slow.time[-1] - slow.time[0]:.0f} s of the log are in motion"
    lost = covered(rejected)
    said += f"; {lost:.0f} s in {len(rejected)} stretches (hatched) were left out." if lost else "."
    return Drawing("forces", "The log and its forces", said, paint)


def contact_wrench(columns: Mapping[str, FloatArray], largest: float) -> Drawing:
    """Draw the columns of an applied log: time, fx … mz, and the same as raw_fx ….

    columns : (N,) each; s, N, N·m, LCS. largest : contact force of the log, N.
    """

    def paint() -> Figure:
        time = columns["time"] - columns["time"][0]
        pixels = style.raster(len(time))
        fig, axes = panels(4.6, _WRENCH)
        for ax, letter in zip(axes, "fm", strict=True):
            names = [letter + axis for axis in "xyz"]
            for name in names:
                raw = columns[f"raw_{name}"]
                ax.plot(time, raw, color=style.PALE, linewidth=0.6, rasterized=pixels)
            for name, (_, _, colour), line in zip(names, style.AXES, _LINES, strict=True):
                look: dict[str, Any] = {"color": colour, "linewidth": 0.9, "rasterized": pixels}
                ax.plot(time, columns[name], line, label=name, **look)
            ax.axhline(0.0, color=style.GREY, linewidth=0.6)
            legend_above(ax, 3)
        axes[1].set_xlabel("time since the first sample, s; pale: uncalibrated")
        return fig

    said = f"The largest contact force of the log is {rounded(largest, 3)} N."
    return Drawing("contact-wrench", "Contact wrench over the log", said, paint)


def detection(found: Capability, *, timed: bool) -> Drawing:
    """Draw a panel of forces and one of torques."""

    def paint() -> Figure:
        time = found.time - found.time[0]
        fig, axes = panels(5.0, _WRENCH)
        for ax, letter, first in zip(axes, "fm", (0, 3), strict=True):
            for k, ((axis, _, colour), line) in enumerate(zip(style.AXES, _LINES, strict=True)):
                c = first + k
                look: dict[str, Any] = {"color": colour, "linewidth": 1.0, "linestyle": line}
                ax.plot(time, found.seen_from[:, c], label=f"{letter}{axis}", **look)
                ax.axhline(found.threshold[c], color=colour, linewidth=0.7, linestyle=line)
                fake = COVERAGE_FACTOR * found.calibration_std[:, c]
                ax.fill_between(time, 0.0, fake, color=colour, alpha=0.15, linewidth=0)
            ax.set_ylim(bottom=0.0)
            legend_above(ax, 3)
        axes[1].set_xlabel("time since the first sample, s" if timed else "posture")
        return fig

    return Drawing(
        "capability",
        "Smallest contact along the path",
        "Thick: the smallest contact seen; thin: its threshold; shaded: what calibration, zeros "
        "and postures may fake (k = 2).",
        paint,
    )


Dates = npt.NDArray[np.object_]
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


def control_charts(life: Life) -> tuple[Drawing, ...]:
    """One figure per sensor that is known: its three angles.

    Those with alarms come first, the least probable first of all; an alarm of all sensors together
    stands in every one.
    """
    weight = {alarm.sensor: alarm.p_value for alarm in sorted(life.alarms, key=_improbability)}
    known = map(int, np.flatnonzero(life.known))
    return tuple(_control_chart(life, i) for i in sorted(known, key=lambda i: weight.get(i, 2.0)))


def _improbability(alarm: Alarm) -> float:
    return -alarm.p_value


def _control_chart(life: Life, i: int) -> Drawing:
    own = [alarm for alarm in life.alarms if alarm.sensor in (i, None)]
    moved = 1e3 * float(np.abs(life.path[-1, i] - life.path[0, i]).max())
    way = f"moves by {rounded(moved)} mrad" if moved >= _STILL else "does not move"
    calm = f"No alarm; between the first and the last check the path {way}."
    said = " ".join(_alarm_said(life, alarm) for alarm in own) or calm
    title = f"{life.supports[i]} over time"
    return Drawing(f"history-{i + 1}", title, said, lambda: _paint_chart(life, i, own))


def _alarm_said(life: Life, alarm: Alarm) -> str:
    size = 1e3 * float(np.linalg.norm(alarm.turn))
    when = f"{date_of(life.month[alarm.onset]):%Y-%m-%d}"
    if alarm.sensor is None:
        what = "The load has changed" if alarm.kind == "load" else "All sensors together depart"
        return f"{what} on {when}."
    if alarm.kind == "creep":
        return f"Creep of {rounded(size)} mrad a month since about {when}."
    return f"Step of {rounded(size)} mrad seen on {when}."


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
    now = typeset(f"now {with_std(1e3 * float(life.path[-1, i, j]), band[-1], '+')} mrad")
    ax.set_title(now, fontsize=7.5, loc="right", pad=2, color=style.GREY)
