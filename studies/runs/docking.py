"""What a calibration does to an assembly: docking of the gears (Sect. 5.2, Figs. 17 and 18)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from studies.control.contact import GearPair
from studies.control.reference import advance, require_within
from studies.control.runs import Controller, Docking
from studies.runs.compared_calibrations import LIKE, Arms
from studies.runs.lanes import ControlStudy, simulate_lanes
from studies.runs.ratios import Share, share
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.simulation import SurveyOptions
from tdfscal.simulation.equilibrium import Pose
from tdfscal.simulation.survey import survey_error

#: Path beyond the planned seat, m: the seat is felt, not known.
_ON = 0.01
#: Depth that the controller may lack when it takes a threshold for the seat, m.
_SHORT = 0.002
#: What is compared: true, and as the controller saw it.
QUANTITIES = ("force", "torque", "seen_force", "seen_torque")
#: The paper's averages of the maxima, N and N·m, over its calibrations.
_PUBLISHED = {"none": (8.41, 5.22), "tracker": (6.58, 3.89), "self": (4.19, 3.03)}
#: The same beside the arms that are like them.
PAPER = {arm: _PUBLISHED[name] for arm, name in LIKE.items()}


@dataclass(frozen=True, slots=True)
class Setup:
    """A docking: gap, m, before contact; speed, m/s; ramp, s; home, LCS origin at the start, BCS;
    travel : m, of each NCP about home.
    """

    rig: Rig
    controller: Controller = field(default_factory=Controller)
    gears: GearPair = field(default_factory=GearPair)
    gap: float = 0.05
    speed: float = 1.5e-3
    ramp: float = 5.0
    home: tuple[float, float, float] = (0.05, -0.03, 1.2)
    travel: tuple[float, float, float] = (0.25, 0.25, 0.5)


@dataclass(frozen=True, slots=True)
class DockingStudy(ControlStudy):
    """Every machine docked once with each calibration."""

    setup: Setup

    @property
    def peak(self) -> FloatArray:
        """(C, N, 6): largest |contact wrench| from first contact to the seat, N, and N·m about the
        LCS origin, LCS.
        """
        return self.grid(self.result.peak[:, 1:3].max(axis=1))

    @property
    def length(self) -> FloatArray:
        """(C, N, 2): the same of the vectors' lengths."""
        return self.grid(self.result.peak_length[:, 1:3].max(axis=1))

    @property
    def seen(self) -> FloatArray:
        """(C, N, 6): largest |wrench| that the controller saw from the start to the seat, or until
        it stopped.
        """
        return self.grid(self.result.peak_measured[:, :3].max(axis=1))

    @property
    def succeeded(self) -> BoolArray:
        """(C, N): seated, and no true force before beyond its limit along any axis."""
        limits = np.asarray(self.setup.controller.thresholds)
        return np.asarray(self.seated & np.all(self.peak[..., :3] <= limits, axis=-1))

    def success(self, c: int) -> Share:
        """Runs of a calibration that succeeded, with the interval of their probability."""
        return share(self.succeeded[c])

    def sample(self, quantity: int) -> FloatArray:
        """(C, N): mean of the maxima along x, y and z of `QUANTITIES`, N and N·m, of runs that made
        contact.
        """
        peak = self.seen if quantity > 1 else self.peak
        part = peak[..., :3] if quantity % 2 == 0 else peak[..., 3:]
        return np.where(self.touched, part.mean(axis=-1), np.nan)

    @property
    def starts(self) -> FloatArray:
        """(C, N, 4), s: of each phase; NaN where it was not reached."""
        return self.grid(self.result.phase_start)

    @property
    def touched(self) -> BoolArray:
        """(C, N): contact was made; without it the controller stopped at a false force."""
        return np.isfinite(self.starts[..., 1])

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
    rig, gears, controller = setup.rig, setup.gears, setup.controller
    survey_seed, *machine_seeds = seed.spawn(3)
    home, tip = np.asarray(setup.home), np.asarray(gears.tip)
    mouth = home + tip + np.array([0.0, 0.0, setup.gap])
    # The way is planned by a survey of the outer gear.
    rng = np.random.default_rng(survey_seed)
    turn, shift = survey_error(rig, SurveyOptions(), mouth, home, arms.runs, rng)
    # The impedance lags by B v / K, and presses its threshold of force on the seat.
    lag = setup.speed * controller.impedance.damping[2] / controller.impedance.stiffness[2]
    way = setup.gap + gears.length + _ON + lag
    start, goal = (
        Pose(turn, mouth + shift + turn @ (np.array([0.0, 0.0, s]) - tip))
        for s in (-setup.gap, way - setup.gap)
    )
    for pose, what in ((start, "start posture of run"), (goal, "end posture of run")):
        require_within(rig, pose, setup.home, setup.travel, what)
    result = simulate_lanes(
        rig,
        controller,
        arms,
        advance(start, goal, way=way, speed=setup.speed, ramp=setup.ramp, step=controller.step),
        machine_seeds,
        Docking(gears, mouth, setup.gap + gears.length - _SHORT),
        workers=workers,
        progress=progress,
    )
    return DockingStudy(arms, number, result, setup)
