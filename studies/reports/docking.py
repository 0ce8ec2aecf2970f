"""Docking of the gears, beside the paper's figures (Figs. 17 and 18)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.control.runs import PHASES
from studies.reports import controlled as shared
from studies.reports.cells import Row, mean_of, number, share_said
from studies.reports.paper import SEEN, TRUE, docking_items
from studies.runs.compared_calibrations import BEST
from studies.runs.docking import QUANTITIES, DockingStudy
from tdfscal.reporting.figures import ink
from tdfscal.reporting.figures.style import Drawing, figure, legend_outside
from tdfscal.reporting.layout import Block, Report, Section, Table
from tdfscal.wrench.contact_wrench import COMPONENTS

_NOTE = (
    "True maxima are those that the gears exert from first contact to the seat, over runs that "
    "made contact, whose number is given where it is not all of them. Seen are those of the "
    "controller's own wrench from the start: that is what the paper's control software records, so "
    "its numbers stand there, and beside its own method (Eq. 24) only. A run succeeds where it "
    "seats and no true force before was beyond its limit. The newtons go with contact stiffness "
    "and speed: `study success` sweeps the former. docs/control.md has the model and its "
    "parameters."
)
_FORCES = ("Fx, N", "Fy, N", "Fz, N", "Mx, N·m", "My, N·m", "Mz, N·m")
#: The scale is linear up to here, N and N·m, and logarithmic beyond: the paper's range is 12 N.
_LINEAR = (12.0, 6.0)
_TICKS = ((0, 3, 6, 9, 12, 20, 40, 100), (0, 2, 4, 6, 10, 20, 50))
#: Fewer where both signs are shown.
_SIGNED = ((0, 6, 12, 40), (0, 2, 4, 6, 20))


def report(study: DockingStudy) -> Report:
    """Lay out the maxima, outcomes, ratios, what of the paper they reproduce, and why."""
    setup = study.setup
    limits = ", ".join(f"{v:g}" for v in setup.controller.thresholds)
    maxima = "Maxima, {}, mean of x, y and z: mean over runs ± standard error"
    ratios = "Ratios of the means ± standard error, {}, runs in which both made contact"
    blocks: tuple[Block, ...] = (
        shared.means_table(maxima.format("true"), study, TRUE),
        shared.means_table(maxima.format("seen"), study, SEEN),
        Table(
            f"Outcome: runs, and success without a force above its limit ({limits} N) in % with "
            "its 95 % interval",
            ("", "seated", "jammed", "false contact", "not finished", "success, %"),
            tuple(
                (arm.name, *map(str, _outcomes(study, c)), share_said(study.success(c)))
                for c, arm in enumerate(study.arms.arms)
            ),
        ),
        shared.ratio_table(ratios.format("true"), study, TRUE),
        shared.ratio_table(ratios.format("seen"), study, SEEN),
        shared.knows(study.arms),
        *shared.against_paper(study.arms, docking_items(study)),
        _NOTE,
    )
    return Report(
        title=f"Docking: {setup.rig.name}",
        subtitle=f"{1e3 * setup.speed:g} mm/s over {1e3 * setup.gap:g} mm of free space and "
        f"{1e3 * setup.gears.length:.3g} mm of engagement, contact "
        f"{1e-6 * setup.gears.stiffness:.2g} N/µm, {study.arms.runs} runs; "
        f"{shared.machine(study)}; {study.arms.origin}",
        sections=(Section("Docking", blocks),),
    )


def _outcomes(study: DockingStudy, c: int) -> tuple[int, int, int, int]:
    """Runs of a calibration that were seated, jammed, stopped at a false contact, or none."""
    seated, jammed, touched = study.seated[c], study.jammed[c], study.touched[c]
    return (
        int(seated.sum()),
        int((jammed & touched).sum()),
        int((jammed & ~touched).sum()),
        int((~seated & ~jammed).sum()),
    )


def document(study: DockingStudy) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    calibrations = shared.arm_documents(study, SEEN, QUANTITIES)
    for c, entry in enumerate(calibrations):
        entry |= zip(("seated", "jammed", "false_contact"), _outcomes(study, c), strict=False)
        success = study.success(c)
        entry["success"] = {"runs": success.count, "low": success.low, "high": success.high}
    return {
        **shared.head_document(study),
        "calibrations": calibrations,
        "ratios": shared.ratios(study, TRUE),
        "ratios_seen": shared.ratios(study, SEEN),
        "note": _NOTE,
    }


def tables(study: DockingStudy) -> dict[str, Iterable[Row]]:
    """Largest contact forces and torques, and the traces."""
    return {"maxima.csv": _largest(study), "traces.csv": shared.trace_rows(study)}


def _largest(study: DockingStudy) -> Iterator[Row]:
    names = [f"{name}_{'N' if name[0] == 'f' else 'Nm'}" for name in COMPONENTS]
    times = ("first_contact_s", "insertion_s", "seat_s", "stopped_s")
    when = np.dstack([study.starts[..., 1:], study.grid(study.result.stopped)])
    largest, length, measured = study.peak, study.length, study.seen
    for c, name in enumerate(study.names):
        for run in range(study.arms.runs):
            peak, seen = largest[c, run].tolist(), measured[c, run].tolist()
            yield {
                "calibration": name,
                "run": run + 1,
                "outcome": study.outcome(c, run),
                **dict(zip(names, peak, strict=True)),
                "force_N": float(length[c, run, 0]),
                "torque_Nm": float(length[c, run, 1]),
                **{f"seen_{n}": v for n, v in zip(names, seen, strict=True)},
                **{n: number(t) for n, t in zip(times, when[c, run], strict=True)},
            }


def drawings(study: DockingStudy) -> tuple[Drawing, ...]:
    """Fig. 17, of the median run of the paper's self-calibration and of ours, and Fig. 18."""
    shown: list[str] = [name for name in ("linear", "self-all") if name in study.names]
    shown = shown or [[name for name in study.names if name not in BEST][-1]]
    forces = {name: study.values(name, 0) for name in study.names}
    said = ", ".join(
        f"{name} {force.mean():.3g} N ({force.size})"
        for name, force in forces.items()
        if force.size
    )
    each = []
    for k, name in enumerate(shown):
        c = study.names.index(name)
        run = _median(study, c)
        each.append(
            Drawing(
                "docking" if k == len(shown) - 1 else f"docking-{name}",
                f"Contact force and torque of one docking: calibration {name}, run {run + 1} of "
                f"{study.arms.runs}",
                _told(study, c, run),
                partial(_paint_docking, study, c, run),
            )
        )
    maxima = Drawing(
        "maxima",
        "Largest contact force and torque of each docking",
        f"Mean over directions and runs that made contact (their number): {said}.",
        partial(_paint_maxima, study),
    )
    return (*each, maxima)


def _median(study: DockingStudy, c: int) -> int:
    """The run of middle force among those that made contact."""
    force = study.sample(0)[c]
    return int(np.argsort(force, kind="stable")[np.isfinite(force).sum() // 2])


def _told(study: DockingStudy, c: int, run: int) -> str:
    """What happens in a run."""
    starts = study.starts[c, run]
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
    traces, starts = study.result.traces, study.result.phase_start[lane]
    stop = study.result.stopped[lane]
    last = len(traces.time) if np.isnan(stop) else int(np.searchsorted(traces.time, stop)) + 1
    time = traces.time[:last]
    fig = figure(5.4)
    grid = fig.subplots(2, 3, sharex=True)
    for axis, ax in enumerate(grid.flat):
        seen, true = traces.measured[:last, lane, axis], traces.contact[:last, lane, axis]
        ax.plot(time, seen, color=ink.ORANGE, linewidth=0.7, label="as the controller sees it")
        ax.plot(time, true, color=ink.BLACK, linewidth=1.0, label="true")
        for phase, start in zip(PHASES[1:], starts[1:], strict=True):
            if np.isfinite(start):
                line = {"first contact": "--", "insertion": ":", "seated": "-."}[phase]
                label = f"{phase}, {start:.1f} s"
                ax.axvline(start, color=ink.BLUE, linewidth=0.9, linestyle=line, label=label)
        largest = study.peak[c, run, axis]
        ax.set_title(f"{_FORCES[axis]}; largest true {largest:.3g}")
        limit = study.setup.controller.thresholds[axis] if axis < 3 else 0.0
        _scale(ax, axis, float(max(np.abs(seen).max(), np.abs(true).max(), limit)), both=True)
        if axis < 3:
            ax.axhline(limit, color=ink.RED, linewidth=0.7)
            ax.axhline(-limit, color=ink.RED, linewidth=0.7, label="limit" if axis == 0 else None)
        if axis >= 3:
            ax.set_xlabel("time, s")
    legend_outside(fig, grid.flat[0])
    return fig


def _paint_maxima(study: DockingStudy) -> Figure:
    """Every run a dot, the mean a bar with its standard error."""
    fig = figure(5.6)
    grid = fig.subplots(2, 3, sharex=True)
    spread = np.linspace(-0.25, 0.25, study.arms.runs) if study.arms.runs > 1 else np.zeros(1)
    for axis, ax in enumerate(grid.flat):
        top = 0.0
        for c in range(len(study.names)):
            colour, _, marker = shared.MARKS[c % len(shared.MARKS)]
            met = study.touched[c]
            values = study.peak[c, met, axis]
            if not values.size:
                ax.text(c, 0.3, "no contact", rotation=90, fontsize=6.5, ha="center", va="bottom")
                continue
            top = max(top, float(values.max()))
            ax.plot(c + spread[met], values, marker, color=colour, markersize=2.5, alpha=0.6)
            mean, error = np.nan_to_num(mean_of(values))
            ax.errorbar(c, mean, error, color=ink.BLACK, marker="_", markersize=14, capsize=3)
        if axis < 3:
            ax.axhline(study.setup.controller.thresholds[axis], color=ink.RED, linewidth=0.8)
        _scale(ax, axis, top)
        ax.set_xlim(-0.6, len(study.names) - 0.4)
        ax.set_title(_FORCES[axis] + ("" if axis > 2 else ", limit in red"))
        ax.set_xticks(range(len(study.names)), study.names, rotation=60, ha="right", fontsize=7)
    return fig


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
