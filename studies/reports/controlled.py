"""What the studies of the controlled rig say alike: arms, ratios, machine, traces, marks."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from studies.control.runs import Controller
from studies.reports.cells import Row, mean_of, mean_se, number, with_error
from studies.reports.paper import Item, Pair, sentence
from studies.runs.compared_calibrations import KNOWS, LIKE, Arms
from studies.runs.docking import DockingStudy
from studies.runs.free_space import FreeSpaceStudy
from studies.runs.ratios import Ratio
from tdfscal.records import FloatArray
from tdfscal.reporting.figures import ink
from tdfscal.reporting.layout import Block, Facts, Items, Table
from tdfscal.wrench.contact_wrench import COMPONENTS

Study = DockingStudy | FreeSpaceStudy
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


def means_table(caption: str, study: Study, pair: Pair) -> Table:
    """Mean ± standard error over runs of each calibration, beside the paper's where it has any."""
    rows = []
    for arm in study.arms.arms:
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for k in (0, 1):
            row.append(
                mean_se(pair.scale * study.values(arm.name, pair.first + k), study.arms.runs)
            )
            if pair.paper:
                row.append(
                    f"{pair.paper[arm.name][k]:{pair.form}}" if arm.name in pair.paper else ""
                )
        rows.append(tuple(row))
    header = ["", "rms angle error, mrad"]
    for name, unit in zip(pair.names, pair.units, strict=True):
        header += [f"{name}, {unit}", "paper"] if pair.paper else [f"{name}, {unit}"]
    return Table(caption, tuple(header), tuple(rows))


def _ratios(study: Study, pair: Pair) -> Iterator[tuple[str, str, int, Ratio, float | None]]:
    """Calibration, the one that it is compared with, quantity, ratio and the paper's."""
    paper = pair.paper
    for of, to in _pairs(study.names):
        for k in (0, 1):
            known = paper[of][k] / paper[to][k] if of in paper and to in paper else None
            yield of, to, k, study.ratio(pair.first + k, of, to), known


def ratio_table(caption: str, study: Study, pair: Pair) -> Table:
    """Ratios between calibrations, beside the paper's."""
    rows: dict[str, list[str]] = {}
    for of, to, _, found, known in _ratios(study, pair):
        row = rows.setdefault(f"{of} / {to}", [])
        row += [with_error(found.value, found.std), "" if known is None else f"{known:.3g}"]
    header = ("", pair.names[0], "paper", pair.names[1], "paper")
    return Table(caption, header, tuple((name, *row) for name, row in rows.items()))


def ratios(study: Study, pair: Pair) -> list[Any]:
    """The same as plain JSON values."""
    return [
        {
            "quantity": pair.names[k],
            "of": of,
            "to": to,
            "ratio": number(found.value),
            "std": number(found.std),
            "paper": known,
        }
        for of, to, k, found, known in _ratios(study, pair)
    ]


def moments(values: FloatArray) -> dict[str, float | None]:
    """Mean, standard deviation and standard error over runs."""
    mean, error = map(number, mean_of(values))
    std = None if error is None else float(np.std(values, ddof=1))
    return {"mean": mean, "std": std, "standard_error": error, "runs": int(values.size)}


def cell_document(controller: Controller) -> dict[str, Any]:
    """Controller and machine as plain JSON values, SI units."""
    c = controller
    return {
        "virtual_mass": list(c.impedance.mass),
        "damping": list(c.impedance.damping),
        "stiffness": list(c.impedance.stiffness),
        "servo_bandwidth": c.servo.bandwidth,
        "encoder_resolution": c.servo.resolution,
        "structural_damping": c.damping,
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


def arm_documents(study: Study, pair: Pair, quantities: tuple[str, ...]) -> list[dict[str, Any]]:
    """Each calibration and its quantities as plain JSON values, SI units."""
    return [
        {
            "name": arm.name,
            "knows": KNOWS.get(arm.name),
            "tared": arm.tared,
            "angle_error": arm.angle_error,
            "failed": arm.failed,
            "paper": pair.paper.get(arm.name) and [v / pair.scale for v in pair.paper[arm.name]],
            **{name: moments(study.values(arm.name, k)) for k, name in enumerate(quantities)},
        }
        for arm in study.arms.arms
    ]


def trace_rows(study: Study) -> Iterator[Row]:
    """Rows of traces.csv: every so many-th record of every lane."""
    traces = study.result.traces
    each = -(-len(traces.time) // _TRACE_ROWS)
    per = traces.contact.shape[1] // len(study.names)
    columns = (
        *(f"true_{name}" for name in COMPONENTS),
        *(f"seen_{name}" for name in COMPONENTS),
        *(f"deviation_{name}" for name in DEVIATION),
        "depth_m",
    )
    table = np.concatenate(
        [traces.contact, traces.measured, traces.deviation, traces.depth[..., None]], axis=2
    )[::each]
    for lane in range(table.shape[1]):
        head = {"calibration": study.names[lane // per], "run": lane % per + 1}
        for t, row in zip(traces.time[::each].tolist(), table[:, lane].tolist(), strict=True):
            yield {**head, "time_s": t, **dict(zip(columns, map(number, row), strict=True))}
