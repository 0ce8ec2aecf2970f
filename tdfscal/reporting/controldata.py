"""Free space and docking as plain rows (CSV) and JSON values."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from tdfscal.records import FloatArray
from tdfscal.simulation.control.runs import Controller
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import KNOWS
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.wrench.contact_wrench import COMPONENTS

Row = tuple[str | float | int, ...]
Study = DockingStudy | FreeSpaceStudy

_DEVIATION = ("x", "y", "z", "rx", "ry", "rz")


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


def pairs(names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every calibration against the tracker's angles; of given ones each against the one before."""
    if "tracker" not in names:
        return [(b, a) for a, b in pairwise(names)]
    found = [("tracker", "none")]
    return found + [(name, "tracker") for name in names if name not in ("none", "tracker")]


def outcomes(study: DockingStudy, c: int) -> tuple[int, int, int, int]:
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
        seated, jammed, false_contact, _ = outcomes(study, c)
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
