"""`study sensitivity`: what each wrong angle costs (Fig. 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.commands.result import StudyResult, calibrations_named, start
from studies.runs.sensitivity import Stake, Sweep, stake
from studies.runs.sensitivity import sensitivity as sweep
from tdfscal.files.outputs import together
from tdfscal.records import Rig
from tdfscal.workflows.arguments import Numbers, PathLike, at_least, triple
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.progress import SILENT, Progress


@dataclass(frozen=True, slots=True, repr=False)
class SensitivityResult(StudyResult):
    """Contact wrench error against each angle. sweeps : by posture and squeeze.

    worth : what the given calibrations leave of it.
    """

    _name = "sensitivity"
    rig: Rig
    sweeps: list[Sweep]
    worth: dict[str, list[Stake]]


@together()
def sensitivity(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    calibration: CalibrationSource | Sequence[CalibrationSource] = (),
    rpy: Numbers | None = None,
    squeeze: float = 200.0,
    span: float = 0.05,
    seed: int = 0,
    progress: Progress = SILENT,
) -> SensitivityResult:
    """Contact force and torque error against each installation angle (Fig. 4).

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for tables and figures.
    calibration : what it is worth; one or several.
    rpy : rad, a posture beside the aligned one.
    squeeze : N, standard deviation of the internal forces.
    span : rad, sweep by ± this.
    seed : nothing here is random; every study takes one.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError, DataError
    """
    del seed, progress
    at_least("--squeeze", squeeze, 0)
    sources = sources_of(calibration)
    loaded, folder = start(rig, output, *paths_of(sources))
    record, named = loaded.rig, calibrations_named(sources, loaded)
    postures = [np.zeros(3)]
    if rpy is not None:
        postures.append(np.array(triple("--rpy", rpy)))
    forces = [0.0, squeeze] if squeeze > 0.0 else [0.0]
    sweeps = [
        sweep(record, posture, internal=internal, span=span)
        for posture in postures
        for internal in forces
    ]
    worth = {
        name: [stake(record, c.rotation, c.rotation_covariance, s.rpy, internal=s.internal)
               for s in sweeps]
        for name, c in named.items()
    }  # fmt: skip
    return SensitivityResult(record, sweeps, worth).saved(folder)
