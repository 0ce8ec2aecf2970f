"""`simulate`: a synthetic campaign with its truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

from tdfscal.commands import options
from tdfscal.commands.campaign import PathLike, rig_file
from tdfscal.commands.options import Option, silent
from tdfscal.commands.result import CommandResult, by_column, each_angle
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.writers.campaign import SQUEEZE, check_folder, simulate_to_folder
from tdfscal.files.writers.logs import LogFormat
from tdfscal.files.yaml import as_path
from tdfscal.frozen import record
from tdfscal.reporting.layout import document
from tdfscal.simulation import MOVING, SCENARIOS, Recorder, Run, SurveyOptions

#: What the help says of the scenarios.
_SCENARIOS = (
    f"what to simulate: self, tracker, months, {', '.join(MOVING)}; or with a fault: "
    + ", ".join(name for name in SCENARIOS if name not in ("self", "tracker"))
)


@record(eq=False)
class SimulateResult(CommandResult):
    """A campaign folder that was written. run : what was simulated, with its truth."""

    folder: Path
    run: Run
    seed: int

    @property
    def text(self) -> str:
        """What to do with it."""
        verb = "monitor" if self.run.scenario == "months" else "calibrate"
        return f"wrote {self.folder}: now run  tdfscal {verb} {self.folder}\n"

    @property
    def kept(self) -> bool:
        """The folder is written."""
        return True

    def document(self) -> dict[str, Any]:
        """Return where what was written."""
        names = "folder scenario=run.scenario rig=run.rig.name seed"
        return document(self, names, truth=self.folder / "truth.yaml")

    def table(self) -> dict[str, Any]:
        """One row per angle: support, angle, its true value, in rad."""
        rows = each_angle(self.run.rig.supports, self.run.truth.rpy)
        return by_column("support angle value", rows)


@options.command("simulate campaign --scenario contact")
def simulate(
    folder: Annotated[PathLike, Option("campaign folder to write", Path, "DIR")],
    *,
    rig: Annotated[
        PathLike | None, Option("a rig.yaml; default the reference rig", Path | None, "FILE")
    ] = None,
    scenario: Annotated[str, Option(_SCENARIOS, metavar="NAME")] = "self",
    format: Annotated[LogFormat, Option("format of the log")] = "csv",
    postures: Annotated[int, Option("number of postures", least=1, below=10_001)] = 24,
    tilt: Annotated[float, Option("largest tilt, degrees", least=0, below=46)] = 5.0,
    squeeze: Annotated[
        float, Option("commanded internal forces, N", metavar="N", least=0)
    ] = SQUEEZE,
    rate: Annotated[
        float, Option("samples per second of all signals", least=10.0, below=20_001.0)
    ] = 100.0,
    months: Annotated[int, Option("campaigns of the scenario months", least=1, below=1201)] = 12,
    seed: Annotated[
        int, Option("seed of all random numbers: one seed, one rig in all scenarios", least=0)
    ] = 0,
    progress: options.Telling = silent,
) -> SimulateResult:
    """Write a synthetic campaign with its truth.yaml."""
    scenario = scenario.lower()
    check_folder(as_path(folder))
    loaded = rig_file(rig) if rig is not None else None
    progress(f"simulating {postures} postures")
    played = simulate_to_folder(
        Path(folder),
        loaded.rig if loaded else None,
        scenario,
        survey=survey_of(loaded) if loaded else None,
        recorder=Recorder(force_rate=rate, position_rate=rate),
        format=format,
        postures=postures,
        tilt=math.radians(tilt),
        squeeze=squeeze,
        months=months,
        seed=seed,
    )
    return SimulateResult(Path(folder), played, seed)


def survey_of(loaded: LoadedRig) -> SurveyOptions:
    """Take the survey that the rig file declares, or the paper's."""
    if (stated := loaded.tracker) is None:
        return SurveyOptions()
    return SurveyOptions(
        instrument=stated.instrument.record(),
        drawing=stated.drawing,
        body_misalignment=stated.misalignment,
    )
