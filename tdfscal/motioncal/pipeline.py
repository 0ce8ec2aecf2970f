"""Calibration in motion, from slow streams to a judged result: the steps in their order."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.checks.geometry import Geometry, examine
from tdfscal.estimation.exact_quantities import misplaced
from tdfscal.estimation.judged import Judged, Undetermined, holding
from tdfscal.estimation.observability import require_angles, verdict
from tdfscal.estimation.score_tests import Suspicion, likeliest
from tdfscal.estimation.uncertainty import estimate
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.dynamics import PARAMETERS, RATE
from tdfscal.model.parameters import nominal
from tdfscal.model.postures import Postures, forces
from tdfscal.model.statics import balance
from tdfscal.motioncal.blocks import Stretch, stretches
from tdfscal.motioncal.estimator import (
    MOST_TRIALS,
    ResidualWrench,
    fit_moving,
    hold_out,
    residual_wrench,
    simulate,
)
from tdfscal.motioncal.fit import MovingFit, MovingPriors
from tdfscal.motioncal.preparation import Usable, first_fit, gaps, moments, usable_samples
from tdfscal.motioncal.rows import UNSTATED
from tdfscal.motioncal.score_tests import suspicions, without_contacts
from tdfscal.motioncal.slip import likeliest_steps, refuse_changed_delay, suspicion_of
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.streams import covered
from tdfscal.records import FloatArray, Rig, UncertainValue
from tdfscal.selfcal.preparation import check_positions
from tdfscal.significance import MOST_POSE_NOISE, MOST_REJECTED

#: Instants at which distances are looked at. The positioners' errors are alike at places near each
#: other, so that more of them would not know more; nor do any number of them average these out.
_INSTANTS = 24
#: Share of its prior's standard deviation at which the rate of clocks is measured.
_TOLD = 0.5
#: At which the density of the positions' errors is summed up.
_FREQUENCIES = 400


@record(kw_only=True)
class MotionCalibration(Judged[MovingFit]):
    """The judged result of a calibration in motion.

    begin : s, in the log's time, and seconds : length of what was used. rejected : stretches left
    out, with their reasons. postures : moments of the motion, for figures. dwells : rests within
    it. residual : the residual wrench over time.
    """

    rejected: tuple[Stretch, ...]
    begin: float
    seconds: float
    postures: Postures
    dwells: int
    residual: ResidualWrench

    @property
    def moving_std(self) -> FloatArray:
        """Standard uncertainty (9,) of I_O, τ, d, ρ."""
        return self.uncertainty.parameter_std[-PARAMETERS:]

    @property
    def rate_told(self) -> bool:
        """Whether the log tells the rate of its clocks, beside what is known of clocks."""
        std = self.moving_std[RATE]
        return bool(0 < std <= _TOLD * self.fit.priors.std[RATE])


def calibrate_moving(
    rig: Rig,
    slow: Slow,
    delay: UncertainValue,
    *,
    dwells: int = 0,
    rng: np.random.Generator | None = None,
    max_trials: int | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> MotionCalibration:
    """Calibrate from samples in motion.

    Parameters
    ----------
    slow : streams of the log. delay : of the force stamps, s, as the rig file states it.
    dwells : how many rests were found in the log, which its samples hold as all others.
    progress : told of each stage.
    rng, max_trials : of the Monte Carlo; no trials without the one or with 0 of the other.

    Raises
    ------
    DataError
        The log contradicts the rig file, or cannot serve in motion.
    NotIdentifiableError
        The data do not determine an angle.
    NotConvergedError
        The iteration does not settle.
    """
    usable = usable_samples(rig, slow)
    seen = moments(rig, slow, usable.keep)
    check_positions(rig, seen)
    progress("fitting the motion and the spectrum of its residuals")
    priors = MovingPriors(rig, slow, delay)
    fit, doubt = first_fit(
        rig, seen, lambda state: fit_moving(priors, usable.blocks, priors.start(state))
    )
    fit, usable = without_contacts(
        fit, usable, lambda cut, last: fit_moving(priors, cut, last.state)
    )
    result = _judged(fit, usable, dwells, progress)
    found = (
        *result.gate(),
        *_unfit(result),
        *result.findings,
        *result.turned_sensors(),
        *result.harmless(),
        *doubt,
    )
    trials = None
    if rng is not None and max_trials != 0:
        progress("confirming the uncertainties by Monte Carlo")
        stand = result.observability.determined
        trials = simulate(result.estimate, rng, max_trials or MOST_TRIALS, stand)
    return replace(result, monte_carlo=trials, findings=found)


def _judged(
    fit: MovingFit, usable: Usable, dwells: int, progress: Callable[[str], None]
) -> MotionCalibration:
    """The estimate, doubted; findings : of the log and of what is determined."""
    rig, slow, still = fit.rig, fit.slow, fit.state.still
    keep, rejected = usable.keep, usable.rejected
    # Forces that nobody measures as the balance demands them.
    used = balance(moments(rig, slow, keep), still, still.barycentre, rig.gravity).seen
    known = estimate(fit)
    seen = verdict(rig, still, used, known.uncertainty.covariance, moving=True)
    evidence = Undetermined(rig, known.quality, seen, float(keep.sum() * slow.step), rejected)
    require_angles(seen, fit.converged, fit.iterations, evidence, moving=True)
    doubts: tuple[Suspicion, ...] = ()
    placed = misplaced(known, _geometry(fit, used))
    progress("looking for what changed on the way")
    steps = likeliest_steps(fit, seen.determined)
    refuse_changed_delay(steps)
    # With hinges elsewhere than stated whatever else the residuals ask for is an echo.
    if not any(doubt.spoils(fit.moving) for doubt in placed):
        asked = suspicions(known, rejected)
        if asked and not steps:
            # Something is there: what changed need no longer stand out of all instants by itself.
            steps = likeliest_steps(fit, seen.determined, 1.0)
        changed = [suspicion_of(steps, known)] if steps and steps[0].what != "delay" else []
        doubts = likeliest([*asked, *changed])
    start = fit.priors.start(nominal(rig))
    return MotionCalibration(
        rig=rig,
        estimate=holding(known, doubts, placed),
        observability=seen,
        suspicions=(*placed, *doubts),
        validation=hold_out(fit, keep, start),
        rejected=rejected,
        begin=float(slow.time[0]),
        seconds=sum(run.stop - run.start for run in stretches(slow, keep)) * slow.step,
        postures=used,
        dwells=dwells,
        residual=residual_wrench(fit, start.still, still),
        findings=(
            *gaps(slow),
            *seen.findings,
            *(stretch.finding for stretch in rejected),
            *log_against_rig.turned(rig, used.position),
        ),
    )


def _geometry(fit: MovingFit, seen: Postures) -> Geometry:
    """What the distances between hinges say at some instants.

    seen : instants of the motion, forces that nobody measures as the balance demands them.
    """
    some = np.unique(np.linspace(0, len(seen) - 1, _INSTANTS).astype(np.int64))
    own = fit.rig.declared.positioner
    variance = np.full(len(some), own**2 + fit.slow.quantum**2 / 12)
    force = forces(fit.state.still, seen.force[some])
    return examine(fit.rig, seen.position[some], variance, force, common=own)


def _unfit(result: MotionCalibration) -> Iterator[Finding]:
    """Reasons of its own to reject a motion: much was left out; residuals that are no noise.

    The spectrum follows any residual. Moments may ask for poses worse than the positions are, by
    all that is known: errors of the positions would show in the hinges' distances.
    """
    lost, fit = covered(result.rejected), result.fit
    if lost > MOST_REJECTED * (lost + result.seconds):
        values: dict[str, Value] = {"seconds": lost + result.seconds, "limit": MOST_REJECTED}
        yield Finding("motion-left-out", (), lost, "s", values=values, rejects=True)
    frequency = np.exp(np.linspace(fit.noise.knot[0], fit.noise.knot[-1], _FREQUENCIES))
    _, density = fit.noise.density(frequency)
    asked = float(np.sqrt(2 * np.trapezoid(density, frequency)))  # two-sided
    i, j = np.triu_indices(fit.rig.n, 1)
    x = np.concatenate([fit.slow.position[block.index] for block in fit.blocks])
    shown = float(np.linalg.norm(x[:, i] - x[:, j], axis=2).std(axis=0).max() / np.sqrt(2))
    stated = max(fit.rig.declared.positioner, UNSTATED)
    if asked > MOST_POSE_NOISE * max(stated, shown):
        values = {"declared": stated, "shown": shown}
        yield Finding("moments-unlike-noise", (), asked, "m", values=values, rejects=True)
