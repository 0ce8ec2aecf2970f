"""`study free-space`, `docking`, `success`: the calibrations at work in a controller.

Deviation without contact (Table 4, Fig. 16), contact while the gears are docked (Figs. 17 and 18),
and whether the assembly succeeds.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from studies.commands.controlled import (
    compared_arms,
    filtering_controller,
    gear_pair,
    stable_controller,
    steps_of,
)
from studies.commands.result import StudyResult, check_runs, processes, start
from studies.control.runs import Controller
from studies.runs import docking as docking_study
from studies.runs import free_space as free_space_study
from studies.runs import success as success_study
from tdfscal.errors import UsageError
from tdfscal.files.outputs import together
from tdfscal.files.writers.campaign import LogFormat, write_control_logs
from tdfscal.records import FloatArray, Log, Series
from tdfscal.workflows.arguments import Numbers, PathLike, at_least, numbers, one
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.progress import SILENT, Progress

_MOVES_HINT = (
    "write a header and 12 numbers per row: initial and target roll, pitch, yaw (rad), x, y, z (m)"
)
#: Engagement by default, mm: the peaks are at the mouth, and the full length takes five times as
#: long.
ENGAGEMENT = 60.0


class ControlledResult(StudyResult):
    """Base of the results of the controlled rig, whose motion can be written."""

    __slots__ = ()

    study: docking_study.DockingStudy | free_space_study.FreeSpaceStudy

    def with_logs(self, folder: Path | None, form: LogFormat | None) -> Self:
        """Write each run's log in this format into the folder's `logs`; None writes none."""
        if folder is None or form is None:
            return self
        rig, traces = self.study.setup.rig, self.study.result.traces
        lanes = traces.contact.shape[1]
        per = lanes // len(self.study.names)
        logs = []
        for lane in range(lanes):
            servo, reading = traces.servo[:, lane], traces.reading[:, lane]
            log = Log(
                supports=rig.supports,
                position=tuple(Series(traces.time, servo[:, i]) for i in range(rig.n)),
                force=tuple(Series(traces.time, reading[:, i]) for i in range(rig.n)),
            )
            logs.append((f"{self.study.names[lane // per]}-{lane % per + 1:02d}", log))
        written = write_control_logs(folder / "logs", rig, logs, form)
        return replace(self, files=(*self.files, *(f"logs/{name}" for name in written)))


@dataclass(frozen=True, slots=True, repr=False)
class FreeSpaceResult(ControlledResult):
    """Deviations in free space."""

    _name = "free_space"
    study: free_space_study.FreeSpaceStudy


@together()
def free_space(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    calibration: CalibrationSource | Sequence[CalibrationSource] = (),
    truth: CalibrationSource | None = None,
    runs: int = 20,
    moves: PathLike | None = None,
    perfect: bool = True,
    mounting: Numbers | None = None,
    drift: float = 0.0,
    tare: bool = False,
    filter: str = "low-pass",
    walk: float | None = None,
    logs: LogFormat | None = None,
    stiffness: Numbers | float | None = None,
    damping: Numbers | float | None = None,
    virtual_mass: Numbers | float | None = None,
    servo: float | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = SILENT,
) -> FreeSpaceResult:
    """Deviation of the terminal in free space under impedance control (Table 4, Fig. 16).

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for tables and figures.
    calibration : two or more, or one and a truth; default all methods, simulated.
    truth : calibration from which the truth is drawn; default the combination of all given.
    runs : per calibration.
    moves : CSV of moves instead of the six stated.
    perfect : also the best that any calibration could do.
    mounting : rad, simulated mounting: std of roll, pitch, yaw; default 0.02, 0.02, 0.05.
    drift : N, std of the zeros' drift since the calibration.
    tare : all tare the wrench at the start.
    filter : of the sensors, low-pass, kalman or none.
    walk : N, what a force may walk by in 1 s, for kalman.
    logs : write each run's log, in this format.
    stiffness, damping, virtual_mass : of the impedance, for translations (N/m, N·s/m, kg) or also
        turns (N·m/rad, N·m·s/rad, kg m²); default 10 kN/m, the least stable damping, the real mass.
    servo : Hz, bandwidth of the NCPs' servos; default 15.
    workers : processes; default one per core.
    seed : of all random numbers.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError, DataError
    """
    check_runs(runs, seed)
    base = filtering_controller(filter, walk, logs)
    shared_by = processes(workers)
    file = one(moves)
    loaded, folder = start(rig, output, *paths_of(sources_of(calibration, truth or ())), file)
    table = free_space_study.MOVES.copy() if file is None else read_moves(file)
    controller = stable_controller(
        loaded.rig, base, gear_pair(), stiffness, damping, virtual_mass, servo
    )
    setup = free_space_study.Setup(loaded.rig, controller=controller, moves=table)
    arms, study_seed = compared_arms(
        loaded, calibration, truth, runs, perfect, mounting, drift, tare, seed, progress
    )
    told = steps_of(progress, f"{len(table)} moves × {runs} runs × {len(arms.arms)} calibrations")
    study = free_space_study.free_space(
        setup, arms, study_seed, seed, workers=shared_by, progress=told
    )
    return FreeSpaceResult(study).saved(folder).with_logs(folder, logs)


def read_moves(path: Path) -> FloatArray:
    """Moves (M, 2, 6) from CSV: initial and target roll, pitch, yaw (rad) and x, y, z (m, from
    home), one move per row under a header. Raises UsageError.
    """
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.reader(stream) if row][1:]
        moves = np.array([[float(cell) for cell in row] for row in rows])
    except OSError as fault:
        raise UsageError("cannot be read", where=str(path), hint="name a CSV file") from fault
    except ValueError as fault:
        raise UsageError(
            f"holds no table of numbers: {fault}", where=str(path), hint=_MOVES_HINT
        ) from fault
    if moves.ndim != 2 or moves.shape[1] != 12 or not np.all(np.isfinite(moves)):
        raise UsageError("is no table of moves", where=str(path), hint=_MOVES_HINT)
    return moves.reshape(-1, 2, 6)


@dataclass(frozen=True, slots=True, repr=False)
class DockingResult(ControlledResult):
    """Contact while docking."""

    _name = "docking"
    study: docking_study.DockingStudy


@together()
def docking(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    calibration: CalibrationSource | Sequence[CalibrationSource] = (),
    truth: CalibrationSource | None = None,
    runs: int = 20,
    engagement: float | None = None,
    perfect: bool = True,
    mounting: Numbers | None = None,
    drift: float = 0.0,
    tare: bool = False,
    filter: str = "low-pass",
    walk: float | None = None,
    logs: LogFormat | None = None,
    stiffness: Numbers | float | None = None,
    damping: Numbers | float | None = None,
    virtual_mass: Numbers | float | None = None,
    servo: float | None = None,
    contact_stiffness: float | None = None,
    friction: float | None = None,
    clearance: float | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = SILENT,
) -> DockingResult:
    """Contact force and torque while the gears are docked (Figs. 17 and 18).

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for tables and figures.
    engagement : mm, length of the engagement; default 333.
    contact_stiffness : N/m of a tooth on what carries it. friction : coefficient.
    clearance : mm, radial.
    calibration, truth, runs, perfect, mounting, drift, tare, filter, walk, logs, seed, workers,
    stiffness, damping, virtual_mass, servo : as of `free_space`.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError, DataError
    """
    check_runs(runs, seed)
    base = filtering_controller(filter, walk, logs)
    shared_by = processes(workers)
    loaded, folder = start(rig, output, *paths_of(sources_of(calibration, truth or ())))
    gears = gear_pair(contact_stiffness, friction, clearance, engagement)
    controller = stable_controller(loaded.rig, base, gears, stiffness, damping, virtual_mass, servo)
    setup = docking_study.Setup(loaded.rig, controller=controller, gears=gears)
    arms, study_seed = compared_arms(
        loaded, calibration, truth, runs, perfect, mounting, drift, tare, seed, progress
    )
    told = steps_of(progress, f"docking, {runs} runs × {len(arms.arms)} calibrations")
    study = docking_study.docking(setup, arms, study_seed, seed, workers=shared_by, progress=told)
    return DockingResult(study).saved(folder).with_logs(folder, logs)


@dataclass(frozen=True, slots=True, repr=False)
class SuccessResult(StudyResult):
    """Assemblies that succeed."""

    _name = "success"
    study: success_study.SuccessStudy


@together()
def success(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    runs: int = 20,
    errors: Numbers | None = None,
    engagement: float = ENGAGEMENT,
    stiffness: Numbers | float | None = None,
    damping: Numbers | float | None = None,
    virtual_mass: Numbers | float | None = None,
    servo: float | None = None,
    contact_stiffness: float | None = None,
    friction: float | None = None,
    clearance: float | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = SILENT,
) -> SuccessResult:
    """Probability that the assembly succeeds, against the angle error and the contact stiffness.

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for tables and figures.
    runs : of each angle error and stiffness.
    errors : mrad, standard deviations of a sensor's turn about each axis.
    engagement : mm, length of the engagement.
    stiffness, damping, virtual_mass, servo : as of `free_space`.
    contact_stiffness : N/m of a tooth on what carries it; the middle of two decades.
    friction : coefficient. clearance : mm, radial.
    seed : of all random numbers.
    workers : processes; default one per core.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError
    """
    check_runs(runs, seed)
    shared_by = processes(workers)
    deviations: Sequence[float] = success_study.DEVIATIONS
    if errors is not None:
        deviations = tuple(1e-3 * v for v in numbers("--errors", errors))
        at_least("--errors", min(deviations), 0)
    loaded, folder = start(rig, output)
    gears = gear_pair(contact_stiffness, friction, clearance, engagement)
    study = success_study.success(
        docking_study.Setup(loaded.rig, gears=gears),
        lambda gears: stable_controller(
            loaded.rig, Controller(), gears, stiffness, damping, virtual_mass, servo
        ),
        runs,
        seed,
        deviations=deviations,
        workers=shared_by,
        progress=steps_of(progress, f"docking, {runs} runs of each angle error and stiffness"),
    )
    return SuccessResult(study).saved(folder)
