"""`simulate`: a synthetic campaign with its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from tdfscal.errors import UsageError
from tdfscal.files.output_places import check_folder
from tdfscal.files.outputs import protect, together
from tdfscal.files.rig.reading import load_rig
from tdfscal.files.writers.campaign import LogFormat, simulate_to_folder
from tdfscal.reporting.layout import Drawing
from tdfscal.simulation import Recorder, Run
from tdfscal.workflows.arguments import PathLike, at_least, one_of
from tdfscal.workflows.progress import SILENT, Progress
from tdfscal.workflows.result import Result, by_angle
from tdfscal.workflows.survey import survey_of

#: Samples per second that a recorder can have.
RATES = (10.0, 20e3)


@dataclass(frozen=True, slots=True, repr=False)
class SimulateResult(Result):
    """A campaign folder that was written. run : what was simulated, with its truth."""

    folder: Path
    run: Run
    seed: int

    @property
    def text(self) -> str:
        """What to do with it."""
        verb = "monitor" if self.run.scenario == "months" else "calibrate"
        return f"wrote {self.folder}: now run  tdfscal {verb} {self.folder}\n"

    def to_dict(self) -> dict[str, Any]:
        """Return where what was written."""
        return {
            "folder": str(self.folder),
            "scenario": self.run.scenario,
            "rig": self.run.rig.name,
            "seed": self.seed,
            "truth": str(self.folder / "truth.yaml"),
        }

    def table(self) -> dict[str, Any]:
        """One row per angle: support, angle, its true value, in rad."""
        return by_angle(self.run.rig.supports, value=self.run.truth.rpy)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the true turns from the nominal mounting."""
        from tdfscal.reporting.figures.angles import truth

        rig = self.run.rig
        return (truth(rig.supports, self.run.truth.rpy, rig.nominal_rpy),)


@together()
def simulate(
    folder: PathLike,
    *,
    rig: PathLike | None = None,
    scenario: str = "self",
    format: LogFormat = "csv",
    postures: int = 24,
    tilt: float = 5.0,
    squeeze: float = 200.0,
    rate: float = 100.0,
    months: int = 12,
    seed: int = 0,
    force: bool = False,
    progress: Progress = SILENT,
) -> SimulateResult:
    """Write a synthetic campaign with its truth.yaml.

    Parameters
    ----------
    folder : campaign folder to write.
    rig : rig.yaml; default the reference rig.
    scenario : self, tracker, months, motion, approach, stops, or a fault.
    format : of the log: csv, parquet or mcap.
    postures : number of them.
    tilt : degrees, largest tilt.
    squeeze : N, commanded internal forces.
    rate : samples per second of all signals.
    months : number of campaigns of the scenario "months", a folder each.
    seed : of all random numbers.
    force : replace the campaign that stands in the folder.
    progress : called as the work goes on.

    Raises
    ------
    UsageError, RigError, NotConvergedError
    """
    scenario = scenario.lower()
    check_folder(Path(folder))
    one_of("--format", format, get_args(LogFormat))
    at_least("--postures", postures, 1)
    at_least("--months", months, 1)
    if not RATES[0] <= rate <= RATES[1]:
        raise UsageError(
            f"{rate:g} Hz is no rate of a recorder",
            where="--rate",
            hint=f"give {RATES[0]:g} to {RATES[1]:g}",
        )
    protect([Path(rig)] if rig else [])
    loaded = load_rig(Path(rig)) if rig else None
    progress.stage(f"simulating {postures} postures")
    played = simulate_to_folder(
        Path(folder),
        loaded.rig if loaded else None,
        scenario,
        survey=survey_of(loaded) if loaded else None,
        recorder=Recorder(force_rate=rate, position_rate=rate),
        format=format,
        postures=postures,
        tilt_deg=tilt,
        squeeze=squeeze,
        months=months,
        seed=seed,
        overwrite=force,
    )
    return SimulateResult(Path(folder), played, seed)
