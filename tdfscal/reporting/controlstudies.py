"""Free space and docking in words, tables and plain rows, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from tdfscal.records import BoolArray, FloatArray
from tdfscal.reporting.layout import Block, Facts, Items, Report, Section, Table
from tdfscal.reporting.paper import Item, docking_items, free_space_items, sentence
from tdfscal.simulation.control.runs import Controller
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import KNOWS, LIKE, Arms
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.studies.ratios import Ratio, Share
from tdfscal.wrench.contact_wrench import COMPONENTS

Row = tuple[str | float | int, ...]
Study = DockingStudy | FreeSpaceStudy

_DEVIATION = ("x", "y", "z", "rx", "ry", "rz")


def pairs(names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every calibration against the tracker's angles; of given ones each against the one before."""
    if "tracker" not in names:
        return [(b, a) for a, b in pairwise(names)]
    found = [("tracker", "none")]
    return found + [(name, "tracker") for name in names if name not in ("none", "tracker")]


def _said(ratio: Ratio) -> str:
    if np.isnan(ratio.value):
        return "–"
    std = "" if np.isnan(ratio.std) else f" ± {ratio.std:.2g}"
    return f"{ratio.value:.3g}{std}"


def mean_se(values: FloatArray, runs: int) -> str:
    """Mean ± standard error of runs, and of how many where some did not come so far."""
    if values.size == 0:
        return f"– (0 of {runs})"
    std = f" ± {np.std(values, ddof=1) / np.sqrt(values.size):.2g}" if values.size > 1 else ""
    lost = f" ({values.size} of {runs})" if values.size < runs else ""
    return f"{values.mean():.3g}{std}{lost}"


def share_said(share: Share) -> str:
    """Share of runs with its interval, in per cent."""
    return f"{100 * share.value:.0f} ({100 * share.low:.0f}–{100 * share.high:.0f})"


def _paper_ratio(paper: dict[str, tuple[float, float]], of: str, to: str, quantity: int) -> str:
    if of not in paper or to not in paper:
        return ""
    return f"{paper[of][quantity] / paper[to][quantity]:.3g}"


def free_space_report(study: FreeSpaceStudy) -> Report:
    """Lay out the deviations, their ratios, what of the paper they reproduce, and why."""
    rows = []
    for c, arm in enumerate(study.arms.arms):
        paper = free_space.PAPER.get(arm.name)
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for quantity in (0, 1):
            values = 1e3 * study.length[c, ..., quantity].mean(axis=0)
            row += [mean_se(values, study.arms.runs), f"{paper[quantity]:.3f}" if paper else ""]
        rows.append(tuple(row))
    header = ("", "rms angle error, mrad", "position, mm", "paper", "posture, mrad", "paper")
    caption = "Deviation of the final pose, mean over moves and runs ± standard error"
    blocks = (
        Table(caption, header, tuple(rows)),
        _ratio_table("Ratios of the means ± standard error", ("position", "posture"), study,
                     free_space.PAPER),
        _knows(study.arms),
        *_against_paper(study.arms, free_space_items(study)),
        FREE_SPACE_NOTE,
    )  # fmt: skip
    return Report(
        title=f"Free space: {study.setup.rig.name}",
        subtitle=f"{len(study.setup.moves)} moves in free space, {study.arms.runs} runs; "
        f"{_machine(study)}; {study.arms.origin}",
        sections=(Section("Free space", blocks),),
    )


def _against_paper(arms: Arms, items: list[Item]) -> tuple[Block, ...]:
    """What of the paper is reproduced; nothing where given calibrations are at work."""
    if not set(LIKE) <= set(arms.names):
        return ()
    return (Items("Beside the paper", tuple(sentence(item) for item in items if item.like)),)


def _knows(arms: Arms) -> Block:
    """What each controller knows, and which calibrations gave no result."""
    rows = []
    for arm in arms.arms:
        text = KNOWS.get(arm.name, "a given calibration: all that it states")
        if arm.failed:
            text += f"; no result in {arm.failed} of {arms.runs} runs, which keep the nominal ones"
        rows.append((arm.name, text))
    return Facts(tuple(rows))


def _ratio_table(
    caption: str,
    names: tuple[str, str],
    study: Study,
    paper: dict[str, tuple[float, float]],
    **which: bool,
) -> Table:
    rows = []
    for of, to in pairs(study.names):
        row = [f"{of} / {to}"]
        for quantity in (0, 1):
            found = study.ratio(quantity, of, to, **which)
            row += [_said(found), _paper_ratio(paper, of, to, quantity)]
        rows.append(tuple(row))
    return Table(caption, ("", names[0], "paper", names[1], "paper"), tuple(rows))


def _machine(study: Study) -> str:
    """The controller in a few words."""
    c = study.setup.controller
    said = (
        f"virtual mass {c.impedance.mass[0]:g} kg, damping {c.impedance.damping[0]:.3g} N·s/m, "
        f"stiffness {c.impedance.stiffness[0]:g} N/m, servos {c.servo.bandwidth:g} Hz"
    )
    if c.sensing.gain < 1.0:
        said += f", a filter that is {1e3 * c.sensing.delay:.2g} ms late"
    return said


FREE_SPACE_NOTE = (
    "The paper's arms differ in their angles alone, and so do the first four here: their zeros, "
    "mass and barycentre are the rig file's, within what it states of them. The paper's self is "
    "the linear method (Eq. 24); its numbers stand beside that one only. docs/control.md has the "
    "model and its parameters."
)
DOCKING_NOTE = (
    "True maxima are those that the gears exert from first contact to the seat, over runs that "
    "made contact, whose number is given where it is not all of them. Seen are those of the "
    "controller's own wrench from the start: that is what the paper's control software records, so "
    "its numbers stand there, and beside its own method (Eq. 24) only. A run succeeds where it "
    "seats and no true force before was beyond its limit. The newtons go with contact stiffness "
    "and speed: `study success` sweeps the former. docs/control.md has the model and its "
    "parameters."
)


def docking_report(study: DockingStudy) -> Report:
    """Lay out the maxima, outcomes, ratios, what of the paper they reproduce, and why."""
    setup = study.setup
    limits = ", ".join(f"{v:g}" for v in setup.controller.thresholds)
    blocks: tuple[Block, ...] = (
        _maxima("true", study, study.average, study.touched, {}),
        _maxima("seen", study, study.average_seen, study.touched, docking.PAPER),
        Table(
            f"Outcome: runs, and success without a force above its limit ({limits} N) in % with "
            "its 95 % interval",
            ("", "seated", "jammed", "false contact", "not finished", "success, %"),
            tuple(
                (arm.name, *map(str, _outcomes(study, c)), share_said(study.success(c)))
                for c, arm in enumerate(study.arms.arms)
            ),
        ),
        *(
            _ratio_table(f"Ratios of the means ± standard error, {name}, runs in which both made "
                         "contact", ("force", "torque"), study, paper, **which)
            for name, paper, which in (
                ("true", {}, {}), ("seen", docking.PAPER, {"seen": True})
            )
        ),
        _knows(study.arms),
        *_against_paper(study.arms, docking_items(study)),
        DOCKING_NOTE,
    )  # fmt: skip
    return Report(
        title=f"Docking: {setup.rig.name}",
        subtitle=f"{1e3 * setup.speed:g} mm/s over {1e3 * setup.gap:g} mm of free space and "
        f"{1e3 * setup.gears.length:.3g} mm of engagement, contact "
        f"{1e-6 * setup.gears.stiffness:.2g} N/µm, {study.arms.runs} runs; "
        f"{_machine(study)}; {study.arms.origin}",
        sections=(Section("Docking", blocks),),
    )


def _maxima(
    name: str,
    study: DockingStudy,
    average: FloatArray,
    counted: BoolArray,
    published: dict[str, tuple[float, float]],
) -> Table:
    """Mean and standard error of the maxima (C, R, 2) of the runs that count (C, R)."""
    rows = []
    for c, arm in enumerate(study.arms.arms):
        paper = published.get(arm.name)
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for quantity in (0, 1):
            row.append(mean_se(average[c, counted[c], quantity], study.arms.runs))
            if published:
                row.append(f"{paper[quantity]:.2f}" if paper else "")
        rows.append(tuple(row))
    caption = f"Maxima, {name}, mean of x, y and z: mean over runs ± standard error"
    header = ["", "rms angle error, mrad", "force, N", "torque, N·m"]
    if published:
        header = [*header[:3], "paper", header[3], "paper"]
    return Table(caption, tuple(header), tuple(rows))


def _outcomes(study: DockingStudy, c: int) -> tuple[int, int, int, int]:
    """Runs of a calibration that were seated, jammed, stopped at a false contact, or none."""
    seated, jammed, touched = study.seated[c], study.jammed[c], study.touched[c]
    return (
        int(seated.sum()),
        int((jammed & touched).sum()),
        int((jammed & ~touched).sum()),
        int((~seated & ~jammed).sum()),
    )


def free_space_rows(study: FreeSpaceStudy) -> Iterator[Row]:
    """Header and rows of deviations.csv."""
    units = ("m",) * 3 + ("rad",) * 3
    yield (
        "calibration",
        "move",
        "run",
        *(f"{name}_{unit}" for name, unit in zip(_DEVIATION, units, strict=True)),
        "position_m",
        "posture_rad",
    )
    for c, name in enumerate(study.names):
        for m in range(study.length.shape[1]):
            for run in range(study.arms.runs):
                place = (c, m, run)
                yield (
                    name,
                    m + 1,
                    run + 1,
                    *study.deviation[place].tolist(),
                    *study.length[place].tolist(),
                )


def docking_rows(study: DockingStudy) -> Iterator[Row]:
    """Header and rows of maxima.csv."""
    names = [f"{name}_{'N' if name[0] == 'f' else 'Nm'}" for name in COMPONENTS]
    yield (
        "calibration",
        "run",
        "outcome",
        *names,
        "force_N",
        "torque_Nm",
        *(f"seen_{name}" for name in names),
        "first_contact_s",
        "insertion_s",
        "seat_s",
        "stopped_s",
    )
    starts = study.grid(np.moveaxis(study.result.phase_start, 0, -1))
    stopped = study.grid(study.result.stopped)
    for c, name in enumerate(study.names):
        for run in range(study.arms.runs):
            times = [*starts[c, run, 1:].tolist(), float(stopped[c, run])]
            yield (
                name,
                run + 1,
                study.outcome(c, run),
                *study.peak[c, run].tolist(),
                *study.length[c, run].tolist(),
                *study.seen[c, run].tolist(),
                *("" if np.isnan(t) else t for t in times),
            )


def trace_rows(study: Study, each: int = 1) -> Iterator[Row]:
    """Header and rows of traces.csv: every `each`-th record of every lane."""
    traces = study.result.traces
    lanes = traces.contact.shape[1]
    per = lanes // len(study.names)
    yield (
        "calibration",
        "run",
        "time_s",
        *(f"true_{name}" for name in COMPONENTS),
        *(f"seen_{name}" for name in COMPONENTS),
        *(f"deviation_{name}" for name in _DEVIATION),
        "depth_m",
    )
    table = np.concatenate(
        [traces.contact, traces.measured, traces.deviation, traces.depth[..., None]], axis=2
    )[::each]
    for lane in range(lanes):
        name, run = study.names[lane // per], lane % per + 1
        for t, row in zip(traces.time[::each].tolist(), table[:, lane].tolist(), strict=True):
            yield (name, run, t, *("" if np.isnan(v) else v for v in row))


def _ratios(
    study: Study, paper: dict[str, tuple[float, float]], of: tuple[str, str], **which: bool
) -> list[Any]:
    out = []
    for a, b in pairs(study.names):
        for quantity, name in enumerate(of):
            found = study.ratio(quantity, a, b, **which)
            known = a in paper and b in paper
            out.append(
                {
                    "quantity": name,
                    "of": a,
                    "to": b,
                    "ratio": _number(found.value),
                    "std": _number(found.std),
                    "paper": paper[a][quantity] / paper[b][quantity] if known else None,
                }
            )
    return out


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _moments(values: FloatArray) -> dict[str, float | None]:
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


def free_space_document(study: FreeSpaceStudy, files: list[str]) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    length = study.length
    return {
        "format": "tdfscal-study-free-space/1",
        "rig": study.setup.rig.name,
        "seed": study.seed,
        "runs": study.arms.runs,
        "moves": len(study.setup.moves),
        "tare": study.setup.controller.tare if any(a.tared for a in study.arms.arms) else 0.0,
        "filter_delay": study.setup.controller.sensing.delay,
        "cell": cell_document(study.setup.controller),
        "origin": study.arms.origin,
        "calibrations": [
            {
                "name": arm.name,
                "knows": KNOWS.get(arm.name),
                "tared": arm.tared,
                "angle_error": arm.angle_error,
                "failed": arm.failed,
                "position": _moments(length[c, ..., 0].mean(axis=0)),
                "posture": _moments(length[c, ..., 1].mean(axis=0)),
                "paper": _paper(free_space.PAPER.get(arm.name), 1e-3),
            }
            for c, arm in enumerate(study.arms.arms)
        ],
        "ratios": _ratios(study, free_space.PAPER, ("position", "posture")),
        "note": FREE_SPACE_NOTE,
        "files": files,
    }


def _paper(values: tuple[float, float] | None, unit: float = 1.0) -> list[float] | None:
    return None if values is None else [v * unit for v in values]


def docking_document(study: DockingStudy, files: list[str]) -> dict[str, Any]:
    """The study as plain JSON values, SI units."""
    calibrations = []
    for c, arm in enumerate(study.arms.arms):
        seated, jammed, false_contact, _ = _outcomes(study, c)
        entry: dict[str, Any] = {
            "name": arm.name,
            "knows": KNOWS.get(arm.name),
            "tared": arm.tared,
            "angle_error": arm.angle_error,
            "failed": arm.failed,
            "seated": seated,
            "jammed": jammed,
            "false_contact": false_contact,
            "paper": _paper(docking.PAPER.get(arm.name)),
        }
        for quantity, name in enumerate(("force", "torque")):
            entry[name] = _moments(study.average[c, study.touched[c], quantity])
            entry[f"seen_{name}"] = _moments(study.average_seen[c, study.touched[c], quantity])
        success = study.success(c)
        entry["success"] = {"runs": success.count, "low": success.low, "high": success.high}
        calibrations.append(entry)
    of = ("force", "torque")
    return {
        "format": "tdfscal-study-docking/1",
        "rig": study.setup.rig.name,
        "seed": study.seed,
        "runs": study.arms.runs,
        "tare": study.setup.controller.tare if any(a.tared for a in study.arms.arms) else 0.0,
        "filter_delay": study.setup.controller.sensing.delay,
        "cell": cell_document(study.setup.controller),
        "origin": study.arms.origin,
        "calibrations": calibrations,
        "ratios": _ratios(study, {}, of),
        "ratios_seen": _ratios(study, docking.PAPER, of, seen=True),
        "note": DOCKING_NOTE,
        "files": files,
    }
