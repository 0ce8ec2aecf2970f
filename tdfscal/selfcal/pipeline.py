"""Self-calibration from dwells to a judged result: the steps in their order, nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.acceptance.conformity import assess_stated
from tdfscal.acceptance.gate import judge
from tdfscal.errors import RigError
from tdfscal.model.earlier import loosened
from tdfscal.model.parameters import State
from tdfscal.model.statics import Postures
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import Dwells, FloatArray, InputFile, Rig, Rotations
from tdfscal.selfcal import observability, repeatability
from tdfscal.selfcal.closure import frame_errors
from tdfscal.selfcal.covariance import Quality, Uncertainty, evaluate, information_root, quality
from tdfscal.selfcal.cross_validation import cross_validate
from tdfscal.selfcal.estimator import Fit, fit
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.selfcal.linear_method import evaluate_linear, fit_linear
from tdfscal.selfcal.monte_carlo import simulate
from tdfscal.selfcal.mounting_search import Rival
from tdfscal.selfcal.noise_components import ChannelNoise, channel_noise, scaled
from tdfscal.selfcal.outliers import Rejection, RobustFit, fit_robust
from tdfscal.selfcal.preparation import Usable, usable_postures
from tdfscal.selfcal.result import Estimator, SelfCalibration, caveats
from tdfscal.selfcal.score_tests import likeliest, suspicions, wandering
from tdfscal.selfcal.slip import find_slip
from tdfscal.selfcal.suspicion import Suspicion
from tdfscal.selfcal.undetermined import Undetermined, check_determined
from tdfscal.significance import MOST_REJECTED

#: Trials after which a Monte Carlo stops although its averages still move: the ends of an interval
#: are then known to 0.013 σ, a quarter of the finest tolerance that clause 8 can ask for.
MAX_TRIALS = 20_000
#: Sensors up to which trials are made unasked: their work grows with the cube of that number.
MOST_SIMULATED = 12
#: Trials for the covariance of the linear method.
LINEAR_TRIALS = 1_000
_PARABOLA = (
    "the residuals ask for more than a slope of the zeros in time: a parabola was estimated "
    "beside it"
)


def self_calibrate(
    rig: Rig,
    dwells: Dwells,
    *,
    rng: np.random.Generator,
    estimator: Estimator = "ml",
    max_trials: int | None = None,
    inputs: tuple[InputFile, ...] = (),
    progress: Callable[[str], None] = lambda stage: None,
) -> SelfCalibration:
    """Calibrate from static dwells by maximum likelihood, or by the paper's linear method.

    max_trials : of the Monte Carlo, 0 for none, which the linear method cannot do without; None
    for `MAX_TRIALS` with up to `MOST_SIMULATED` sensors, none with more.
    progress : told the name of each long stage.

    Raises
    ------
    DataError
        The log contradicts the rig file, or a sensor is dead or saturated.
    NotIdentifiableError
        The data do not determine an angle.
    NotConvergedError
        The iteration does not settle.
    """
    usable = usable_postures(rig, dwells)
    held = ((dwells.start + dwells.end) / 2)[usable.index]
    estimate = (
        _likeliest_rotations(rig, usable, held)
        if estimator == "ml"
        else _linear(rig, usable.postures, rng, max_trials or LINEAR_TRIALS)
    )
    result, stats, uncertainty = estimate.fit, estimate.quality, estimate.uncertainty
    seen = observability.verdict(rig, result.state, result.postures, uncertainty.covariance)
    rejected = dict(usable.reasons) | {
        int(usable.index[r.index]): r.reason for r in estimate.rejections
    }
    check_determined(Undetermined(rig, dwells, result, stats, seen, rejected), estimate.rivals)
    steady = repeatability.examine(result, held)
    doubts: tuple[Suspicion, ...] = ()
    set_aside: tuple[Suspicion, ...] = ()
    if estimator == "ml":
        warmth = None if dwells.temperature is None else dwells.temperature[usable.index]
        doubts = _doubts(estimate, usable, held, warmth)
        if any(doubt.kind.endswith("parabola") for doubt in doubts):
            bent = replace(rig, drift=replace(rig.drift, parabola=np.inf))
            again = self_calibrate(
                bent, dwells, rng=rng, max_trials=max_trials, inputs=inputs, progress=progress
            )
            return replace(again, warnings=(*again.warnings, _PARABOLA))
        doubts, set_aside = _slip_or(doubts, estimate, usable, held)
    conformity = assess_stated(from_fit(result, uncertainty.covariance))
    trials = None
    unasked = max_trials is None and rig.n > MOST_SIMULATED
    if estimator == "ml" and max_trials != 0 and not unasked:
        progress("confirming the uncertainties by Monte Carlo")
        most = max_trials or MAX_TRIALS
        trials = simulate(
            result, estimate.parts, uncertainty, stats.birge, rng, most, known=seen.determined
        )
    calibration = SelfCalibration(
        rig=rig,
        estimator=estimator,
        dwells=dwells,
        fit=result,
        quality=stats,
        uncertainty=uncertainty,
        observability=seen,
        set_aside=set_aside,
        suspicions=doubts,
        channels=estimate.channels,
        stability=steady,
        conformity=conformity,
        validation=cross_validate(result, estimate.parts),
        monte_carlo=trials,
        rejected=rejected,
    )
    return replace(
        calibration,
        reasons=_reasons(calibration, inputs),
        warnings=caveats(calibration, usable.measured_noise, unasked),
    )


@dataclass(frozen=True, slots=True)
class _Estimate:
    """A fit and what is known of it before it is doubted: information root, misfit, covariance.

    channels : noisier than stated. rejections : postures that err each for itself. rivals : other
    mountings that explain the readings as well.
    """

    fit: Fit
    parts: Spectrum
    quality: Quality
    uncertainty: Uncertainty
    channels: ChannelNoise | None = None
    rejections: tuple[Rejection, ...] = ()
    rivals: tuple[Rival, ...] = ()


def _likeliest_rotations(rig: Rig, usable: Usable, held: FloatArray) -> _Estimate:
    """Maximum likelihood; with unequal noise where channels ask for it more than a slip does."""
    robust = _fit(rig, usable.postures, usable.start)
    estimate = _summed_up(robust, usable.measured_noise)
    channels = None if usable.measured_noise else channel_noise(robust.fit)
    if channels is None:
        return estimate
    weighted = _fit(rig, scaled(usable.postures, channels), robust.fit.state)
    slip = find_slip(robust.fit, estimate.uncertainty, held, usable.index + 1)
    if slip is not None and slip.weight > channels.worth(robust.fit, weighted.fit):
        return estimate
    return replace(_summed_up(weighted, measured_noise=False), channels=channels)


def _summed_up(robust: RobustFit, measured_noise: bool) -> _Estimate:
    parts = information_root(robust.fit)
    stats = quality(robust.fit, parts)
    spread = evaluate(robust.fit, parts, stats.birge, noise_from_residuals=measured_noise)
    return _Estimate(robust.fit, parts, stats, spread, None, robust.rejections, robust.rivals)


def _linear(rig: Rig, observed: Postures, rng: np.random.Generator, trials: int) -> _Estimate:
    _check_all_axes(rig)
    result = fit_linear(rig, observed)
    parts = information_root(result)
    return _Estimate(result, parts, quality(result, parts), evaluate_linear(result, rng, trials))


def _doubts(
    estimate: _Estimate, usable: Usable, held: FloatArray, warmth: FloatArray | None
) -> tuple[Suspicion, ...]:
    """What the residuals say that the rig file lacks; the closure of positions needs no force."""
    result, parts, uncertainty = estimate.fit, estimate.parts, estimate.uncertainty
    doubts: tuple[Suspicion, ...] = ()
    if not usable.measured_noise:
        doubts = suspicions(result, parts, uncertainty, held, estimate.quality, warmth)
        if not doubts and len(estimate.rejections) > MOST_REJECTED * len(usable.index):
            doubts = _of_everyone(result, held, warmth)
    return (*doubts, *frame_errors(result, parts, uncertainty))


def _slip_or(
    doubts: tuple[Suspicion, ...], estimate: _Estimate, usable: Usable, held: FloatArray
) -> tuple[tuple[Suspicion, ...], tuple[Suspicion, ...]]:
    """Hold a slip against the other doubts: the likelier, and what it set aside.

    What spoils the whole campaign may look like a slip, and a slip like much that does.
    """
    result, uncertainty = estimate.fit, estimate.uncertainty
    slip = find_slip(
        result, uncertainty, held, usable.index + 1, noise_from_residuals=usable.measured_noise
    )
    if slip is None:
        return doubts, ()
    rivals = doubts or wandering(result, estimate.parts, uncertainty, held)
    if all(_likelier(slip, doubt) for doubt in rivals):
        return (slip,), doubts
    return doubts or likeliest(list(rivals)), ()


def _of_everyone(result: Fit, held: FloatArray, warmth: FloatArray | None) -> tuple[Suspicion, ...]:
    """What is asked for with no posture left out: so many do not err each for itself."""
    whole = fit(result.rig, result.postures, result.state)
    parts = information_root(whole)
    stats = quality(whole, parts)
    return suspicions(whole, parts, evaluate(whole, parts, stats.birge), held, stats, warmth)


def _likelier(slip: Suspicion, doubt: Suspicion) -> bool:
    """Noise has no structure that a test could hold against its scatter: likelihoods decide."""
    if doubt.kind.endswith(("noise", "walk")):
        return slip.weight > doubt.weight
    return slip.p_value <= doubt.p_value


def _check_all_axes(rig: Rig) -> None:
    """Raise RigError where the linear method would miss a component of a force."""
    for i, j in np.argwhere(~rig.axes)[:1]:
        raise RigError(
            f"the sensor of {rig.supports[i]} does not measure {'xyz'[j]}, and the linear method "
            "needs every component",
            where="rig.yaml, supports",
            hint="calibrate by maximum likelihood (--estimator ml)",
        )


def _fit(rig: Rig, observed: Postures, start: State) -> RobustFit:
    """Robust fit; what earlier campaigns know comes in whole once the outliers are out."""
    robust = fit_robust(loosened(rig), observed, start)
    if rig.earlier is None:
        return robust
    return replace(robust, fit=fit(rig, observed, robust.fit.state, robust.fit.weight))


def _reasons(of: SelfCalibration, inputs: tuple[InputFile, ...]) -> tuple[str, ...]:
    return judge(
        of.rig,
        Rotations(of.rig.supports, of.fit.state.rotation, of.uncertainty.covariance),
        of.quality.birge,
        determined=of.observability.determined,
        used=len(of.dwells) - len(of.rejected),
        rejected=len(of.rejected),
        inputs=inputs,
        suspicions=[doubt.finding for doubt in of.suspicions if doubt.harmful],
        conformity=of.conformity,
    )
