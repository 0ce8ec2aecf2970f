"""`study cost`: what each way to calibrate costs, against the accuracy that it reaches."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, create_model

from studies.commands.result import StudyResult, check_runs, start
from studies.runs import cost as study_of
from studies.runs.cost import Assumptions
from tdfscal.errors import UsageError
from tdfscal.files.model_errors import checked
from tdfscal.files.outputs import together
from tdfscal.files.yaml.reading import read_document
from tdfscal.simulation import Options
from tdfscal.workflows.arguments import PathLike, at_least, one
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.survey import survey_of


@dataclass(frozen=True, slots=True, repr=False)
class CostResult(StudyResult):
    """Effort and error of each way to calibrate."""

    _name = "cost"
    study: study_of.CostStudy


@together()
def cost(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    assumptions: PathLike | None = None,
    runs: int = 10,
    squeeze: float = 200.0,
    distance: float = 5.0,
    seed: int = 0,
    progress: Progress = SILENT,
) -> CostResult:
    """Cost of self-calibration (static, moving), tracker and both, against their accuracy.

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for tables and figures.
    assumptions : YAML file of times and rates that differ from the usual ones.
    runs : simulated rigs of each.
    squeeze : N, commanded internal forces.
    distance : m, tracker to rig.
    seed : of all random numbers.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError
    """
    file = one(assumptions)
    check_runs(runs, seed)
    at_least("--squeeze", squeeze, 0)
    assumed = Assumptions() if file is None else read_assumptions(file)
    loaded, folder = start(rig, output, file)
    study = study_of.cost(
        loaded.rig,
        assumed,
        runs,
        seed,
        options=Options(squeeze=squeeze),
        survey=survey_of(loaded, distance),
        progress=progress.count,
    )
    return CostResult(study).saved(folder)


def read_assumptions(path: Path) -> Assumptions:
    """Numbers by the names of `Assumptions`; what is left out stays. Raises UsageError."""
    keys: Any = {f.name: (float, f.default) for f in fields(Assumptions)}
    model = create_model("Assumptions", __config__=ConfigDict(extra="forbid", strict=True), **keys)
    document = read_document(path, UsageError)
    if not isinstance(document.content, dict):
        raise UsageError(
            "holds no keys", where=str(path), hint=f"write lines such as `{next(iter(keys))}: 4.0`"
        )
    found = checked(model, document, UsageError)
    return Assumptions(**found.model_dump())
