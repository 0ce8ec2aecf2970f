"""What the studies of the controlled rig share: calibrations at work, controller, files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.writers.campaign import LogFormat
from tdfscal.files.writers.control_logs import write_control_logs
from tdfscal.records import Log, Rig, Series
from tdfscal.reporting import controlstudies as words
from tdfscal.simulation import Options
from tdfscal.simulation.control.runs import Controller
from tdfscal.studies.compared_calibrations import MOUNTING, SQUEEZE, Arms, drifted, given, simulated
from tdfscal.workflows.arguments import Numbers, at_least, one_of, triple
from tdfscal.workflows.calibration import CalibrationSource
from tdfscal.workflows.calibration_in_use import calibrated
from tdfscal.workflows.progress import Progress
from tdfscal.workflows.rigs import calibrations_named, survey_of
from tdfscal.workflows.study.result import write_study
from tdfscal.wrench.filtering import Walk, checked_walk

if TYPE_CHECKING:
    from tdfscal.reporting.figures.style import Drawing

#: Tare, s, where the user asks for one.
TARE = 2.0
#: Rows of a lane in traces.csv at most, about.
_TRACE_ROWS = 600
#: Filters that a controller can run.
FILTERS = ("none", "kalman")


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices:
    """The options that the studies of the controlled rig share, under their own names."""

    calibration: Sequence[CalibrationSource]
    runs: int
    perfect: bool
    mounting: Numbers | None
    drift: float
    tare: bool
    filter: str
    walk: float | None
    logs: LogFormat | None
    seed: int

    def __post_init__(self) -> None:
        at_least("--runs", self.runs, 1)
        at_least("--drift", self.drift, 0)
        at_least("--seed", self.seed, 0)
        one_of("--filter", self.filter, FILTERS)
        if self.logs is not None:
            one_of("--logs", self.logs, get_args(LogFormat))

    def controller(self) -> Controller:
        """Return the controller that they ask for. Raises UsageError."""
        base = Controller(tare=TARE if self.tare else 0.0)
        walk = checked_walk(self.filter, self.walk)
        if walk is None:
            return base
        sensing = base.sensing
        model = Walk.of(walk, sensing.noise, 1.0 / sensing.rate)
        return replace(base, sensing=replace(sensing, gain=model.gain))

    def arms(self, loaded: LoadedRig, progress: Progress) -> tuple[Arms, np.random.SeedSequence]:
        """Calibrations and machines, and the seed of the study itself. Raises TdfscalError."""
        arm_seed, study_seed = np.random.SeedSequence(self.seed).spawn(2)
        rng = np.random.default_rng(arm_seed)
        arms = self._given(loaded, rng) or self._simulated(loaded, rng, progress)
        return (drifted(arms, self.drift, rng) if self.drift else arms), study_seed

    def _simulated(self, loaded: LoadedRig, rng: np.random.Generator, progress: Progress) -> Arms:
        mounting = MOUNTING
        if self.mounting is not None:
            roll, pitch, yaw = triple("--mounting", self.mounting)
            mounting = (abs(roll), abs(pitch), abs(yaw))
        progress.count(f"{self.runs} campaigns and surveys, simulated and calibrated")
        options = Options(squeeze=SQUEEZE, installation_std=mounting)
        survey = survey_of(loaded)
        return simulated(
            loaded.rig, self.runs, rng, best=self.perfect, options=options, survey=survey
        )

    def _given(self, loaded: LoadedRig, rng: np.random.Generator) -> Arms | None:
        if not self.calibration:
            return None
        if self.mounting is not None:
            raise UsageError(
                "given calibrations say how the sensors are mounted",
                where="--mounting",
                hint="leave it out, or leave --calibration out",
            )
        named = calibrations_named(self.calibration, loaded, ("none", "perfect"))
        each = [(name, calibrated(calibration, name)) for name, calibration in named.items()]
        return given(loaded.rig, each, self.runs, rng, best=self.perfect)


def write_controlled(
    folder: Path,
    tables: Mapping[str, Iterable[words.Row]],
    drawings: Iterable[Drawing],
    study: words.Study,
    logs: LogFormat | None,
) -> tuple[str, ...]:
    """Write tables, traces, figures and, where asked, each run's log; return their names."""
    each = -(-len(study.result.traces.time) // _TRACE_ROWS)
    files = write_study(folder, {**tables, "traces.csv": words.trace_rows(study, each)}, drawings)
    return (*files, *_logs(folder, study.setup.rig, study, logs))


def _logs(folder: Path, rig: Rig, study: words.Study, form: LogFormat | None) -> list[str]:
    """One log per lane in the folder's `logs`."""
    if form is None:
        return []
    traces = study.result.traces
    lanes = traces.contact.shape[1]
    per = lanes // len(study.names)
    logs = []
    for lane in range(lanes):
        log = Log(
            supports=rig.supports,
            position=tuple(Series(traces.time, traces.servo[:, lane, i]) for i in range(rig.n)),
            force=tuple(Series(traces.time, traces.reading[:, lane, i]) for i in range(rig.n)),
        )
        logs.append((f"{study.names[lane // per]}-{lane % per + 1:02d}", log))
    return [f"logs/{name}" for name in write_control_logs(folder / "logs", rig, logs, form)]
