"""`study docking`: contact while the gears are docked (Figs. 17 and 18)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

from tdfscal.files.outputs import together
from tdfscal.files.writers.campaign import LogFormat
from tdfscal.studies import docking as study_of
from tdfscal.workflows.arguments import Numbers, PathLike, at_least, one_of
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


@dataclass(frozen=True, slots=True, repr=False)
class DockingResult(ControlledResult):
    """Contact while docking."""

    _name = "docking"
    study: study_of.DockingStudy


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
    TdfscalError
        By cause: UsageError, RigError, DataError.
    """
    check_runs(runs, seed)
    at_least("--drift", drift, 0)
    one_of("--logs", logs, get_args(LogFormat))
    base = filtering_controller(filter, walk, logs)
    shared_by = processes(workers)
    loaded, folder = start(rig, output, *paths_of(sources_of(calibration, truth or ())))
    gears = gear_pair(contact_stiffness, friction, clearance, engagement)
    controller = stable_controller(loaded.rig, base, gears, stiffness, damping, virtual_mass, servo)
    setup = study_of.Setup(loaded.rig, controller=controller, gears=gears)
    arms, study_seed = compared_arms(
        loaded, calibration, truth, runs, perfect, mounting, drift, tare, seed, progress
    )
    told = steps_of(progress, f"docking, {runs} runs × {len(arms.arms)} calibrations")
    study = study_of.docking(setup, arms, study_seed, seed, workers=shared_by, progress=told)
    return DockingResult(study).saved(folder).with_logs(folder, logs)
