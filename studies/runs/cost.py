"""What a calibration costs, in time and money, against the accuracy that it reaches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from studies.runs.simulated_campaigns import attempted, by_tracker
from tdfscal.comparison.joint import combine
from tdfscal.errors import UsageError
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import slow_streams
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig, Rotations, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, SurveyOptions, Truth, simulate_dwells
from tdfscal.simulation.moving_campaign import simulate_moving
from tdfscal.simulation.moving_options import MovingOptions

#: Postures of a static campaign, and seconds of a moving one, that are asked.
POSTURES, SECONDS = (12, 24, 48), (30.0, 60.0, 120.0)
#: Of the recorder's force stamps behind its position stamps, s, as rig files have it.
_DELAY = UncertainValue(np.array(0.0), np.array(0.02))


def _assumed(value: float, meaning: str) -> float:
    number: float = field(default=value, metadata={"meaning": meaning})
    return number


@dataclass(frozen=True, slots=True)
class Assumptions:
    """Times and rates behind the cost; none is the paper's, and each can be changed."""

    dwell: float = _assumed(4.0, "s, a stop at a posture; as the simulated recorder, 3.2 to 4.8 s.")
    move: float = _assumed(3.0, "s, from posture to posture; as the simulated recorder, 2 to 4 s.")
    self_setup: float = _assumed(
        0.25, "h, to prepare a self-calibration: free the terminal, load the programme."
    )
    tracker_setup: float = _assumed(1.0, "h, to place the tracker, let it warm up and check it.")
    tracker_mount: float = _assumed(
        0.1, "h per sensor, to put reflector nests on its measuring points and take them off."
    )
    tracker_point: float = _assumed(
        20.0, "s, to measure one point, with the reflector carried there."
    )
    self_people: float = _assumed(1.0, "People at the machine for a self-calibration.")
    tracker_people: float = _assumed(
        2.0, "People at the machine for a survey: one at the tracker, one with the reflector."
    )
    person: float = _assumed(60.0, "Cost of one person's hour.")
    machine: float = _assumed(150.0, "Cost of one hour in which the machine cannot assemble.")
    tracker: float = _assumed(
        100.0, "Cost of one hour of the tracker: 150 000 over 5 years of 300 h."
    )

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not 0.0 <= getattr(self, name) < np.inf:
                raise UsageError(
                    f"{getattr(self, name):g} cannot be", where=name, hint="give 0 or more"
                )


@dataclass(frozen=True, slots=True)
class Effort:
    """Hours of machine, instrument and people (person hours), and what they cost together."""

    machine: float
    instrument: float
    people: float
    cost: float

    def __add__(self, other: Effort) -> Effort:
        return Effort(*(getattr(self, n) + getattr(other, n) for n in self.__dataclass_fields__))


@dataclass(frozen=True, slots=True)
class Choice:
    """One way to calibrate: its effort, and the rms error of an angle over runs, rad (N,).

    failed : runs without result.
    """

    method: str
    what: str
    effort: Effort
    error: FloatArray
    failed: int

    @property
    def rms(self) -> float:
        """Quadratic mean over the runs, rad."""
        return float(np.sqrt(np.mean(self.error**2))) if self.error.size else np.nan

    @property
    def standard_error(self) -> float:
        """Of `rms`, rad."""
        n = self.error.size
        if n < 2:
            return np.nan
        return float(np.std(self.error**2, ddof=1) / np.sqrt(n) / (2.0 * self.rms))


@dataclass(frozen=True, slots=True)
class CostStudy:
    """All choices on one rig, under stated assumptions."""

    rig: Rig
    assumptions: Assumptions
    runs: int
    seed: int
    choices: tuple[Choice, ...]


def self_effort(a: Assumptions, seconds: float) -> Effort:
    """Effort of a self-calibration that drives for so many seconds."""
    hours = a.self_setup + seconds / 3600.0
    people = a.self_people * hours
    return Effort(hours, 0.0, people, a.machine * hours + a.person * people)


def tracker_effort(a: Assumptions, rig: Rig, survey: SurveyOptions) -> Effort:
    """Effort of a survey of all targets, and of one point of each NCP at each move."""
    points = rig.n * (len(survey.targets) + survey.moves)
    hours = a.tracker_setup + rig.n * a.tracker_mount + points * a.tracker_point / 3600.0
    people = a.tracker_people * hours
    cost = (a.machine + a.tracker) * hours + a.person * people
    return Effort(hours, hours, people, cost)


def cost(
    rig: Rig,
    assumptions: Assumptions,
    runs: int,
    seed: int,
    *,
    options: Options,
    survey: SurveyOptions,
    progress: Callable[[str], None] = lambda stage: None,
) -> CostStudy:
    """Simulate and calibrate `runs` rigs in every way, and put the effort beside the error."""
    rngs = iter(np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(9))
    choices = []
    for postures in POSTURES:
        progress(f"{postures} postures, static")
        choices += _static(rig, assumptions, runs, next(rngs), options, survey, postures)
    for seconds in SECONDS:
        progress(f"{seconds:g} s in motion")
        effort = self_effort(assumptions, seconds)
        driven = MovingOptions(duration=seconds, squeeze=options.squeeze)
        found = _moving(rig, runs, next(rngs), driven)
        choices.append(_choice("self, moving", f"{seconds:g} s", effort, found))
    order = ("self, static", "self, moving", "tracker", "joint")
    ways = tuple(sorted(choices, key=lambda c: order.index(c.method)))
    return CostStudy(rig, assumptions, runs, seed, ways)


def _choice(method: str, what: str, effort: Effort, errors: Sequence[float | None]) -> Choice:
    kept = np.array([e for e in errors if e is not None])
    return Choice(method, what, effort, kept, len(errors) - kept.size)


def _error(truth: Truth, found: FloatArray) -> float:
    return float(np.sqrt(np.mean(so3.log(truth.rotation @ np.swapaxes(found, 1, 2)) ** 2)))


def _static(
    rig: Rig,
    a: Assumptions,
    runs: int,
    rng: np.random.Generator,
    options: Options,
    survey: SurveyOptions,
    postures: int,
) -> list[Choice]:
    """Self-calibration from dwells; at the middle number also the tracker, and both together."""
    batch = simulate_dwells(rig, replace(options, postures=postures), rng, runs)
    truth = [batch.truth.trial(run) for run in range(runs)]

    def itself(run: int) -> Rotations:
        result = self_calibrate(rig, batch.dwells(run), rng=rng, max_trials=0)
        return Rotations(rig.supports, result.fit.state.rotation, result.uncertainty.covariance)

    def choice(method: str, what: str, effort: Effort, found: list[Rotations | None]) -> Choice:
        pairs = zip(truth, found, strict=True)
        errors = [None if one is None else _error(true, one.rotation) for true, one in pairs]
        return _choice(method, what, effort, errors)

    own = attempted(itself, runs)
    what, effort = f"{postures} postures", self_effort(a, postures * (a.dwell + a.move))
    choices = [choice("self, static", what, effort, own)]
    if postures == POSTURES[1]:
        theirs = attempted(lambda run: by_tracker(rig, truth[run], survey, rng).rotations, runs)
        pairs = zip(own, theirs, strict=True)
        joint = [combine(one, other).rotations if one and other else None for one, other in pairs]
        points = f"{rig.n * (len(survey.targets) + survey.moves)} points"
        extra = tracker_effort(a, rig, survey)
        choices.append(choice("tracker", points, extra, theirs))
        choices.append(choice("joint", f"{what}, {points}", effort + extra, joint))
    return choices


def _moving(
    rig: Rig, runs: int, rng: np.random.Generator, options: MovingOptions
) -> list[float | None]:
    """Errors of self-calibrations in motion."""
    seeds = rng.spawn(runs)

    def error(run: int) -> float:
        campaign = simulate_moving(rig, options, seeds[run])
        result = calibrate_moving(rig, slow_streams([campaign.log], rig.capacity), _DELAY)
        return _error(campaign.truth, result.fit.state.still.rotation)

    return attempted(error, runs)
