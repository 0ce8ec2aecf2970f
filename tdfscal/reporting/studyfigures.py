"""Figures of the studies: Fig. 4, Figs. 7–9 and 12–14, and Table 2 at a glance."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.records import ANGLES
from tdfscal.reporting.figures.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    Drawing,
    figure,
    legend_above,
    logarithmic,
    signed,
)
from tdfscal.reporting.studies import SHORT, forces_name, posture_name
from tdfscal.studies.accuracy import Accuracy, MethodResult, angle_names
from tdfscal.studies.sensitivity import Sweep

#: Colour, line and marker of roll, pitch and yaw: each tells them apart on its own.
_LINES = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, ":", "^"))
_MARKS = {"ml": (BLUE, "o"), "linear": (ORANGE, "s"), "tracker": (GREEN, "^")}
_PER_ROW = 4


def sensitivity_drawing(supports: tuple[str, ...], sweep: Sweep, name: str) -> Drawing:
    """Fig. 4: force and torque error against each angle of each sensor."""
    i, j, _ = np.unravel_index(int(sweep.force.argmax()), sweep.force.shape)
    return Drawing(
        name,
        f"What a wrong angle costs, {posture_name(sweep.rpy)}, {forces_name(sweep.internal)}",
        f"{ANGLES[j]} of {supports[i]} costs most, {sweep.force.max():.3g} N at "
        f"{sweep.deviation[-1]:g} rad.",
        partial(_paint_sweep, supports, sweep),
    )


def _paint_sweep(supports: tuple[str, ...], sweep: Sweep) -> Figure:
    n = len(supports)
    columns = min(n, _PER_ROW)
    bands = -(-n // columns)
    fig = figure(0.5 + 3.9 * bands)
    grid = fig.subplots(2 * bands, columns, sharex=True, squeeze=False)
    for i in range(bands * columns):
        band, column = divmod(i, columns)
        if i >= n:
            grid[2 * band, column].set_axis_off()
            grid[2 * band + 1, column].set_axis_off()
            continue
        for q, (values, label) in enumerate(
            ((sweep.force, "force error, N"), (sweep.torque, "torque error, N·m"))
        ):
            ax = grid[2 * band + q, column]
            for j, (colour, line, marker) in enumerate(_LINES):
                ax.plot(
                    1e3 * sweep.deviation,
                    values[i, j],
                    color=colour,
                    linestyle=line,
                    marker=marker,
                    markersize=3.5,
                    markevery=(3 * j, 12),  # curves that coincide still show their markers
                    label=ANGLES[j],
                )
            top = max(float(values.max()), 1e-9)
            ax.set_ylim(-0.03 * top, 1.05 * top)
            ax.set_xlabel("angle off, mrad")
            ax.tick_params(labelbottom=True)
            if column == 0:
                ax.set_ylabel(label)
            if q == 0:
                ax.set_title(supports[i])
    handles, labels = grid[0, 0].get_legend_handles_labels()
    fig.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=3,
        title=f"terminal {posture_name(sweep.rpy)}; {forces_name(sweep.internal)}",
        alignment="left",
    )
    return fig


def accuracy_drawings(study: Accuracy) -> tuple[Drawing, ...]:
    """One figure of histograms per sensor, and all standard deviations together."""
    each = tuple(
        Drawing(
            f"errors-{i + 1}-{_plain(name)}",
            f"Errors of the installation angles of {name}",
            f"{study.setup.runs} simulated campaigns per method.",
            partial(_paint_errors, study, i),
        )
        for i, name in enumerate(study.setup.rig.supports)
    )
    overview = Drawing(
        "accuracy",
        "Accuracy of each method",
        f"{study.verdict}.",
        partial(_paint_overview, study),
    )
    return (*each, overview)


def _plain(name: str) -> str:
    """Return a support's name as part of a file's name."""
    return "".join(c if c.isalnum() else "_" for c in name)


def _paint_errors(study: Accuracy, i: int) -> Figure:
    rows = len(study.results)
    fig = figure(0.5 + 1.9 * rows)
    grid = fig.subplots(rows, 3, squeeze=False)
    name = study.setup.rig.supports[i]
    for row, result in enumerate(study.results):
        for j in range(3):
            ax = grid[row, j]
            _histogram(ax, result, i, j)
            ax.set_title(f"{name}  {ANGLES[j]}: {SHORT[result.method]}", fontsize=8, pad=3)
            ax.set_xlabel("error, mrad", fontsize=7.5)
        grid[row, 0].set_ylabel("campaigns")
    return fig


def _histogram(ax: Axes, result: MethodResult, i: int, j: int) -> None:
    """Histogram of an angle's errors with the normal curve of their mean and deviation."""
    counts, edges = result.histogram(i, j)
    mean, std = 1e3 * float(result.mean[i, j]), 1e3 * float(result.std[i, j])
    edges = 1e3 * edges
    ax.stairs(counts, edges, fill=True, color="#c6d6ea")
    ax.stairs(counts, edges, color=INK, linewidth=0.5)
    x = np.linspace(mean - 4 * std, mean + 4 * std, 121)
    height = counts.sum() * (edges[1] - edges[0]) / (std * np.sqrt(2 * np.pi))
    ax.plot(x, height * np.exp(-(((x - mean) / std) ** 2) / 2), color=ORANGE, linewidth=1.2)
    ax.axvline(0.0, color=INK, linewidth=0.8, linestyle="--")
    ax.set_ylim(0.0, 1.45 * max(float(counts.max()), height))
    ax.text(
        0.03,
        0.96,
        f"mean {signed(mean, '+.2g')}\nσ {std:.3g}",
        transform=ax.transAxes,
        va="top",
        fontsize=7,
    )
    ax.grid(visible=False)
    ax.tick_params(labelsize=7)


def _paint_overview(study: Accuracy) -> Figure:
    names = angle_names(study.setup.rig)
    fig = figure(3.2)
    ax = fig.subplots()
    place = np.arange(len(names)) + 0.6 * np.repeat(np.arange(study.setup.rig.n), 3)
    for k, result in enumerate(study.results):
        here = place + 0.22 * (k - (len(study.results) - 1) / 2)  # side by side
        colour, marker = _MARKS[result.method]
        ax.plot(
            here,
            1e3 * result.std.ravel(),
            linestyle="none",
            marker=marker,
            color=colour,
            markersize=6,
            label=f"{SHORT[result.method]}, standard deviation",
        )
        ax.plot(
            here,
            1e3 * np.abs(result.mean).ravel(),
            linestyle="none",
            marker=marker,
            color=colour,
            markersize=4,
            fillstyle="none",
            label=f"{SHORT[result.method]}, |mean|",
        )
    logarithmic(ax)
    ax.set_ylabel("error of the angle, mrad")
    labels = [f"{name}  {angle}" for _, _, name, angle in names]
    ax.set_xticks(place, labels, rotation=45, ha="right", fontsize=7.5)
    legend_above(ax, len(study.results))
    return fig
