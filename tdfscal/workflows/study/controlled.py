"""What the studies of the controlled rig share: calibrations at work, controller, files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self, get_args

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.files.writers.campaign import LogFormat, write_control_logs
from tdfscal.records import Log, Rig, Series
from tdfscal.simulation import Options
from tdfscal.simulation.control.contact import GearPair
from tdfscal.simulation.control.runs import Controller
from tdfscal.simulation.control.stability import designed, real_mass, require_stable
from tdfscal.studies.compared_calibrations import BEST, SQUEEZE, Arms, drifted, given, simulated
from tdfscal.studies.docking import DockingStudy
from tdfscal.studies.free_space import FreeSpaceStudy
from tdfscal.workflows.arguments import Numbers, at_least, numbers, one_of, triple
from tdfscal.workflows.calibration import CalibrationSource, paths_of, sources_of
from tdfscal.workflows.calibration_in_use import calibrated
from tdfscal.workflows.progress import Progress
from tdfscal.workflows.rigs import calibrations_named, survey_of
from tdfscal.workflows.study.result import StudyResult
from tdfscal.wrench.filtering import Walk, checked_walk

#: Filters that a controller can run.
FILTERS = ("low-pass", "kalman", "none")
#: Rotational over translational stiffness, damping or mass where one number is given, m².
_TURNS = 0.3
#: Hz, of records that are written as logs.
_LOG_RATE = 25.0

Study = DockingStudy | FreeSpaceStudy


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """The user's own cell: impedance, servos and gears; None: the study's choice.

    stiffness, damping, virtual_mass : of translations, or of translations and turns.
    servo : Hz. contact_stiffness : N/m of a tooth. clearance : mm. engagement : mm.
    """

    stiffness: Numbers | float | None = None
    damping: Numbers | float | None = None
    virtual_mass: Numbers | float | None = None
    servo: float | None = None
    contact_stiffness: float | None = None
    friction: float | None = None
    clearance: float | None = None
    engagement: float | None = None

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> Self:
        """Take of a study's options, by their names, those that are its own."""
        own = {f.name for f in fields(cls)}
        return cls(**{name: value for name, value in options.items() if name in own})

    def gears(self) -> GearPair:
        """Return the gears. Raises UsageError."""
        changes: dict[str, Any] = {}
        if (tooth := self.contact_stiffness) is not None:
            changes |= {"stiffness": tooth, "seat_stiffness": 2.0 * tooth}
        if self.friction is not None:
            changes["friction"] = self.friction
        if self.clearance is not None:
            changes["clearance"] = 1e-3 * self.clearance
        if self.engagement is not None:
            changes["length"] = 1e-3 * self.engagement
        return replace(GearPair(), **changes)

    def controller(self, rig: Rig, gears: GearPair) -> Controller:
        """Return the controller: as asked for, and the rest so that it is stable.

        Raises UsageError.
        """
        base = self._base()
        if self.servo is not None:
            base = replace(base, servo=replace(base.servo, bandwidth=self.servo))
        asked: dict[str, Any] = {
            name: _six(f"--{option}", value)
            for name, option, value in (
                ("stiffness", "stiffness", self.stiffness),
                ("damping", "damping", self.damping),
                ("mass", "virtual-mass", self.virtual_mass),
            )
            if value is not None
        }
        stiff = {k: v for k, v in asked.items() if k == "stiffness"}
        base = replace(base, impedance=replace(base.impedance, **stiff))
        if "damping" not in asked:
            base = designed(rig, base, gears, mass=asked.get("mass"))
        else:
            mass = asked.get("mass") or real_mass(rig, base)
            impedance = replace(base.impedance, mass=mass, damping=asked["damping"])
            base = replace(base, impedance=impedance)
        require_stable(rig, base, gears)
        return base

    def _base(self) -> Controller:
        return Controller()


def _six(option: str, value: Numbers | float) -> tuple[float, ...]:
    """Translations and turns of one number or two. Raises UsageError."""
    found = numbers(option, (value,) if isinstance(value, int | float) else value)
    if len(found) > 2 or min(found) <= 0.0:
        raise UsageError(
            f"{value!r} is not one or two numbers above zero",
            where=option,
            hint="give it for translations, or for translations and turns, as 1e4,3e3",
        )
    return (found[0],) * 3 + ((found[1],) * 3 if len(found) > 1 else (_TURNS * found[0],) * 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choices(Cell):
    """The options that the studies of the controlled rig share, under their own names."""

    calibration: CalibrationSource | Sequence[CalibrationSource]
    truth: CalibrationSource | None
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
        one_of("--logs", self.logs, get_args(LogFormat))

    @property
    def files(self) -> list[Path]:
        """The files among the calibrations and the truth."""
        return paths_of(sources_of(self.calibration, () if self.truth is None else self.truth))

    def _base(self) -> Controller:
        """The controller with the filter and the records that are asked for. Raises UsageError."""
        walk = checked_walk("kalman" if self.filter == "kalman" else "none", self.walk)
        base = Controller()
        if self.logs is not None:
            base = replace(base, trace_rate=_LOG_RATE, readings=True)
        if self.filter != "low-pass":
            sensing = base.sensing
            gain = 1.0
            if walk is not None:
                gain = Walk.of(walk, sensing.noise, 1.0 / sensing.rate).gain
            base = replace(base, sensing=replace(sensing, gain=gain))
        return base

    def arms(self, loaded: LoadedRig, progress: Progress) -> tuple[Arms, np.random.SeedSequence]:
        """Calibrations and machines, and the seed of the study itself. Raises TdfscalError."""
        arm_seed, study_seed = np.random.SeedSequence(self.seed).spawn(2)
        rng = np.random.default_rng(arm_seed)
        arms = self._given(loaded, rng) or self._simulated(loaded, rng, progress)
        if self.tare:
            each = tuple(replace(arm, tared=True) for arm in arms.arms)
            arms = replace(arms, arms=each, origin=f"{arms.origin}; all tare before each run")
        return (drifted(arms, self.drift, rng) if self.drift else arms), study_seed

    def _simulated(self, loaded: LoadedRig, rng: np.random.Generator, progress: Progress) -> Arms:
        if self.truth is not None:
            raise UsageError(
                "simulated calibrations have a truth of their own",
                where="--truth",
                hint="leave it out, or name calibrations with --calibration",
            )
        options = Options(squeeze=SQUEEZE)
        if self.mounting is not None:
            roll, pitch, yaw = triple("--mounting", self.mounting)
            options = replace(options, installation_std=(abs(roll), abs(pitch), abs(yaw)))
        progress.count(f"{self.runs} campaigns and surveys, simulated and calibrated")
        survey = survey_of(loaded)
        return simulated(
            loaded.rig, self.runs, rng, best=self.perfect, options=options, survey=survey
        )

    def _given(self, loaded: LoadedRig, rng: np.random.Generator) -> Arms | None:
        sources = sources_of(self.calibration)
        if not sources:
            return None
        if self.mounting is not None:
            raise UsageError(
                "given calibrations say how the sensors are mounted",
                where="--mounting",
                hint="leave it out, or leave --calibration out",
            )
        named = calibrations_named(sources, loaded, ("none", *BEST))
        each = [(name, calibrated(calibration, name)) for name, calibration in named.items()]
        truth = None
        if self.truth is not None:
            ((name, found),) = calibrations_named([self.truth], loaded).items()
            truth = name, calibrated(found, name)
        return given(loaded.rig, each, self.runs, rng, truth=truth, best=self.perfect)


def steps_of(progress: Progress, what: str) -> Callable[[float], None]:
    """Return what says each tenth of a simulation as it is done."""
    said = 0

    def tell(share: float) -> None:
        nonlocal said
        if int(10 * share) > said:
            said = int(10 * share)
            progress.count(f"{what}: {10 * said} %")

    return tell


class ControlledResult(StudyResult):
    """Base of the results of the controlled rig, whose motion can be written."""

    __slots__ = ()

    study: Study

    def with_logs(self, folder: Path | None, form: LogFormat | None) -> Self:
        """Write each run's log in this format into the folder's `logs`; None writes none."""
        if folder is None or form is None:
            return self
        return replace(self, files=(*self.files, *_logs(folder, self.study, form)))


def _logs(folder: Path, study: Study, form: LogFormat) -> list[str]:
    """One log per lane in the folder's `logs`."""
    rig = study.setup.rig
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
