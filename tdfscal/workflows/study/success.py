"""`study success`: does the assembly succeed, against the angle error and the contact stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tdfscal.files.outputs import together
from tdfscal.simulation.control.runs import Controller
from tdfscal.studies import docking
from tdfscal.studies import success as study_of
from tdfscal.workflows.arguments import Numbers, PathLike, at_least, numbers
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.study.controlled import gear_pair, stable_controller, steps_of
from tdfscal.workflows.study.result import StudyResult, check_runs, processes, start

#: Engagement by default, mm: the peaks are at the mouth, and the full length takes five times as
#: long.
ENGAGEMENT = 60.0


@dataclass(frozen=True, slots=True, repr=False)
class SuccessResult(StudyResult):
    """Assemblies that succeed."""

    _name = "success"
    study: study_of.SuccessStudy


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
    TdfscalError
        By cause: UsageError, RigError.
    """
    check_runs(runs, seed)
    shared_by = processes(workers)
    deviations: Sequence[float] = study_of.DEVIATIONS
    if errors is not None:
        deviations = tuple(1e-3 * v for v in numbers("--errors", errors))
        at_least("--errors", min(deviations), 0)
    loaded, folder = start(rig, output)
    gears = gear_pair(contact_stiffness, friction, clearance, engagement)
    study = study_of.success(
        docking.Setup(loaded.rig, gears=gears),
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
