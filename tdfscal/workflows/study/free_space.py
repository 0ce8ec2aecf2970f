"""`study free-space`: deviation of the terminal without contact (Table 4, Fig. 16)."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.files.outputs import together
from tdfscal.files.writers.campaign import LogFormat
from tdfscal.records import FloatArray
from tdfscal.studies import free_space as study_of
from tdfscal.workflows.arguments import Numbers, PathLike, at_least, one, one_of
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.study.controlled import (
    ControlledResult,
    compared_arms,
    filtering_controller,
    gear_pair,
    stable_controller,
    steps_of,
)
from tdfscal.workflows.study.result import check_runs, processes, start

_MOVES_HINT = (
    "write a header and 12 numbers per row: initial and target roll, pitch, yaw (rad), x, y, z (m)"
)


@dataclass(frozen=True, slots=True, repr=False)
class FreeSpaceResult(ControlledResult):
    """Deviations in free space."""

    _name = "free_space"
    study: study_of.FreeSpaceStudy


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
    TdfscalError
        By cause: UsageError, RigError, DataError.
    """
    check_runs(runs, seed)
    at_least("--drift", drift, 0)
    one_of("--logs", logs, get_args(LogFormat))
    base = filtering_controller(filter, walk, logs)
    shared_by = processes(workers)
    file = one(moves)
    loaded, folder = start(rig, output, *paths_of(sources_of(calibration, truth or ())), file)
    table = study_of.MOVES.copy() if file is None else read_moves(file)
    controller = stable_controller(
        loaded.rig, base, gear_pair(), stiffness, damping, virtual_mass, servo
    )
    setup = study_of.Setup(loaded.rig, controller=controller, moves=table)
    arms, study_seed = compared_arms(
        loaded, calibration, truth, runs, perfect, mounting, drift, tare, seed, progress
    )
    told = steps_of(progress, f"{len(table)} moves × {runs} runs × {len(arms.arms)} calibrations")
    study = study_of.free_space(setup, arms, study_seed, seed, workers=shared_by, progress=told)
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
