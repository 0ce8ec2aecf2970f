"""What the studies of the controlled rig say alike: arms, ratios, machine, traces, marks."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.layout import Block, Facts, Items, Table
from tdfscal.reporting.studies.cells import Row, number, with_error
from tdfscal.reporting.studies.paper import Item, sentence
from tdfscal.simulation.control.runs import Controller
from tdfscal.studies.compared_calibrations import KNOWS, LIKE, Arm, Arms
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.wrench.contact_wrench import COMPONENTS

Study = DockingStudy | FreeSpaceStudy
#: The paper's numbers of two quantities, by the arm that is like its calibration.
Paper = dict[str, tuple[float, float]]

DEVIATION = ("x", "y", "z", "rx", "ry", "rz")
#: Colour, line and marker of each calibration: each tells them apart on its own.
MARKS = (
    (ink.BLACK, ":", "x"),
    (ink.ORANGE, "--", "s"),
    (ink.RED, "-.", "D"),
    (ink.BLUE, "-", "o"),
    (ink.GREEN, "-.", "^"),
    (ink.ORANGE, ":", "P"),
    (ink.GREY, "--", "v"),
    (ink.GREY, "-", "*"),
)
#: Rows of a lane in traces.csv at most, about.
_TRACE_ROWS = 600


def against_paper(arms: Arms, items: list[Item]) -> tuple[Block, ...]:
    """What of the paper is reproduced; nothing where given calibrations are at work."""
    if not set(LIKE) <= set(arms.names):
        return ()
    return (Items("Beside the paper", tuple(sentence(item) for item in items if item.like)),)


def knows(arms: Arms) -> Block:
    """What each controller knows, and which calibrations gave no result."""
    rows = []
    for arm in arms.arms:
        text = KNOWS.get(arm.name, "a given calibration: all that it states")
        if arm.failed:
            text += f"; no result in {arm.failed} of {arms.runs} runs, which keep the nominal ones"
        rows.append((arm.name, text))
    return Facts(tuple(rows))


def machine(study: Study) -> str:
    """The controller in a few words."""
    c = study.setup.controller
    said = (
        f"virtual mass {c.impedance.mass[0]:g} kg, damping {c.impedance.damping[0]:.3g} N·s/m, "
        f"stiffness {c.impedance.stiffness[0]:g} N/m, servos {c.servo.bandwidth:g} Hz"
    )
    if c.sensing.gain < 1.0:
        said += f", a filter that is {1e3 * c.sensing.delay:.2g} ms late"
    return said


def _pairs(names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every calibration against the tracker's angles; of given ones each against the one before."""
    if "tracker" not in names:
        return [(b, a) for a, b in pairwise(names)]
    found = [("tracker", "none")]
    return found + [(name, "tracker") for name in names if name not in ("none", "tracker")]


def _published(paper: Paper, of: str, to: str, quantity: int) -> float | None:
    return paper[of][quantity] / paper[to][quantity] if of in paper and to in paper else None


def ratio_table(
    caption: str, names: tuple[str, str], study: Study, paper: Paper, **which: bool
) -> Table:
    """Ratios of two quantities between calibrations, beside the paper's."""
    rows = []
    for of, to in _pairs(study.names):
        row = [f"{of} / {to}"]
        for quantity in (0, 1):
            found = study.ratio(quantity, of, to, **which)
            known = _published(paper, of, to, quantity)
            row += [with_error(found.value, found.std), "" if known is None else f"{known:.3g}"]
        rows.append(tuple(row))
    return Table(caption, ("", names[0], "paper", names[1], "paper"), tuple(rows))


def ratios(study: Study, paper: Paper, of: tuple[str, str], **which: bool) -> list[Any]:
    """The same as plain JSON values."""
    out = []
    for a, b in _pairs(study.names):
        for quantity, name in enumerate(of):
            found = study.ratio(quantity, a, b, **which)
            out.append(
                {
                    "quantity": name,
                    "of": a,
                    "to": b,
                    "ratio": number(found.value),
                    "std": number(found.std),
                    "paper": _published(paper, a, b, quantity),
                }
            )
    return out


def moments(values: FloatArray) -> dict[str, float | None]:
    """Mean, standard deviation and standard error over runs."""
    std = float(np.std(values, ddof=1)) if values.size > 1 else None
    return {
        "mean": float(values.mean()) if values.size else None,
        "std": std,
        "standard_error": None if std is None else std / values.size**0.5,
        "runs": int(values.size),
    }


def cell_document(controller: Controller) -> dict[str, Any]:
    """Controller and machine as plain JSON values, SI units."""
    c = controller
    return {
        "virtual_mass": list(c.impedance.mass),
        "damping": list(c.impedance.damping),
        "stiffness": list(c.impedance.stiffness),
        "servo_bandwidth": c.servo.bandwidth,
        "encoder_resolution": c.servo.resolution,
        "structural_damping": c.structure.damping,
        "sample_rate": c.sensing.rate,
        "thresholds": list(c.thresholds),
        "step": c.step,
    }


def head_document(study: Study) -> dict[str, Any]:
    """Rig, seed and machine as plain JSON values, SI units."""
    controller = study.setup.controller
    return {
        "rig": study.setup.rig.name,
        "seed": study.seed,
        "runs": study.arms.runs,
        "tare": controller.tare if any(a.tared for a in study.arms.arms) else 0.0,
        "filter_delay": controller.sensing.delay,
        "cell": cell_document(controller),
        "origin": study.arms.origin,
    }


def arm_document(arm: Arm, paper: Paper, unit: float) -> dict[str, Any]:
    """One calibration as plain JSON values, SI units; unit : of the paper's numbers."""
    known = paper.get(arm.name)
    return {
        "name": arm.name,
        "knows": KNOWS.get(arm.name),
        "tared": arm.tared,
        "angle_error": arm.angle_error,
        "failed": arm.failed,
        "paper": None if known is None else [v * unit for v in known],
    }


def trace_rows(study: Study) -> Iterator[Row]:
    """Rows of traces.csv: every so many-th record of every lane."""
    traces = study.result.traces
    each = -(-len(traces.time) // _TRACE_ROWS)
    lanes = traces.contact.shape[1]
    per = lanes // len(study.names)
    columns = (
        *(f"true_{name}" for name in COMPONENTS),
        *(f"seen_{name}" for name in COMPONENTS),
        *(f"deviation_{name}" for name in DEVIATION),
        "depth_m",
    )
    table = np.concatenate(
        [traces.contact, traces.measured, traces.deviation, traces.depth[..., None]], axis=2
    )[::each]
    for lane in range(lanes):
        head = {"calibration": study.names[lane // per], "run": lane % per + 1}
        for t, row in zip(traces.time[::each].tolist(), table[:, lane].tolist(), strict=True):
            yield {**head, "time_s": t, **dict(zip(columns, map(number, row), strict=True))}


def marked(ax: Axes, x: FloatArray, values: FloatArray, names: tuple[str, ...]) -> None:
    """One line with markers per calibration, values (C, X)."""
    for c, name in enumerate(names):
        colour, line, marker = MARKS[c % len(MARKS)]
        ax.plot(x, values[c], color=colour, linestyle=line, marker=marker, markersize=4, label=name)
