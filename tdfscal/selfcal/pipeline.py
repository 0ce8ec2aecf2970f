"""Self-calibration from dwells to a judged result: the steps in their order, nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tdfscal.acceptance.conformity import Conformity, assess_stated
from tdfscal.acceptance.gate import judge
from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError
from tdfscal.model.earlier import loosened
from tdfscal.model.parameters import nominal
from tdfscal.model.statics import Postures, postures
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import p_text
from tdfscal.records import Dwells, InputFile, IntArray, Rig
from tdfscal.selfcal import observability, repeatability
from tdfscal.selfcal.covariance import Quality, Uncertainty, evaluate, information_root, quality
from tdfscal.selfcal.cross_validation import CrossValidation, cross_validate
from tdfscal.selfcal.estimator import Fit, best_start, fit, spread
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.selfcal.linear_method import evaluate_linear, fit_linear
from tdfscal.selfcal.monte_carlo import MonteCarlo, simulate
from tdfscal.selfcal.observability import Observability
from tdfscal.selfcal.outliers import Rejection, fit_robust
from tdfscal.selfcal.repeatability import Stability
from tdfscal.selfcal.score_tests import Suspicion, suspicions
from tdfscal.selfcal.slip import find_slip
from tdfscal.significance import MISFIT, OVERSTATED_NOISE

Estimator = Literal["ml", "linear"]

#: Trials after which a Monte Carlo stops although its averages still move.
MAX_TRIALS = 40_000
#: Trials for the covariance of the linear method.
LINEAR_TRIALS = 1_000
#: Residuals this many times the expected ones make another wiring worth a try.
_POOR = 10.0
#: Rounds that bring an unknown noise level and the fit into agreement.
_LEVELS = 6


@dataclass(frozen=True, slots=True)
class SelfCalibration:
    """The judged result of a self-calibration.

    dwells : all that were found; the fit's postures are those not screened out. rejected : dwell
    index → reason. suspicions : what the residuals say was not declared. conformity : of the
    contact wrench, where the rig file limits it. reasons : why the gate rejects; empty where it
    accepts.
    """

    rig: Rig
    estimator: Estimator
    dwells: Dwells
    fit: Fit
    quality: Quality
    uncertainty: Uncertainty
    observability: Observability
    suspicions: tuple[Suspicion, ...]
    stability: Stability
    conformity: Conformity | None
    validation: CrossValidation
    monte_carlo: MonteCarlo | None
    rejected: dict[int, str]
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]


def self_calibrate(
    rig: Rig,
    dwells: Dwells,
    *,
    rng: np.random.Generator,
    estimator: Estimator = "ml",
    max_trials: int | None = None,
    inputs: tuple[InputFile, ...] = (),
    extremes: faulty_sensors.Extremes | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> SelfCalibration:
    """Calibrate from static dwells by maximum likelihood, or by the paper's linear method.

    max_trials : of the Monte Carlo, 0 for none, which the linear method cannot do without.
    extremes : of the whole log's readings, to tell a saturated sensor from a dead one.
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
    usable = usable_postures(rig, dwells, extremes)
    index, observed, measured_noise = usable.index, usable.postures, usable.measured_noise
    found: tuple[Rejection, ...] = ()
    if estimator == "ml":
        result, found = _fit(rig, observed)
        parts = information_root(result)
        stats = quality(result, parts)
        uncertainty = evaluate(result, parts, stats.birge, noise_from_residuals=measured_noise)
    else:
        result = fit_linear(rig, observed)
        parts = information_root(result)
        stats = quality(result, parts)
        uncertainty = evaluate_linear(result, rng, max_trials or LINEAR_TRIALS)
    seen = observability.verdict(
        rig, result.state, observed, uncertainty.covariance, uncertainty.rpy_covariance
    )
    if not seen.identified:
        raise NotIdentifiableError(_unseen(seen), hint=seen.weak[0].advice)
    if not result.converged:
        raise NotConvergedError(
            f"the estimate did not settle in {result.iterations} iterations",
            hint="check mass, hinges and nominal mounting in rig.yaml, and record more postures",
        )
    held = ((dwells.start + dwells.end) / 2)[index]
    steady = repeatability.examine(result, held)
    doubts: tuple[Suspicion, ...] = ()
    if estimator == "ml" and not measured_noise:
        doubts = suspicions(result, parts, uncertainty, held, stats)
    if estimator == "ml":
        slip = find_slip(result, uncertainty, held, index + 1, noise_from_residuals=measured_noise)
        # What spoils the whole campaign may look like a slip, and a slip like much that does.
        if slip is not None and all(slip.p_value <= doubt.p_value for doubt in doubts):
            doubts = (slip,)
    conformity = assess_stated(from_fit(result, uncertainty.covariance))
    trials = None
    if estimator == "ml" and max_trials != 0:
        progress("confirming the uncertainties by Monte Carlo")
        trials = simulate(result, parts, uncertainty, stats.birge, rng, max_trials or MAX_TRIALS)
    rejected = dict(usable.reasons) | {int(index[r.index]): r.reason for r in found}
    return SelfCalibration(
        rig=rig,
        estimator=estimator,
        dwells=dwells,
        fit=result,
        quality=stats,
        uncertainty=uncertainty,
        observability=seen,
        suspicions=doubts,
        stability=steady,
        conformity=conformity,
        validation=cross_validate(result, parts),
        monte_carlo=trials,
        rejected=rejected,
        reasons=judge(
            rig,
            uncertainty.rpy_std,
            stats.birge,
            used=len(dwells) - len(rejected),
            rejected=len(rejected),
            inputs=inputs,
            suspicions=[doubt.text for doubt in doubts if doubt.harmful],
            conformity=conformity,
        ),
        warnings=_warnings(
            rig, dwells, stats, trials, doubts, steady, measured_noise=measured_noise
        ),
    )


@dataclass(frozen=True, slots=True)
class Usable:
    """Postures that a fit may use.

    index : (K,), their dwells. reasons : dwell → why it is not among them. measured_noise : nobody
    states a force noise; it was taken from the residuals.
    """

    postures: Postures
    index: IntArray
    reasons: dict[int, str]
    measured_noise: bool


def usable_postures(
    rig: Rig, dwells: Dwells, extremes: faulty_sensors.Extremes | None = None
) -> Usable:
    """Hold the dwells against the rig file and leave out what no sensor can have felt.

    Raises DataError where there is nothing left, or log and rig file contradict each other.
    """
    if len(dwells) == 0:
        raise DataError(
            "no static dwell was found: the NCPs never rest with settled forces",
            where="log",
            hint="hold each posture for at least two seconds, or check the position fields",
        )
    log_against_rig.check_geometry(rig, dwells.position)
    screened = faulty_sensors.screen(rig, dwells, extremes)
    index = np.flatnonzero(screened.keep)
    if len(index) == 0:
        raise DataError(
            f"no posture can be used: {screened.reasons[0]}",
            where="log forces",
            hint="check the sensors, and supports.capacity in rig.yaml",
        )
    observed = postures(rig, dwells).subset(index)
    log_against_rig.check_weight(rig, observed)
    observed, measured_noise = _with_noise(rig, observed)
    return Usable(observed, index, dict(screened.reasons), measured_noise)


def _fit(rig: Rig, observed: Postures) -> tuple[Fit, tuple[Rejection, ...]]:
    """Robust fit; a poor one is held against other wirings before it is believed."""
    result, found = fit_robust(loosened(rig), observed)
    if np.sqrt(spread(result.distance, result.at.rows)) > _POOR:
        _check_wiring(rig, observed)
    if rig.earlier is not None:
        result = fit(rig, observed, result.state, result.weight)
    return result, found


def _check_wiring(rig: Rig, observed: Postures) -> None:
    """Raise DataError where the forces' fields, named otherwise, explain the postures.

    Several may, each with sensors that are turned by quarters: the least turned is the likely one.
    """
    back, fitting = np.swapaxes(nominal(rig).rotation, 1, 2), []
    for words, other in log_against_rig.rewired(rig, observed):
        started = best_start(rig, other, mountings=False)
        if np.sqrt(spread(started.distance, started.at.rows)) < _POOR:
            turn = np.linalg.norm(so3.log(started.state.rotation @ back), axis=1)
            fitting.append((float(turn.max()), words))
    if fitting:
        raise DataError(
            f"the forces fit with {min(fitting)[1]}, and not as they are named",
            where="log forces",
            hint="correct the force fields of the log block in rig.yaml, or the cabling",
        )


def _with_noise(rig: Rig, observed: Postures) -> tuple[Postures, bool]:
    """Postures with a noise level; found from the residuals where nobody states one.

    Averaged postures (`rows: postures`) without `uncertainty.force_noise` carry no scatter. The
    level is then the one with χ² = dof, at the price that χ² can no longer warn of anything.
    """
    if np.diagonal(observed.force_cov, axis1=2, axis2=3).min() > 0:
        return observed, False
    level = 1.0
    for _ in range(_LEVELS):
        guess = replace(
            observed, force_cov=np.broadcast_to(level**2 * np.eye(3), observed.force_cov.shape)
        )
        result, _ = fit_robust(rig, guess)
        stats = quality(result, information_root(result))
        if stats.dof <= 0 or abs(stats.birge - 1) < 1e-3:
            break
        level *= stats.birge
    return guess, True


def _unseen(seen: Observability) -> str:
    """Name the angles without a number; the first cause stands for all."""
    names = ", ".join(weakness.angle.name for weakness in seen.weak)
    if len(seen.weak) == len(seen.angles):
        names = "any angle of any sensor"
    first = seen.weak[0]
    return f"the data do not determine {names}; for {first.angle.name}, {first.cause}"


def _warnings(
    rig: Rig,
    dwells: Dwells,
    stats: Quality,
    trials: MonteCarlo | None,
    doubts: tuple[Suspicion, ...],
    steady: Stability,
    *,
    measured_noise: bool,
) -> tuple[str, ...]:
    """Collect what the user must know although the result may be good."""
    found = list(dwells.warnings)
    if turned := log_against_rig.turned(rig, dwells.position):
        found.append(turned)
    if rig.declared.force_sensitivity > 0:
        found.append(
            "gain and crosstalk of the sensors were decoupled in situ, from a prior of "
            f"{rig.declared.force_sensitivity:.2%}: a reading needs rotation · sensitivity⁻¹"
        )
    if measured_noise:
        found.append(
            "neither the log nor rig.yaml states a force noise; it was taken from the residuals, "
            "so χ² cannot warn of contact or a wrong rig file (set uncertainty.force_noise)"
        )
    elif stats.p_value < MISFIT:
        found.append(
            f"the residuals are {stats.birge:.2g} times what the stated uncertainties explain "
            f"({p_text(stats.p_value)}); all noise was scaled up by that factor"
        )
    elif stats.p_value > 1 - OVERSTATED_NOISE:
        found.append(
            f"the residuals are only {stats.birge:.2g} times what the stated uncertainties "
            "explain: those may be overstated (uncertainty.force_noise, positioner), and so the "
            "angles' own"
        )
    found += [doubt.text for doubt in doubts if not doubt.harmful]
    if not measured_noise and not doubts:  # a named cause says more than the trend it makes
        found += steady.warnings
    if trials is not None and not trials.validated:
        found.append(
            "Monte Carlo does not confirm the linear 95 % intervals; the intervals given are those "
            "of the trials"
        )
    return tuple(found)
