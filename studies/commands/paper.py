"""`study paper`: the paper's figures and tables against this rig's, in one table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from studies.commands.accuracy import AccuracyResult, accuracy
from studies.commands.assembly import DockingResult, FreeSpaceResult, docking, free_space
from studies.commands.result import StudyResult, start
from studies.commands.sensitivity import SensitivityResult, sensitivity
from studies.reports import paper as words
from tdfscal.files.outputs import together
from tdfscal.reporting.layout import Drawing
from tdfscal.workflows.arguments import PathLike
from tdfscal.workflows.progress import SILENT, Progress


@dataclass(frozen=True, slots=True, repr=False)
class PaperResult(StudyResult):
    """The paper's numbers beside this rig's, and the studies that they come from."""

    _name = "paper"
    sensitivity: SensitivityResult
    accuracy: AccuracyResult
    free_space: FreeSpaceResult
    docking: DockingResult
    seed: int

    def _content(self) -> tuple[Any, ...]:
        runs, campaigns = self.docking.study.arms.runs, self.accuracy.study.setup.runs
        items = (
            *words.sensitivity_items(self.sensitivity.sweeps[0]),
            *words.accuracy_items(self.accuracy.study),
            *words.free_space_items(self.free_space.study),
            *words.docking_items(self.docking.study),
        )
        return (words.Paper(self.sensitivity.rig.name, self.seed, runs, campaigns, items),)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figures of all four studies."""
        parts = (self.sensitivity, self.accuracy, self.free_space, self.docking)
        return tuple(drawing for part in parts for drawing in part.drawings())


@together()
def paper(
    rig: PathLike,
    *,
    output: PathLike | None = None,
    runs: int = 20,
    campaigns: int = 200,
    engagement: float | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress = SILENT,
) -> PaperResult:
    """Paper against here: Figs. 4, 7–9, 12–14, 16–18, Tables 2 and 3, in one table.

    Parameters
    ----------
    rig : rig.yaml, or its folder.
    output : folder for the table and all figures.
    runs : per calibration, in free space and docking.
    campaigns : simulated for the accuracy.
    engagement : mm, length of the engagement; default 333.
    seed : of all random numbers.
    workers : processes; default one per core.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError
    """
    _, folder = start(rig, output)
    shared: dict[str, Any] = {"seed": seed, "workers": workers, "progress": progress}
    return PaperResult(
        sensitivity(rig),
        accuracy(rig, runs=campaigns, **shared),
        free_space(rig, runs=runs, **shared),
        docking(rig, runs=runs, engagement=engagement, **shared),
        seed,
    ).saved(folder)
