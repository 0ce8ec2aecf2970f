"""`study accuracy`: Monte Carlo of both methods (Figs. 7–9, 12–14, Table 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.commands.result import (
    StudyResult,
    calibrations_named,
    check_runs,
    processes,
    start,
)
from studies.runs.accuracy import Accuracy, Setup
from studies.runs.accuracy import accuracy as simulate_accuracy
from tdfscal.files.outputs import together
from tdfscal.records import FloatArray
from tdfscal.simulation import Options
from tdfscal.workflows.arguments import PathLike, at_least
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.survey import survey_of


@dataclass(frozen=True, slots=True, repr=False)
class AccuracyResult(StudyResult):
    """Errors of both methods over simulated campaigns.

    stated : (n, 3), rad, standard uncertainties that given calibrations state, by name.
    """

    _name = "accuracy"
    study: Accuracy
    stated: dict[str, FloatArray]


@together()
def accuracy(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    calibration: CalibrationSource | Sequence[CalibrationSource] = (),
    runs: int = 1000,
    postures: int = 24,
    tilt: float = 5.0,
    squeeze: float = 200.0,
    stiffness: float = 20.0e6,
    distance: float = 5.0,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = SILENT,
) -> AccuracyResult:
    """Monte Carlo of self-calibration and laser tracker (Figs. 7–9, 12–14, Table 2).

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for tables and figures.
    calibration : what it is worth; one or several.
    runs : simulated campaigns per method.
    postures : of a campaign.
    tilt : degrees, largest tilt.
    squeeze : N, commanded internal forces.
    stiffness : N/m, of an NCP.
    distance : m, tracker to rig.
    seed : of all random numbers.
    workers : processes; default one per core.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError, DataError
    """
    check_runs(runs, seed, least=2)
    at_least("--postures", postures, 1)
    shared_by, sources = processes(workers), sources_of(calibration)
    loaded, folder = start(rig, output, *paths_of(sources))
    stated = {name: c.rpy_std for name, c in calibrations_named(sources, loaded).items()}
    setup = Setup(
        rig=loaded.rig,
        options=Options(
            postures=postures, tilt=float(np.deg2rad(tilt)), squeeze=squeeze, stiffness=stiffness
        ),
        survey=survey_of(loaded, distance),
        runs=runs,
        seed=seed,
    )
    study = simulate_accuracy(
        setup,
        workers=shared_by,
        progress=lambda done: progress.count(f"{done} of {runs} campaigns"),
    )
    return AccuracyResult(study, stated).saved(folder)
