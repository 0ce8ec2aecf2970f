"""Free space and docking in words, tables and plain rows, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from tdfscal.records import BoolArray, FloatArray
from tdfscal.reporting.layout import Block, Report, Section, Table
from tdfscal.studies import docking, free_space
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.studies.ratios import Ratio
from tdfscal.wrench.contact_wrench import COMPONENTS

Row = tuple[str | float | int, ...]
Study = DockingStudy | FreeSpaceStudy

_DEVIATION = ("x", "y", "z", "rx", "ry", "rz")


def pairs(names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Every calibration against the one before it, and the last against the first."""
    found = [(b, a) for a, b in pairwise(names)]
    if len(names) > 2:
        found.append((names[-1], names[0]))
    return found


def _said(ratio: Ratio) -> str:
    if np.isnan(ratio.value):
        return "–"
    std = "" if np.isnan(ratio.std) else f" ± {ratio.std:.2g}"
    return f"{ratio.value:.3g}{std}"


def _spread(values: FloatArray) -> str:
    return f"{np.std(values, ddof=1):.3g}" if values.size > 1 else ""


def _paper_ratio(paper: dict[str, tuple[float, float]], of: str, to: str, quantity: int) -> str:
    if of not in paper or to not in paper:
        return ""
    return f"{paper[of][quantity] / paper[to][quantity]:.3g}"


def free_space_report(study: FreeSpaceStudy) -> Report:
    """Lay out the deviations, their ratios, and what lies behind them."""
    rows = []
    for c, arm in enumerate(study.arms.arms):
        paper = free_space.PAPER.get(arm.name)
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for quantity in (0, 1):
            values = 1e3 * study.length[c, ..., quantity]
            row += [f"{values.mean():.3f}", _spread(values)]
            row.append(f"{paper[quantity]:.3f}" if paper else "")
        rows.append(tuple(row))
    header = ("", "angles off, mrad", "mm", "std", "paper", "mrad", "std", "paper")
    caption = "Deviation of the final pose, mean and standard deviation; the paper's means"
    blocks = (
        Table(caption, header, tuple(rows)),
        _ratio_table("Ratios of the means ± standard error", ("position", "posture"), study,
                     free_space.PAPER),
        FREE_SPACE_NOTE,
    )  # fmt: skip
    return Report(
        title=f"Free space: {study.setup.rig.name}",
        subtitle=f"{len(study.setup.moves)} moves in free space, {study.arms.runs} runs; "
        f"{_machine(study)}; {study.arms.origin}",
        sections=(Section("Free space", blocks),),
    )


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
    """How the controller treats its sensors."""
    controller = study.setup.controller
    seconds, sensing = controller.tare, controller.sensing
    said = f"tared over {seconds:g} s at the start" if seconds > 0.0 else "not tared"
    if sensing.gain < 1.0:
        said += f", a Kalman filter that is {1e3 * sensing.delay:.2g} ms late"
    return said


FREE_SPACE_NOTE = (
    "Everything that the controller has wrong shows: angles, zeros, mass, barycentre. The laser "
    "tracker gives angles alone, self-calibration all of them. The paper does not give its "
    "impedance, so its millimetres compare by ratio at best. docs/control.md takes the causes "
    "apart."
)
DOCKING_NOTE = (
    "True maxima are those that the gears exert from first contact to the seat, over runs that "
    "made contact; seen are those of the controller's own wrench, false forces and noise included, "
    "from the start, over all runs (one that stopped at a false force saw a threshold). No "
    "calibration gets below a perfect one (--perfect): there the sensors' noise drives the "
    "terminal against the bore. docs/control.md takes the causes apart."
)


def docking_report(study: DockingStudy) -> Report:
    """Lay out the maxima, outcomes, ratios, and what lies behind them."""
    setup = study.setup
    outcomes = tuple(
        (arm.name, *map(str, _outcomes(study, c))) for c, arm in enumerate(study.arms.arms)
    )
    blocks: tuple[Block, ...] = (
        _maxima("true", study, study.average, study.touched),
        _maxima("seen", study, study.average_seen, np.ones_like(study.touched)),
        Table("Outcome, runs", ("", "seated", "jammed", "false contact", "not finished"), outcomes),
        *(
            _ratio_table(f"Ratios of the means ± standard error, {name}", ("force", "torque"),
                         study, docking.PAPER, **which)
            for name, which in (("true", {}), ("seen", {"seen": True}))
        ),
        DOCKING_NOTE,
    )  # fmt: skip
    return Report(
        title=f"Docking: {setup.rig.name}",
        subtitle=f"{1e3 * setup.speed:g} mm/s over {1e3 * setup.gap:g} mm of free space and "
        f"{1e3 * setup.gears.length:.3g} mm of engagement, {study.arms.runs} runs; "
        f"{_machine(study)}; {study.arms.origin}",
        sections=(Section("Docking", blocks),),
    )


def _maxima(name: str, study: DockingStudy, average: FloatArray, counted: BoolArray) -> Table:
    """Mean and scatter of the maxima (C, R, 2) of the runs that count (C, R)."""
    rows = []
    for c, arm in enumerate(study.arms.arms):
        paper = docking.PAPER.get(arm.name)
        row = [arm.name, f"{1e3 * arm.angle_error:.3g}"]
        for quantity in (0, 1):
            values = average[c, counted[c], quantity]
            row += [f"{values.mean():.2f}" if values.size else "none", _spread(values)]
            row.append(f"{paper[quantity]:.2f}" if paper else "")
        rows.append(tuple(row))
    caption = f"Maxima, {name}, mean of x, y and z: mean and standard deviation; the paper's means"
    header = ("", "angles off, mrad", "force, N", "std", "paper", "torque, N·m", "std", "paper")
    return Table(caption, header, tuple(rows))


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
    return {
        "mean": float(values.mean()) if values.size else None,
        "std": float(np.std(values, ddof=1)) if values.size > 1 else None,
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
        "tare": study.setup.controller.tare,
        "filter_delay": study.setup.controller.sensing.delay,
        "origin": study.arms.origin,
        "calibrations": [
            {
                "name": arm.name,
                "angle_error": arm.angle_error,
                "position": _moments(length[c, ..., 0]),
                "posture": _moments(length[c, ..., 1]),
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
            "angle_error": arm.angle_error,
            "seated": seated,
            "jammed": jammed,
            "false_contact": false_contact,
            "paper": _paper(docking.PAPER.get(arm.name)),
        }
        for quantity, name in enumerate(("force", "torque")):
            entry[name] = _moments(study.average[c, study.touched[c], quantity])
            entry[f"seen_{name}"] = _moments(study.average_seen[c, :, quantity])
        calibrations.append(entry)
    of = ("force", "torque")
    return {
        "format": "tdfscal-study-docking/1",
        "rig": study.setup.rig.name,
        "seed": study.seed,
        "runs": study.arms.runs,
        "tare": study.setup.controller.tare,
        "filter_delay": study.setup.controller.sensing.delay,
        "origin": study.arms.origin,
        "calibrations": calibrations,
        "ratios": _ratios(study, docking.PAPER, of),
        "ratios_seen": _ratios(study, docking.PAPER, of, seen=True),
        "note": DOCKING_NOTE,
        "files": files,
    }
