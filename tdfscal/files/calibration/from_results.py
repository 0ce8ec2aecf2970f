"""From a result's records to the calibration file's model, for each method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from tdfscal.comparison.joint import Joint
from tdfscal.files.calibration import statistics
from tdfscal.files.calibration.assembled import Angles, Provenance, assembled
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.motion import held_out_document, motion_document
from tdfscal.files.calibration.nuisances import nuisance_documents
from tdfscal.files.calibration.parameters import parameters_document
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, layout, symmetric
from tdfscal.motioncal.exact_quantities import exact_quantities as exact_in_motion
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import information_root
from tdfscal.selfcal.exact_quantities import ExactQuantity, exact_quantities
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.trackercal import TrackerCalibration


def from_self(
    result: SelfCalibration, origin: Provenance, notes: Sequence[str] = ()
) -> Calibration:
    """Return the calibration file of a self-calibration."""
    parameters, std = None, result.uncertainty.parameter_std
    if result.estimator == "ml":  # the linear method takes zeros and load as they are stated
        given = from_fit(result.fit, result.uncertainty.covariance)
        parameters, std = parameters_document(given, _unscaled(result)), published_std(given, std)
    return assembled(
        origin,
        method="self",
        estimator=result.estimator,
        reasons=result.reasons,
        advice=_advice(result),
        warnings=(*notes, *result.warnings),
        angles=_self_angles(result),
        parameters=parameters,
        budget=result.uncertainty.contributions,
        exact=exact_quantities(result.fit),
        **_self_parts(result, origin, result.fit.state, std),
    )


def from_motion(
    result: MotionCalibration, origin: Provenance, notes: Sequence[str] = ()
) -> Calibration:
    """Return the calibration file of a self-calibration from samples in motion."""
    known, state, n = result.uncertainty.turns, result.fit.state.still, result.rig.n
    place, rpy = layout(n), so3.to_rpy(state.rotation)
    std = published_std(result.calibrated, known.parameter_std)
    half, trials = known.coverage_factor * known.rpy_std, result.monte_carlo
    low, high = rpy - half, rpy + half
    if trials is not None and not trials.validated:
        low, high = trials.low, trials.high
    declared = result.rig.declared.force_sensitivity > 0
    return assembled(
        origin,
        method="self",
        estimator="ml",
        reasons=result.reasons,
        advice=_advice(result),
        warnings=(*notes, *result.warnings),
        angles=Angles(
            state.rotation,
            known.covariance,
            known.rpy_std,
            low,
            high,
            result.observability.determined,
        ),
        parameters=parameters_document(result.calibrated),
        budget=known.contributions,
        exact=exact_in_motion(result.fit),
        zero=state.zero,
        zero_std=std[place["zero"]].reshape(n, 3),
        sensitivity=np.eye(3) + symmetric(state.sensitivity) if declared else None,
        terminal=statistics.terminal(
            state.mass, std[place["mass"]], state.barycentre, std[place["barycentre"]]
        ),
        fit={
            "postures": result.dwells,
            **asdict(result.quality),
            "iterations": result.fit.iterations,
            "converged": result.fit.converged,
            **statistics.totals(origin.campaigns),
        },
        observability=statistics.observability(result.observability),
        monte_carlo=statistics.trials(
            trials,
            origin.seed,
            known.rpy_std,
            validated=trials is not None and trials.validated,
        ),
        validation=held_out_document(result.validation),
        conformity=statistics.conformity(result.conformity),
        motion=motion_document(result),
    )


def from_tracker(
    result: TrackerCalibration, origin: Provenance, reasons: Sequence[str], notes: Sequence[str]
) -> Calibration:
    """Return the calibration file of a laser-tracker calibration."""
    rig, trials = origin.rig.rig, result.monte_carlo
    return assembled(
        origin,
        method="tracker",
        reasons=reasons,
        warnings=(*notes, *result.warnings),
        angles=_tracker_angles(result),
        budget=result.budget,
        exact=result.exact,
        zero=rig.zero.value,
        zero_std=rig.zero.std,
        terminal=statistics.terminal(
            rig.mass.value, rig.mass.std, rig.barycentre.value, rig.barycentre.std
        ),
        monte_carlo=statistics.trials(
            trials,
            origin.seed,
            result.rpy_std,
            validated=trials is not None and trials.linear_interval_validated,
        ),
        tracker=statistics.tracker_statistics(result),
    )


def from_joint(
    both: Joint,
    own: SelfCalibration,
    tracker: TrackerCalibration,
    origin: Provenance,
    reasons: Sequence[str],
    notes: Sequence[str],
) -> Calibration:
    """Return the calibration file of both methods together.

    Zeros, mass and barycentre are those of the self-calibration, moved by their correlation with
    the rotations that the tracker has moved.
    """
    given = from_fit(own.fit, both.rotations.covariance, both.rotations.rotation)
    half = float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2)) * both.rpy_std
    angles = Angles(
        both.rotations.rotation,
        both.rotations.covariance,
        both.rpy_std,
        both.rpy - half,
        both.rpy + half,
        determined=np.all(both.rpy_std < own.rig.acceptance.identifiable, axis=1),
    )
    std = published_std(given, own.uncertainty.parameter_std)
    parts = _self_parts(own, origin, given.state, std) | {"monte_carlo": None}
    return assembled(
        origin,
        method="joint",
        estimator=own.estimator,
        reasons=reasons,
        advice=_advice(own),
        warnings=(*notes, *own.warnings, *tracker.warnings),
        angles=angles,
        parameters=parameters_document(given),
        budget=_joint_budget(both, own, tracker),
        exact=_joint_exact(both, own, tracker),
        tracker=statistics.tracker_statistics(tracker)
        | {
            "consistency_p_value": both.test.p_value,
            "largest_en": float(np.abs(both.test.en).max()),
        },
        methods=statistics.methods(own, tracker),
        **parts,
    )


def _advice(result: SelfCalibration | MotionCalibration) -> tuple[str, ...]:
    """Cures of what the residuals say, each once, that of the surest finding first."""
    others = result.set_aside if isinstance(result, SelfCalibration) else ()
    cures: dict[str, str] = {}
    for doubt in (*result.suspicions, *others):
        # One key of the rig file is one cure, whatever its size.
        act, _, rest = doubt.advice.partition(": ")
        cures.setdefault(act + rest.rpartition("`")[2], doubt.advice)
    return tuple(cures.values())


def _self_parts(
    result: SelfCalibration, origin: Provenance, state: State, std: FloatArray
) -> dict[str, Any]:
    """Everything but the angles and their budget; std (P,) of the state's parameters."""
    n, place, trials = state.n, layout(state.n), result.monte_carlo
    declared = result.rig.declared.force_sensitivity > 0
    return {
        "zero": state.zero,
        "zero_std": std[place["zero"]].reshape(n, 3),
        "sensitivity": np.eye(3) + symmetric(state.sensitivity) if declared else None,
        "terminal": statistics.terminal(
            state.mass, std[place["mass"]], state.barycentre, std[place["barycentre"]]
        ),
        "fit": statistics.fit(result) | statistics.totals(origin.campaigns),
        "postures": statistics.postures(result),
        "dwells": statistics.dwells(result),
        "observability": statistics.observability(result.observability)
        | {"loads": statistics.loads(result)},
        "monte_carlo": statistics.trials(
            trials,
            origin.seed,
            result.uncertainty.rpy_std,
            validated=trials is not None and trials.validated,
        ),
        "validation": statistics.validation(result),
        "stability": result.stability,
        "conformity": statistics.conformity(result.conformity),
        **({} if result.estimator == "linear" else nuisance_documents(result)),
    }


def published_std(given: Calibrated, fitted: FloatArray) -> FloatArray:
    """Standard uncertainties (P,) by the covariance that the file publishes.

    fitted : (at least P,), by the fit alone; what it leaves open, rotations do not fix.
    """
    std = np.sqrt(np.diagonal(given.covariance))
    return np.where(np.isinf(fitted[: len(std)]), np.inf, std)


def _unscaled(result: SelfCalibration) -> FloatArray:
    """Covariance (3n, 3n) of the rotations by the stated uncertainties, for `update`."""
    turns = np.flatnonzero(np.repeat(result.observability.determined, 3))
    root = information_root(result.fit).root[turns]
    return np.asarray(root @ root.T)


def _self_angles(result: SelfCalibration) -> Angles:
    spread, rpy = result.uncertainty, so3.to_rpy(result.fit.state.rotation)
    low = rpy - spread.coverage_factor * spread.rpy_std
    high = rpy + spread.coverage_factor * spread.rpy_std
    trials = result.monte_carlo
    if trials is not None and not trials.validated:
        low, high = trials.low, trials.high
    return Angles(
        result.fit.state.rotation,
        spread.covariance,
        spread.rpy_std,
        low,
        high,
        result.observability.determined,
    )


def _tracker_angles(result: TrackerCalibration) -> Angles:
    found = result.rotations
    low, high = result.low, result.high
    if result.monte_carlo is not None and not result.monte_carlo.linear_interval_validated:
        low, high = result.monte_carlo.low, result.monte_carlo.high
    known = np.ones(len(low), dtype=np.bool_)
    return Angles(found.rotation, found.covariance, result.rpy_std, low, high, known)


def _joint_exact(
    both: Joint, own: SelfCalibration, tracker: TrackerCalibration
) -> list[ExactQuantity]:
    """What each method takes as exact, with its weight in the joint estimate: C C_a⁻¹ moves."""
    C = both.rotations.covariance
    return [
        replace(quantity, moves=C @ np.linalg.solve(cov, quantity.moves))
        for cov, found in (
            (own.uncertainty.covariance, exact_quantities(own.fit)),
            (tracker.rotations.covariance, tracker.exact),
        )
        for quantity in found
    ]


def _joint_budget(
    both: Joint, own: SelfCalibration, tracker: TrackerCalibration
) -> dict[str, FloatArray]:
    """Each method's share: C C_a⁻¹ C, whose sum is C."""
    R, C = both.rotations.rotation, both.rotations.covariance
    return {
        name: so3.rpy_variance(R, C @ np.linalg.solve(cov, C))
        for name, cov in (
            ("self-calibration", own.uncertainty.covariance),
            ("tracker", tracker.rotations.covariance),
        )
    }
