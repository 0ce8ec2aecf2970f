"""Free space under impedance control, beside the paper's figures (Table 4, Fig. 16)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.reports import controlled as shared
from studies.reports.cells import Row
from studies.reports.paper import POSE, free_space_items
from studies.runs.free_space import FreeSpaceStudy
from tdfscal.reporting.figures.style import Drawing, figure, legend_outside, logarithmic
from tdfscal.reporting.layout import Report, Section

_NOTE = (
    "The paper's arms differ in their angles alone, and so do the first four here: their zeros, "
    "mass and barycentre are the rig file's, within what it states of them. The paper's self is "
    "the linear method (Eq. 24); its numbers stand beside that one only. docs/control.md has the "
    "model and its parameters."
)


def report(study: FreeSpaceStudy) -> Report:
    """Lay out the deviations, their ratios, what of the paper they reproduce, and why."""
    caption = "Deviation of the final pose, mean over moves and runs ± standard error"
    blocks = (
        shared.means_table(caption, study, POSE),
        shared.ratio_table("Ratios of the means ± standard error", study, POSE),
        shared.knows(study.arms),
        *shared.against_paper(study.arms, free_space_items(study)),
        _NOTE,
    )
    return Report(
        title=f"Free space: {study.setup.rig.name}",
        subtitle=f"{len(study.setup.moves)} moves in free space, {study.arms.runs} runs; "
        f"{shared.machine(study)}; {study.arms.origin}",
        sections=(Section("Free space", blocks),),
    )


def document(study: FreeSpaceStudy) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    return {
        **shared.head_document(study),
        "moves": len(study.setup.moves),
        "calibrations": shared.arm_documents(study, POSE, POSE.names),
        "ratios": shared.ratios(study, POSE),
        "note": _NOTE,
    }


def tables(study: FreeSpaceStudy) -> dict[str, Iterable[Row]]:
    """Deviations, and the traces."""
    return {"deviations.csv": _deviations(study), "traces.csv": shared.trace_rows(study)}


def _deviations(study: FreeSpaceStudy) -> Iterator[Row]:
    units = ("m",) * 3 + ("rad",) * 3
    names = [f"{name}_{unit}" for name, unit in zip(shared.DEVIATION, units, strict=True)]
    for place in np.ndindex(study.length.shape[:3]):
        c, m, run = place
        yield {
            "calibration": study.names[c],
            "move": m + 1,
            "run": run + 1,
            **dict(zip(names, study.deviation[place].tolist(), strict=True)),
            "position_m": float(study.length[(*place, 0)]),
            "posture_rad": float(study.length[(*place, 1)]),
        }


def drawings(study: FreeSpaceStudy) -> tuple[Drawing, ...]:
    """Fig. 16."""
    means = 1e3 * study.length.mean(axis=(1, 2))
    said = ", ".join(
        f"{name} {mm:.3g} mm and {mrad:.3g} mrad"
        for name, (mm, mrad) in zip(study.names, means, strict=True)
    )
    title = "Deviation of the final pose after each move in free space, rms over runs"
    return (Drawing("free-space", title, f"Mean lengths: {said}.", partial(_paint, study)),)


def _paint(study: FreeSpaceStudy) -> Figure:
    fig = figure(4.6)
    grid = fig.subplots(2, 3, sharex=True)
    names = ("x", "y", "z", "about x", "about y", "about z")
    rms = 1e3 * np.sqrt(np.mean(study.deviation**2, axis=2))  # (C, M, 6)
    move = np.arange(1.0, rms.shape[1] + 1.0)
    for axis, ax in enumerate(grid.flat):
        for c, name in enumerate(study.names):
            colour, line, marker = shared.MARKS[c % len(shared.MARKS)]
            ax.plot(
                move, rms[c, :, axis], color=colour, linestyle=line, marker=marker, markersize=4,
                label=name,
            )  # fmt: skip
        logarithmic(ax)
        ax.set_title(names[axis])
        ax.set_xticks(move)
        if axis % 3 == 0:
            ax.set_ylabel("rms over runs, " + ("mm" if axis < 3 else "mrad"))
        if axis >= 3:
            ax.set_xlabel("move")
    legend_outside(fig, grid.flat[0])
    return fig
