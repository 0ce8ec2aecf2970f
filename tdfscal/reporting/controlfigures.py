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
    GREY,
    INK,
    ORANGE,
    RED,
    Drawing,
    figure,
    logarithmic,
)
from tdfscal.simulation.control.runs import PHASES
from tdfscal.studies.compared_calibrations import BEST
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy

#: Colour, line and marker of each calibration: each tells them apart on its own.
_MARKS = (
    (INK, ":", "x"),
    (ORANGE, "--", "s"),
    (RED, "-.", "D"),
    (BLUE, "-", "o"),
    (GREEN, "-.", "^"),
    (ORANGE, ":", "P"),
    (GREY, "--", "v"),
    (GREY, "-", "*"),
)
_FORCES = ("Fx, N", "Fy, N", "Fz, N", "Mx, N·m", "My, N·m", "Mz, N·m")
#: The scale is linear up to here, N and N·m, and logarithmic beyond: the paper's range is 12 N.
_LINEAR = (12.0, 6.0)
_TICKS = ((0, 3, 6, 9, 12, 20, 40, 100), (0, 2, 4, 6, 10, 20, 50))
#: Fewer where both signs are shown.
_SIGNED = ((0, 6, 12, 40), (0, 2, 4, 6, 20))


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
            "Deviation of the final pose after each move in free space, rms over runs",
            f"Mean lengths: {said}.",
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
    fig.legend(handles, labels, loc="outside upper left", ncols=min(4, len(labels)))


def _scale(ax: Axes, axis: int, top: float, *, both: bool = False) -> None:
    """Linear up to the paper's range, logarithmic beyond, at least that range; axis : 0 to 5."""
    linear, ticks = _LINEAR[axis // 3], (_SIGNED if both else _TICKS)[axis // 3]
    ax.set_yscale("symlog", linthresh=linear, linscale=2.0)
    top = 1.1 * max(top, linear)
    shown = [t for t in ticks if t <= top]
    if both:
        shown = sorted({-t for t in shown} | set(shown))
    ax.set_yticks(shown, [f"{t:g}".replace("-", "−") for t in shown])
    ax.minorticks_off()
    ax.set_ylim(-top if both else 0.0, top)


def docking_drawings(study: DockingStudy) -> tuple[Drawing, ...]:
    """Fig. 17, of the median run of the paper's self-calibration and of ours, and Fig. 18."""
    shown: list[str] = [name for name in ("linear", "self-all") if name in study.names]
    shown = shown or [[name for name in study.names if name not in BEST][-1]]
    force = study.average[..., 0]
    said = ", ".join(
        f"{name} {force[c, study.touched[c]].mean():.3g} N ({study.touched[c].sum()})"
        for c, name in enumerate(study.names)
        if study.touched[c].any()
    )
    runs = [_median(study, study.names.index(name)) for name in shown]
    each = [
        Drawing(
            "docking" if k == len(shown) - 1 else f"docking-{name}",
            f"Contact force and torque of one docking: calibration {name}, run {run + 1} of "
            f"{study.arms.runs}",
            _told(study, study.names.index(name), run),
            partial(_paint_docking, study, study.names.index(name), run),
        )
        for k, (name, run) in enumerate(zip(shown, runs, strict=True))
    ]
    maxima = Drawing(
        "maxima",
        "Largest contact force and torque of each docking",
        f"Mean over directions and runs that made contact (their number): {said}.",
        partial(_paint_maxima, study),
    )
    return (*each, maxima)


def _median(study: DockingStudy, c: int) -> int:
    """The run of middle force among those that made contact."""
    runs = np.flatnonzero(study.touched[c])
    if not runs.size:
        return 0
    return int(runs[np.argsort(study.average[c, runs, 0], kind="stable")[runs.size // 2]])


def _told(study: DockingStudy, c: int, run: int) -> str:
    """What happens in a run."""
    starts = study.grid(np.moveaxis(study.result.phase_start, 0, -1))[c, run]
    text = f"The run of middle force among {study.arms.runs} ended {study.outcome(c, run)}"
    if np.isfinite(starts[1]):
        peak = study.peak[c, run]
        along = "xyz"[int(peak[:3].argmax())]
        text += f"; first contact at {starts[1]:.1f} s, largest true force {peak[:3].max():.3g} N "
        text += f"along {along}"
    if np.isfinite(starts[3]):
        text += f", seat at {starts[3]:.0f} s"
    return f"{text}."


def _paint_docking(study: DockingStudy, c: int, run: int) -> Figure:
    lane = c * study.arms.runs + run
    traces, starts = study.result.traces, study.result.phase_start[:, lane]
    stop = study.result.stopped[lane]
    last = len(traces.time) if np.isnan(stop) else int(np.searchsorted(traces.time, stop)) + 1
    time = traces.time[:last]
    fig = figure(5.4)
    grid = fig.subplots(2, 3, sharex=True)
    for axis, ax in enumerate(grid.flat):
        seen, true = traces.measured[:last, lane, axis], traces.contact[:last, lane, axis]
        ax.plot(time, seen, color=ORANGE, linewidth=0.7, label="as the controller sees it")
        ax.plot(time, true, color=INK, linewidth=1.0, label="true")
        for phase, start in zip(PHASES[1:], starts[1:], strict=True):
            if np.isfinite(start):
                line = {"first contact": "--", "insertion": ":", "seated": "-."}[phase]
                label = f"{phase}, {start:.1f} s"
                ax.axvline(start, color=BLUE, linewidth=0.9, linestyle=line, label=label)
        largest = study.peak[c, run, axis]
        ax.set_title(f"{_FORCES[axis]}; largest true {largest:.3g}")
        limit = study.setup.controller.thresholds[axis] if axis < 3 else 0.0
        _scale(ax, axis, float(max(np.abs(seen).max(), np.abs(true).max(), limit)), both=True)
        if axis < 3:
            ax.axhline(limit, color=RED, linewidth=0.7)
            ax.axhline(-limit, color=RED, linewidth=0.7, label="limit" if axis == 0 else None)
        if axis >= 3:
            ax.set_xlabel("time, s")
    _legend(fig, grid.flat[0])
    return fig


def _paint_maxima(study: DockingStudy) -> Figure:
    """Every run a dot, the mean a bar with its standard error."""
    fig = figure(5.6)
    grid = fig.subplots(2, 3, sharex=True)
    spread = np.linspace(-0.25, 0.25, study.arms.runs) if study.arms.runs > 1 else np.zeros(1)
    for axis, ax in enumerate(grid.flat):
        top = 0.0
        for c in range(len(study.names)):
            colour, _, marker = _MARKS[c % len(_MARKS)]
            met = study.touched[c]
            values = study.peak[c, met, axis]
            if not values.size:
                ax.text(c, 0.3, "no contact", rotation=90, fontsize=6.5, ha="center", va="bottom")
                continue
            top = max(top, float(values.max()))
            ax.plot(c + spread[met], values, marker, color=colour, markersize=2.5, alpha=0.6)
            error = np.std(values, ddof=1) / np.sqrt(values.size) if values.size > 1 else 0.0
            ax.errorbar(c, values.mean(), error, color=INK, marker="_", markersize=14, capsize=3)
        if axis < 3:
            ax.axhline(study.setup.controller.thresholds[axis], color=RED, linewidth=0.8)
        _scale(ax, axis, top)
        ax.set_xlim(-0.6, len(study.names) - 0.4)
        ax.set_title(_FORCES[axis] + ("" if axis > 2 else ", limit in red"))
        ax.set_xticks(range(len(study.names)), study.names, rotation=60, ha="right", fontsize=7)
    return fig
