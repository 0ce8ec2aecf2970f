"""The calibrations that a control study compares, and the machines that they meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies.runs.simulated_campaigns import attempted, by_tracker
from tdfscal.checks.same_rig import require_agreement
from tdfscal.errors import UsageError
from tdfscal.model import parameters
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.numerics.information import inverse
from tdfscal.records import Rig
from tdfscal.selfcal.linear_method import fit_linear
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, SurveyOptions, Truth, draw_truths, simulate_dwells
from tdfscal.simulation.truth import stated

#: Internal forces of the campaigns that the self-calibration gets, N, as `tdfscal simulate`.
SQUEEZE = 200.0
#: What each controller knows; the first four differ in their angles alone, as the paper's do.
KNOWS = {
    "none": "nominal angles",
    "tracker": "the tracker's angles",
    "linear": "the angles of the paper's linear self-calibration",
    "self": "the self-calibration's angles",
    "self-all": "the self-calibration's angles, zeros, mass and barycentre",
    "tracker-tared": "the tracker's angles, tared before each run",
    "perfect-angles": "true angles",
    "perfect": "the truth",
}
#: Which of them is like each of the paper's: angles alone, and self-calibration by Eq. 24.
LIKE = {"none": "none", "tracker": "tracker", "linear": "self"}

#: Those that know some of the truth.
BEST = ("perfect-angles", "perfect")


@dataclass(frozen=True, slots=True)
class Arm:
    """One calibration at work.

    assumed : (runs,), what the controller takes for true. angle_error : rms of the angles over the
    runs, rad. tared : before each run. failed : runs in which the calibration gave no result and
    the nominal angles were used.
    """

    name: str
    assumed: Truth
    angle_error: float
    tared: bool = False
    failed: int = 0


@dataclass(frozen=True, slots=True)
class Arms:
    """The calibrations on the same machines; truth : (runs,). origin : in words."""

    truth: Truth
    arms: tuple[Arm, ...]
    origin: str

    @property
    def runs(self) -> int:
        """Number of machines."""
        return len(self.truth.mass)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the calibrations."""
        return tuple(arm.name for arm in self.arms)


def simulated(
    rig: Rig,
    runs: int,
    rng: np.random.Generator,
    *,
    best: bool = True,
    options: Options | None = None,
    survey: SurveyOptions | None = None,
) -> Arms:
    """The arms of `KNOWS`; without best, those that know some of the truth are left out. Every run
    has a rig of its own, drawn within what the rig file states; campaign and survey of it are
    simulated and calibrated as by `tdfscal calibrate`. A calibration without result leaves the
    nominal angles, and is counted.
    """
    survey = survey or SurveyOptions()
    batch = simulate_dwells(rig, options or Options(squeeze=SQUEEZE), rng, runs)
    truth, campaigns = batch.truth, [batch.dwells(run) for run in range(runs)]
    nominal = parameters.nominal(rig)
    surveys = attempted(lambda run: by_tracker(rig, truth.trial(run), survey, rng), runs)
    states: dict[str, list[State | None]] = {
        "none": [nominal for _ in range(runs)],
        "tracker": [
            None if one is None else replace(nominal, rotation=one.rotations.rotation)
            for one in surveys
        ],
        "linear": attempted(lambda run: fit_linear(rig, postures(rig, campaigns[run])).state, runs),
        "self": attempted(
            lambda run: self_calibrate(rig, campaigns[run], rng=rng, max_trials=0).fit.state, runs
        ),
    }
    arms = []
    for name in KNOWS:
        if name in BEST:
            continue
        found = states[name.split("-")[0]]
        kept = [nominal if state is None else state for state in found]
        assumed = _assumed(rig, kept)
        if name != "self-all":
            assumed = replace(stated(rig, runs), rotation=assumed.rotation)
        arm = _arm(name, truth, assumed)
        arms.append(replace(arm, tared=name == "tracker-tared", failed=found.count(None)))
    origin = "campaigns and surveys simulated and calibrated, a rig of its own in every run"
    return Arms(truth, (*arms, *(_best(rig, truth) if best else ())), origin)


def _best(rig: Rig, truth: Truth) -> list[Arm]:
    """Controllers that know the true angles, and everything."""
    angles = replace(stated(rig, len(truth.mass)), rotation=truth.rotation)
    return [_arm("perfect-angles", truth, angles), _arm("perfect", truth, truth)]


def misaligned(rig: Rig, runs: int, deviations: Sequence[float], rng: np.random.Generator) -> Arms:
    """Controllers that know all but the angles: off by normal turns of these standard deviations,
    rad per axis, in the same directions in every arm.
    """
    truth = draw_truths(rig, Options(), rng, runs)
    unit = rng.standard_normal((runs, rig.n, 3))
    arms = [
        _arm(
            f"{1e3 * d:g} mrad", truth, replace(truth, rotation=so3.exp(d * unit) @ truth.rotation)
        )
        for d in deviations
    ]
    return Arms(truth, tuple(arms), "controllers that know all but the angles")


def given(
    rig: Rig,
    calibrations: Sequence[tuple[str, Calibrated]],
    runs: int,
    rng: np.random.Generator,
    *,
    truth: tuple[str, Calibrated] | None = None,
    best: bool = True,
) -> Arms:
    """Calibrations of this rig, and beside them none; with best also the perfect ones. The truth is
    not known: every run draws it from `truth`, or from the combination of all calibrations weighted
    by their covariances, all parameters by their joint uncertainty. None of them judges itself.

    Raises UsageError for a calibration of another rig, and for one that would be its own judge.
    """
    for name, calibration in calibrations:
        require_agreement(calibration.rig, rig, name)
    if truth is not None:
        require_agreement(truth[1].rig, rig, truth[0])
        for name, calibration in calibrations:
            if np.array_equal(calibration.state.rotation, truth[1].state.rotation):
                raise UsageError(
                    "a calibration cannot be its own judge",
                    where=name,
                    hint="name another file as --truth, or leave --truth out: all calibrations are "
                    "then combined",
                )
        drawn = _drawn(rig, truth[1], runs, rng)
        origin = f"truth drawn from {truth[0]} and its uncertainty"
    else:
        drawn = _drawn(rig, combined([c for _, c in calibrations]), runs, rng)
        origin = "truth drawn from the combination of all calibrations and its uncertainty"
        if len(calibrations) < 2:
            origin = (
                f"truth drawn about {calibrations[0][0]} itself: this shows what its stated "
                "uncertainty costs, and does not judge it"
            )
    arms = [_arm("none", drawn, stated(rig, runs))]
    arms += [_arm(n, drawn, _assumed(rig, [c.state] * runs)) for n, c in calibrations]
    if best:
        arms += _best(rig, drawn)
    return Arms(drawn, tuple(arms), origin)


def combined(calibrations: Sequence[Calibrated]) -> Calibrated:
    """Calibrations of one rig weighted by the covariances of all their parameters, as independent.

    Where they differ by more than they state, the covariance is inflated by their Birge ratio.
    A parameter that none has a covariance for is as in the first.
    """
    first = calibrations[0]
    size, turns = len(first.covariance), 3 * first.rig.n
    information, pull, square = np.zeros((size, size)), np.zeros(size), 0.0
    for c in calibrations:
        # Whatever is known exactly would get information of the size of a rounding error.
        known = np.diagonal(c.covariance) > 0.0
        whitener = np.zeros((c.root.shape[1], size))
        whitener[:, known] = np.linalg.pinv(c.root[known])
        own = whitener.T @ whitener
        information += own
        pull += own @ parameters.deviation(c.state, first.state)
    used = np.flatnonzero(np.diagonal(information))
    covariance = np.zeros((size, size))
    covariance[np.ix_(used, used)] = inverse(information[np.ix_(used, used)])
    mean = covariance @ pull
    for c in calibrations:
        off = parameters.deviation(c.state, first.state)[:turns] - mean[:turns]
        square += float(off @ np.linalg.solve(c.covariance[:turns, :turns], off))
    birge2 = max(1.0, square / (turns * max(1, len(calibrations) - 1)))
    return replace(
        first,
        state=parameters.retract(first.state, mean),
        covariance=birge2 * covariance,
        open=np.all([c.open for c in calibrations], axis=0),
    )


def _drawn(rig: Rig, source: Calibrated, runs: int, rng: np.random.Generator) -> Truth:
    """Truths of a rig that is as a calibration says, within its uncertainty."""
    root = source.root
    state = parameters.retract(source.state, rng.standard_normal((runs, root.shape[1])) @ root.T)
    drawn = draw_truths(rig, Options(), rng, runs)
    open_zero = source.open[parameters.layout(rig.n)["zero"]].reshape(rig.n, 3)
    return replace(
        drawn,
        rotation=state.rotation,
        rpy=so3.to_rpy(state.rotation),
        zero=np.where(open_zero, drawn.zero, state.zero),
        sensitivity=parameters.symmetric(state.sensitivity),
        mass=state.mass,
        barycentre=state.barycentre,
        hinge=state.hinge,
    )


def drifted(arms: Arms, drift: float, rng: np.random.Generator) -> Arms:
    """The same machines after every sensor's zero has moved since the calibrations, by `drift` (N,
    standard deviation per axis).

    Raises UsageError for a drift that is none.
    """
    if not 0.0 <= drift < np.inf:
        raise UsageError(f"zeros cannot drift by {drift:g} N", hint="give zero or more")
    moved = arms.truth.zero + drift * rng.standard_normal(arms.truth.zero.shape)
    origin = f"{arms.origin}; zeros drifted by {drift:g} N since"
    return replace(arms, truth=replace(arms.truth, zero=moved), origin=origin)


def _assumed(rig: Rig, states: Sequence[State]) -> Truth:
    return replace(
        stated(rig, len(states)),
        rotation=np.stack([s.rotation for s in states]),
        zero=np.stack([s.zero for s in states]),
        sensitivity=np.stack([parameters.symmetric(s.sensitivity) for s in states]),
        mass=np.array([float(s.mass) for s in states]),
        barycentre=np.stack([s.barycentre for s in states]),
        hinge=np.stack([s.hinge for s in states]),
        gravity=np.stack([parameters.gravity(s, rig.gravity) for s in states]),
    )


def _arm(name: str, truth: Truth, assumed: Truth) -> Arm:
    error = so3.log(truth.rotation @ np.swapaxes(assumed.rotation, -1, -2))
    return Arm(name, assumed, float(np.sqrt(np.mean(error**2))))
