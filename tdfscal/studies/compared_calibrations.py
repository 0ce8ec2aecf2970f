"""The calibrations that a control study compares, and the machines that they meet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from tdfscal.checks.same_rig import require_agreement
from tdfscal.errors import TdfscalError, UsageError
from tdfscal.model import parameters
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, SurveyOptions, Truth, draw_truths, simulate_dwells
from tdfscal.simulation.control.sensors import Assumed, perfect, uncalibrated
from tdfscal.simulation.control.servo import PositionErrors
from tdfscal.simulation.survey import simulate_survey
from tdfscal.trackercal import calibrate_tracker

#: Internal forces of the campaigns that the self-calibration gets, N, as `tdfscal simulate`.
SQUEEZE = 200.0
#: Standard deviations of the mounting's roll, pitch and yaw, rad, where the rig file has none. Flat
#: flanges and 0.5 % of crosstalk leave a few mrad of tilt; about Z nothing but bolt holes locates
#: a sensor (Sect. 5 of the paper: "much greater").
MOUNTING = (0.003, 0.003, 0.03)

_T = TypeVar("_T", Truth, Assumed, PositionErrors)


@dataclass(frozen=True, slots=True)
class Arm:
    """One calibration at work: its name, what the controller takes for true in each run, and the
    rms error of the angles over the runs, rad.
    """

    name: str
    assumed: Assumed
    angle_error: float


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

    def lanes(self, copies: int = 1) -> tuple[Truth, Assumed]:
        """Truth and assumptions of all lanes, (arm, copy, run) with the run fastest."""
        truth = tiled(self.truth, len(self.arms) * copies)
        parts = [tiled(arm.assumed, copies) for arm in self.arms]
        return truth, _joined(parts)


def simulated(
    rig: Rig,
    runs: int,
    rng: np.random.Generator,
    *,
    best: bool = False,
    options: Options | None = None,
    survey: SurveyOptions | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Arms:
    """The three of the paper: none, tracker, self; with best also perfect, which knows the truth.
    Every run has a rig of its own, drawn within what the rig file states; campaign and survey of it
    are simulated and calibrated as by `tdfscal calibrate`.

    Raises NotIdentifiableError and others of the calibrations where a run gives none.
    """
    survey = survey or SurveyOptions()
    options = options or Options(squeeze=SQUEEZE, installation_std=MOUNTING)
    batch = simulate_dwells(rig, options, rng, runs)
    truth = batch.truth
    own, tracked = [], []
    for run in range(runs):
        session = simulate_survey(rig, truth.trial(run), survey, rng).session
        try:
            found = calibrate_tracker(rig, session, misalignment=survey.body_misalignment, trials=0)
            fit = self_calibrate(rig, batch.dwells(run), rng=rng, max_trials=0).fit
        except TdfscalError as fault:
            raise type(fault)(
                f"a simulated calibration of this rig fails: {fault.what}",
                where=f"run {run + 1} of {runs}",
                hint=fault.hint,
            ) from fault
        tracked.append(found.rotations.rotation)
        own.append(fit.state)
        progress(run + 1)
    nominal = so3.from_rpy(rig.nominal_rpy)
    arms = [
        _arm("none", truth, uncalibrated(rig, nominal, runs)),
        _arm("tracker", truth, uncalibrated(rig, np.stack(tracked), runs)),
        _arm("self", truth, _joined([_assumed(rig, [state]) for state in own])),
    ]
    if best:
        arms.append(_arm("perfect", truth, perfect(truth)))
    return Arms(
        truth,
        tuple(arms),
        "campaigns and surveys simulated and calibrated, a rig of its own in every run",
    )


def given(
    rig: Rig,
    calibrations: Sequence[tuple[str, Calibrated]],
    runs: int,
    rng: np.random.Generator,
    *,
    best: bool = False,
) -> Arms:
    """Calibrations of this rig, and beside them none; with best also perfect. The truth is not
    known: every run draws it from the most certain of them, all parameters by their joint
    uncertainty.

    Raises UsageError for a calibration of another rig.
    """
    for name, calibration in calibrations:
        require_agreement(calibration.rig, rig, name)
    turns = slice(0, 3 * rig.n)
    name, surest = min(calibrations, key=lambda c: float(np.trace(c[1].covariance[turns, turns])))
    root = surest.root
    state = parameters.retract(surest.state, rng.standard_normal((runs, root.shape[1])) @ root.T)
    drawn = draw_truths(rig, Options(), rng, runs)
    open_zero = surest.open[parameters.layout(rig.n)["zero"]].reshape(rig.n, 3)
    truth = replace(
        drawn,
        rotation=state.rotation,
        rpy=so3.to_rpy(state.rotation),
        zero=np.where(open_zero, drawn.zero, state.zero),
        sensitivity=parameters.symmetric(state.sensitivity),
        mass=state.mass,
        barycentre=state.barycentre,
        hinge=state.hinge,
    )
    nominal = so3.from_rpy(rig.nominal_rpy)
    arms = [_arm("none", truth, uncalibrated(rig, nominal, runs))]
    arms += [_arm(n, truth, _assumed(rig, [c.state] * runs)) for n, c in calibrations]
    if best:
        arms.append(_arm("perfect", truth, perfect(truth)))
    return Arms(truth, tuple(arms), f"truth drawn from {name} and its uncertainty")


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


def _assumed(rig: Rig, states: Sequence[State]) -> Assumed:
    return Assumed(
        rotation=np.stack([s.rotation for s in states]),
        zero=np.stack([s.zero for s in states]),
        sensitivity=np.stack([np.eye(3) + parameters.symmetric(s.sensitivity) for s in states]),
        mass=np.array([float(s.mass) for s in states]),
        barycentre=np.stack([s.barycentre for s in states]),
        hinge=np.stack([s.hinge for s in states]),
        gravity=np.stack([parameters.gravity(s, rig.gravity) for s in states]),
    )


def _arm(name: str, truth: Truth, assumed: Assumed) -> Arm:
    error = so3.log(truth.rotation @ np.swapaxes(assumed.rotation, -1, -2))
    return Arm(name, assumed, float(np.sqrt(np.mean(error**2))))


def tiled(record: _T, copies: int) -> _T:
    """Repeat the lanes of a record."""

    def many(value: FloatArray) -> FloatArray:
        return np.tile(value, (copies, *(1,) * (value.ndim - 1)))

    values = (many(np.asarray(getattr(record, f.name))) for f in fields(record))
    return type(record)(*values)


def _joined(parts: Sequence[Assumed]) -> Assumed:
    return Assumed(
        *(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Assumed))
    )
