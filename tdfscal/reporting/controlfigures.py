"""Figures of the control studies, in the style of Figs. 16, 17 and 18."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tdfscal.records import FloatArray
from tdfscal.reporting.figures.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    RED,
    Drawing,
    figure,
    logarithmic,
)
from tdfscal.simulation.control.runs import PHASES
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy

#: Colour, line and marker of each calibration: each tells them apart on its own.
_MARKS = (
    (INK, ":", "x"),
    (ORANGE, "--", "s"),
    (BLUE, "-", "o"),
    (GREEN, "-.", "^"),
    (RED, "-", "v"),
)
_FORCES = ("Fx, N", "Fy, N", "Fz, N", "Mx, N·m", "My, N·m", "Mz, N·m")
_FEWEST_POINTS = 1200


def free_space_drawings(study: FreeSpaceStudy) -> tuple[Drawing, ...]:
    """Fig. 16."""
    means = 1e3 * study.length.mean(axis=(1, 2))
    said = ", ".join(
        f"{name} {mm:.3g} mm and {mrad:.3g} mrad"
        for name, (mm, mrad) in zip(study.names, means, strict=True)
    )
    return (
        Drawing(
            "free-space",
            "Deviation of the final pose after each move in free space",
            f"Means: {said}.",
            partial(_paint_deviations, study),
        ),
    )


def _paint_deviations(study: FreeSpaceStudy) -> Figure:
    fig = figure(4.6)
    grid = fig.subplots(2, 3, sharex=True)
    names = ("x", "y", "z", "about x", "about y", "about z")
    rms = 1e3 * np.sqrt(np.mean(study.deviation**2, axis=2))  # (C, M, 6)
    move = np.arange(1.0, rms.shape[1] + 1.0)
    for axis, ax in enumerate(grid.flat):
        _marked(ax, move, rms[:, :, axis], study.names)
        logarithmic(ax)
        ax.set_title(names[axis])
        ax.set_xticks(move)
        if axis % 3 == 0:
            ax.set_ylabel("rms over runs, " + ("mm" if axis < 3 else "mrad"))
        if axis >= 3:
            ax.set_xlabel("move")
    _legend(fig, grid.flat[0])
    return fig


def _marked(ax: Axes, x: FloatArray, values: FloatArray, names: tuple[str, ...]) -> None:
    """One line with markers per calibration, values (C, X)."""
    for c, name in enumerate(names):
        colour, line, marker = _MARKS[c % len(_MARKS)]
        ax.plot(x, values[c], color=colour, linestyle=line, marker=marker, markersize=4, label=name)


def _legend(fig: Figure, ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper left", ncols=len(labels))


def docking_drawings(study: DockingStudy) -> tuple[Drawing, ...]:
    """Fig. 17, of the first run of the last real calibration, and Fig. 18."""
    last = max(c for c, name in enumerate(study.names) if name != "perfect")
    force, torque = (study.average[..., q] for q in (0, 1))
    said = ", ".join(
        f"{name} {force[c, study.touched[c]].mean():.3g} N and "
        f"{torque[c, study.touched[c]].mean():.3g} N·m"
        for c, name in enumerate(study.names)
        if study.touched[c].any()
    )
    return (
        Drawing(
            "docking",
            f"Contact force and torque of one docking, calibration {study.names[last]}",
            f"Run 1 ended {study.outcome(last, 0)}.",
            partial(_paint_docking, study, last, 0),
        ),
        Drawing(
            "maxima",
            "Largest contact force and torque of each docking",
            f"Means over directions and runs that made contact: {said}.",
            partial(_paint_maxima, study),
        ),
    )


def _paint_docking(study: DockingStudy, c: int, run: int) -> Figure:
    lane = c * study.arms.runs + run
    traces, starts = study.result.traces, study.result.phase_start[:, lane]
    stop = study.result.stopped[lane]
    last = len(traces.time) if np.isnan(stop) else int(np.searchsorted(traces.time, stop)) + 1
    every = max(1, last // _FEWEST_POINTS)
    time = traces.time[:last:every]
    fig = figure(5.2)
    grid = fig.subplots(2, 3, sharex=True)
    for axis, ax in enumerate(grid.flat):
        seen, true = (
            traces.measured[:last:every, lane, axis],
            traces.contact[:last:every, lane, axis],
        )
        ax.plot(time, seen, color=ORANGE, linewidth=0.7, label="as the controller sees it")
        ax.plot(time, true, color=INK, linewidth=1.0, label="true")
        for phase, start in zip(PHASES[1:], starts[1:], strict=True):
            if np.isfinite(start):
                line = {"first contact": "--", "insertion": ":", "seated": "-."}[phase]
                ax.axvline(start, color=BLUE, linewidth=0.9, linestyle=line, label=phase)
        ax.set_title(_FORCES[axis])
        if axis >= 3:
            ax.set_xlabel("time, s")
    _legend(fig, grid.flat[0])
    return fig


def _paint_maxima(study: DockingStudy) -> Figure:
    fig = figure(4.8)
    grid = fig.subplots(2, 3, sharex=True)
    run = np.arange(1.0, study.arms.runs + 1.0)
    for axis, ax in enumerate(grid.flat):
        values = np.where(study.touched, study.peak[..., axis], np.nan)
        _marked(ax, run, values, study.names)
        ax.set_ylim(bottom=0.0)
        ax.set_title(_FORCES[axis])
        if len(run) <= 12:
            ax.set_xticks(run)
        if axis >= 3:
            ax.set_xlabel("run")
    _legend(fig, grid.flat[0])
    return fig
