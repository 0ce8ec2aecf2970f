"""`study sensitivity`: what each wrong angle costs (Fig. 4)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from tdfscal.files.output_places import check_folder
from tdfscal.files.outputs import protect, together
from tdfscal.records import Rig
from tdfscal.reporting import stakes, studies
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.studies import Row
from tdfscal.studies.sensitivity import Sweep
from tdfscal.studies.sensitivity import sensitivity as sweep
from tdfscal.studies.wrench_error import stake
from tdfscal.workflows.arguments import Numbers, at_least, one, triple
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.inputs_read import inputs_read
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.rigs import calibrations_named, rig_named
from tdfscal.workflows.study.result import StudyResult


@dataclass(frozen=True, slots=True, repr=False)
class SensitivityResult(StudyResult):
    """Contact wrench error against each angle. sweeps : by posture and squeeze.

    worth : what the given calibrations leave of it.
    """

    rig: Rig
    sweeps: list[Sweep]
    worth: stakes.Stakes

    def to_report(self) -> Report:
        """Return errors at the end of the sweep."""
        tables = stakes.stakes_tables(self.rig.supports, self.worth)
        return studies.sensitivity_report(self.rig.supports, self.sweeps, tables)

    def to_dict(self) -> dict[str, Any]:
        """Return the study as plain JSON values."""
        found = studies.sensitivity_document(
            self.rig.name, self.rig.supports, self.sweeps, list(self.files)
        )
        return found | {"calibrations": stakes.stakes_document(self.worth)}

    def tables(self) -> dict[str, Iterable[Row]]:
        """Return the sweeps, and what given calibrations are worth."""
        supports = self.rig.supports
        tables: dict[str, Iterable[Row]] = {
            "sensitivity.csv": studies.sensitivity_rows(supports, self.sweeps)
        }
        if self.worth:
            tables["calibrations.csv"] = stakes.stake_rows(supports, self.worth)
        return tables

    def drawings(self) -> tuple[Drawing, ...]:
        """Return one figure per posture and squeeze."""
        from tdfscal.reporting.studyfigures import sensitivity_drawing

        return tuple(
            sensitivity_drawing(self.rig.supports, one_of_them, _name(one_of_them))
            for one_of_them in self.sweeps
        )


@together()
def sensitivity(
    rig: str | PathLike[str],
    *,
    output: str | PathLike[str] | None = None,
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
    TdfscalError
        By cause: UsageError, RigError, DataError.
    """
    del seed, progress
    folder = one(output)
    protect(inputs_read(rigs=[Path(rig)], files=paths_of(sources_of(calibration))))
    at_least("--squeeze", squeeze, 0)
    loaded = rig_named(rig)
    record = loaded.rig
    named = calibrations_named(sources_of(calibration), loaded)
    postures = [np.zeros(3)]
    if rpy is not None:
        postures.append(np.array(triple("--rpy", rpy)))
    if folder is not None:
        check_folder(folder)
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


def _name(found: Sweep) -> str:
    name = "sensitivity-tilted" if np.any(found.rpy) else "sensitivity-aligned"
    return name + ("-squeezed" if found.internal > 0.0 else "")
