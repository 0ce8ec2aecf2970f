"""What a calibration does to an assembly: docking of the gears (Sect. 5.2, Figs. 17 and 18)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar, cast

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.simulation import SurveyOptions
from tdfscal.simulation.control.contact import Bore, GearPair
from tdfscal.simulation.control.reference import advance, require_within
from tdfscal.simulation.control.runs import Controller, Docking, Result
from tdfscal.simulation.equilibrium import Pose
from tdfscal.simulation.survey import GearSurvey, survey_error
from tdfscal.studies.compared_calibrations import LIKE, Arms
from tdfscal.studies.lanes import machines_of, simulate_lanes
from tdfscal.studies.ratios import Ratio, Share, ratio, share

_A = TypeVar("_A", FloatArray, BoolArray)
#: Path beyond the planned seat, m: the seat is felt, not known.
_ON = 0.01
#: Depth that the controller may lack when it takes a threshold for the seat, m.
_SHORT = 0.002
#: The paper's averages of the maxima, N and N·m, over its calibrations.
_PUBLISHED = {"none": (8.41, 5.22), "tracker": (6.58, 3.89), "self": (4.19, 3.03)}
#: The same beside the arms that are like them.
PAPER = {arm: _PUBLISHED[name] for arm, name in LIKE.items()}


@dataclass(frozen=True, slots=True)
class Setup:
    """A docking: gap, m, before contact; speed, m/s; ramp, s; home, LCS origin at the start, BCS;
    travel : m, of each NCP about home; survey and gear : how the outer gear was measured.
    """

    rig: Rig
    controller: Controller = field(default_factory=Controller)
    gears: GearPair = field(default_factory=GearPair)
    gap: float = 0.05
    speed: float = 1.5e-3
    ramp: float = 5.0
    home: tuple[float, float, float] = (0.05, -0.03, 1.2)
    travel: tuple[float, float, float] = (0.25, 0.25, 0.5)
    survey: SurveyOptions = field(default_factory=SurveyOptions)
    gear: GearSurvey = field(default_factory=GearSurvey)


@dataclass(frozen=True, slots=True)
class DockingStudy:
    """C calibrations, N runs each.

    misalignment : (N, 6), of the plan against the bore: m at the tip, rad. peak : (C, N, 6),
    largest |contact wrench| from first contact to the seat, N, and N·m about the LCS origin, LCS.
    length : (C, N, 2), the same of the vectors' lengths. seen : (C, N, 6), largest |wrench| that
    the controller saw from the start to the seat, or until it stopped.
    """

    setup: Setup
    arms: Arms
    seed: int
    misalignment: FloatArray
    peak: FloatArray
    length: FloatArray
    seen: FloatArray
    result: Result

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the calibrations."""
        return self.arms.names

    @property
    def succeeded(self) -> BoolArray:
        """(C, N): seated, and no true force before beyond its limit along any axis."""
        limits = np.asarray(self.setup.controller.thresholds)
        return np.asarray(self.seated & np.all(self.peak[..., :3] <= limits, axis=-1))

    def success(self, c: int) -> Share:
        """Runs of a calibration that succeeded, with the interval of their probability."""
        return share(self.succeeded[c])

    @property
    def average(self) -> FloatArray:
        """(C, N, 2): mean of the maxima along x, y and z, of force (N) and torque (N·m)."""
        return _by_direction(self.peak)

    @property
    def average_seen(self) -> FloatArray:
        """(C, N, 2): the same as the controller saw them."""
        return _by_direction(self.seen)

    def ratio(self, quantity: int, of: str, to: str, *, seen: bool = False) -> Ratio:
        """Ratio of average maxima, 0 force, 1 torque, with its standard error over the runs
        in which both made contact; seen : as the controller saw them.
        """
        i, j = self.names.index(of), self.names.index(to)
        both = self.touched[i] & self.touched[j]
        values = self.average_seen if seen else self.average
        return ratio(*values[[i, j]][:, both, quantity])

    @property
    def touched(self) -> BoolArray:
        """(C, N): contact was made; without it the controller stopped at a false force."""
        return self.grid(np.isfinite(self.result.phase_start[1]))

    @property
    def seated(self) -> BoolArray:
        """(C, N): stopped at depth."""
        return self.grid(self.result.seated)

    @property
    def jammed(self) -> BoolArray:
        """(C, N): stopped before."""
        return self.grid(self.result.jammed)

    def outcome(self, c: int, run: int) -> str:
        """How a run ended, in words."""
        if self.seated[c, run]:
            return "seated"
        if self.jammed[c, run]:
            return "jammed" if self.touched[c, run] else "false contact"
        return "not finished"

    def grid(self, values: _A) -> _A:
        """Values of the lanes (L, …) as (C, N, …)."""
        shape = (len(self.names), self.arms.runs, *values.shape[1:])
        return cast("_A", values.reshape(shape))


def _by_direction(peak: FloatArray) -> FloatArray:
    return np.asarray(peak.reshape(*peak.shape[:2], 2, 3).mean(axis=-1))


@dataclass(frozen=True, slots=True)
class _Plan:
    """Where the shaft is driven: start and goal (N,), way, m; mouth : (3,), m, BCS, of the bore;
    misalignment : (N, 6), of the plan against it, m at the tip, rad.
    """

    start: Pose
    goal: Pose
    way: float
    mouth: FloatArray
    misalignment: FloatArray


def _plan(setup: Setup, runs: int, rng: np.random.Generator) -> _Plan:
    """Plan the way by a survey of the outer gear. Raises UsageError where it leaves the travel."""
    home, tip = np.asarray(setup.home), np.asarray(setup.gears.tip)
    mouth = home + tip + np.array([0.0, 0.0, setup.gap])
    turn, shift = survey_error(setup.rig, setup.survey, setup.gear, mouth, home, runs, rng)
    impedance = setup.controller.impedance
    # The impedance lags by B v / K, and presses its threshold of force on the seat.
    lag = setup.speed * impedance.damping[2] / impedance.stiffness[2]
    way = setup.gap + setup.gears.length + _ON + lag
    start, goal = (
        Pose(turn, mouth + shift + turn @ (np.array([0.0, 0.0, s]) - tip))
        for s in (-setup.gap, way - setup.gap)
    )
    for pose, what in ((start, "start posture of run"), (goal, "end posture of run")):
        require_within(setup.rig, pose, setup.home, setup.travel, what)
    bore = Bore(np.repeat(np.eye(3)[None], runs, axis=0), np.repeat(mouth[None], runs, axis=0))
    return _Plan(start, goal, way, mouth, bore.coordinates(mouth + shift, turn))


def docking(
    setup: Setup,
    arms: Arms,
    seed: np.random.SeedSequence,
    number: int,
    *,
    workers: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> DockingStudy:
    """Dock once per calibration and run; a run's draws (rig, survey, positioning errors, noise) are
    the same for all calibrations. number : the seed as the user gave it. workers : processes; they
    change no number.

    Raises
    ------
    UsageError : the way leaves the NCPs' travel, or the loop is unstable.
    """
    rig, gears, runs = setup.rig, setup.gears, arms.runs
    if not (0.0 < setup.gap < np.inf and 0.0 < setup.speed < np.inf and setup.ramp > 0.0):
        raise UsageError("gap, speed and ramp must be above zero")
    survey_seed, *machine_seeds = seed.spawn(3)
    plan = _plan(setup, runs, np.random.default_rng(survey_seed))
    copies = len(arms.arms)
    lanes = copies * runs
    start, goal = (
        Pose(np.tile(p.rotation, (copies, 1, 1)), np.tile(p.translation, (copies, 1)))
        for p in (plan.start, plan.goal)
    )
    reference = advance(
        start, goal, way=plan.way, speed=setup.speed, ramp=setup.ramp, step=setup.controller.step
    )
    bore = Bore(
        np.repeat(np.eye(3)[None], lanes, axis=0), np.repeat(plan.mouth[None], lanes, axis=0)
    )
    result = simulate_lanes(
        machines_of(rig, setup.controller.servo, arms, machine_seeds),
        setup.controller,
        reference,
        Docking(gears, bore, setup.gap + gears.length - _SHORT),
        workers=workers,
        progress=progress,
    )
    before = slice(1, 3)
    return DockingStudy(
        setup=setup,
        arms=arms,
        seed=number,
        misalignment=plan.misalignment,
        peak=result.peak[before].max(axis=0).reshape(copies, runs, 6),
        length=result.peak_length[before].max(axis=0).reshape(copies, runs, 2),
        seen=result.peak_measured[:3].max(axis=0).reshape(copies, runs, 6),
        result=result,
    )
