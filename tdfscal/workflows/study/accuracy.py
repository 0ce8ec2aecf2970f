"""`study accuracy`: Monte Carlo of both methods (Figs. 7–9, 12–14, Table 2)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.output_places import check_folder
from tdfscal.files.outputs import protect, together
from tdfscal.records import FloatArray
from tdfscal.reporting import stakes, studies
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.studies import Row
from tdfscal.simulation import Options
from tdfscal.studies.accuracy import Accuracy, Setup
from tdfscal.studies.accuracy import accuracy as simulate_accuracy
from tdfscal.workflows.arguments import at_least, one
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.inputs_read import inputs_read
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.rigs import calibrations_named, rig_named, survey_of
from tdfscal.workflows.study.result import StudyResult, processes


@dataclass(frozen=True, slots=True, repr=False)
class AccuracyResult(StudyResult):
    """Errors of both methods over simulated campaigns.

    stated : (n, 3), rad, standard uncertainties that given calibrations state, by name.

    """

    study: Accuracy
    stated: dict[str, FloatArray]

    def to_report(self) -> Report:
        """Return Table 2, and how given calibrations compare with it."""
        against = stakes.stated_against(self.study, self.stated)
        return studies.accuracy_report(self.study, against)

    def to_dict(self) -> dict[str, Any]:
        """Return the study as plain JSON values."""
        found = studies.accuracy_document(self.study, list(self.files))
        return found | {"calibrations": stakes.stated_document(self.study, self.stated)}

    def tables(self) -> dict[str, Iterable[Row]]:
        """Return standard deviations, histograms and every error."""
        return {
            "accuracy.csv": studies.accuracy_rows(self.study),
            "histograms.csv": studies.histogram_rows(self.study),
            "errors.csv": studies.error_rows(self.study),
        }

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the histograms of each sensor, and all standard deviations together."""
        from tdfscal.reporting.studyfigures import accuracy_drawings

        return accuracy_drawings(self.study)


@together()
def accuracy(
    rig: str | PathLike[str],
    *,
    output: str | PathLike[str] | None = None,
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
    TdfscalError
        By cause: UsageError, RigError, DataError.
    """
    folder = one(output)
    protect(inputs_read(rigs=[Path(rig)], files=paths_of(sources_of(calibration))))
    at_least("--runs", runs, 2)
    at_least("--postures", postures, 1)
    at_least("--seed", seed, 0)
    shared_by = processes(workers)
    loaded = rig_named(rig)
    named = calibrations_named(sources_of(calibration), loaded)
    stated = {name: c.rpy_std for name, c in named.items()}
    setup = Setup(
        rig=loaded.rig,
        options=Options(
            postures=postures, tilt=float(np.deg2rad(tilt)), squeeze=squeeze, stiffness=stiffness
        ),
        survey=survey_of(loaded, distance),
        runs=runs,
        seed=seed,
    )
    if folder is not None:
        check_folder(folder)
    study = simulate_accuracy(
        setup,
        workers=shared_by,
        progress=lambda done: progress.count(f"{done} of {runs} campaigns"),
    )
    return AccuracyResult(study, stated).saved(folder)
