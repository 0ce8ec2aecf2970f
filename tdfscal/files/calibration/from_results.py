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
from tdfscal.files.calibration.motion import motion_document
from tdfscal.files.calibration.nuisances import nuisance_documents
from tdfscal.files.calibration.parameters import parameters_document
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, layout, symmetric
from tdfscal.motioncal.exact_quantities import exact_quantities as exact_in_motion
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.selfcal.covariance import Uncertainty, factored_information
from tdfscal.selfcal.exact_quantities import ExactQuantity, exact_quantities
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.selfcal.monte_carlo import MonteCarlo
from tdfscal.selfcal.result import SelfCalibration
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.trackercal import MonteCarlo as TrackerMonteCarlo
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
        angles=_linear_angles(
            result.fit.state.rotation,
            result.uncertainty,
            result.monte_carlo,
            result.observability.determined,
        ),
        parameters=parameters,
        budget=result.uncertainty.contributions,
        exact=exact_quantities(result.fit),
        **_self_parts(result, origin, result.fit.state, std),
    )


def from_motion(
    result: MotionCalibration, origin: Provenance, notes: Sequence[str] = ()
) -> Calibration:
    """Return the calibration file of a self-calibration from samples in motion."""
    known, state = result.uncertainty.turns, result.fit.state.still
    std = published_std(result.calibrated, known.parameter_std)
    return assembled(
        origin,
        method="self",
        estimator="ml",
        reasons=result.reasons,
        advice=_advice(result),
        warnings=(*notes, *result.warnings),
        angles=_linear_angles(
            state.rotation, known, result.monte_carlo, result.observability.determined
        ),
        parameters=parameters_document(result.calibrated),
        budget=known.contributions,
        exact=exact_in_motion(result.fit),
        fit={
            "postures": result.dwells,
            **asdict(result.quality),
            "iterations": result.fit.iterations,
            "converged": result.fit.converged,
            **statistics.totals(origin.campaigns),
        },
        observability=statistics.observability(result.observability),
        monte_carlo=statistics.trials(result.monte_carlo, origin.seed, known.rpy_std),
        validation=statistics.validation(result.validation),
        conformity=statistics.conformity(result.conformity),
        motion=motion_document(result),
        **_state(state, std, result.rig),
    )


def from_tracker(
    result: TrackerCalibration, origin: Provenance, reasons: Sequence[str], notes: Sequence[str]
) -> Calibration:
    """Return the calibration file of a laser-tracker calibration."""
    rig, at = origin.rig.rig, result.rotations
    return assembled(
        origin,
        method="tracker",
        reasons=reasons,
        warnings=(*notes, *result.warnings),
        angles=_angles(
            at.rotation,
            at.covariance,
            result.rpy_std,
            (result.low, result.high),
            result.monte_carlo,
        ),
        budget=result.budget,
        exact=result.exact,
        zero=rig.zero.value,
        zero_std=rig.zero.std,
        terminal=statistics.terminal(
            rig.mass.value, rig.mass.std, rig.barycentre.value, rig.barycentre.std
        ),
        monte_carlo=statistics.trials(result.monte_carlo, origin.seed, result.rpy_std),
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
    angles = _angles(
        both.rotations.rotation,
        both.rotations.covariance,
        both.rpy_std,
        (both.rpy - half, both.rpy + half),
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
    return {
        **_state(state, std, result.rig),
        "fit": statistics.fit(result) | statistics.totals(origin.campaigns),
        "postures": statistics.postures(result),
        "dwells": statistics.dwells(result),
        "observability": statistics.observability(result.observability)
        | {"loads": statistics.loads(result)},
        "monte_carlo": statistics.trials(
            result.monte_carlo, origin.seed, result.uncertainty.rpy_std
        ),
        "validation": statistics.validation(result.validation),
        "stability": result.stability,
        "conformity": statistics.conformity(result.conformity),
        **({} if result.estimator == "linear" else nuisance_documents(result)),
    }


def _state(state: State, std: FloatArray, rig: Rig) -> dict[str, Any]:
    """Zeros, sensitivities and load; std (P,) of the state's parameters."""
    place, scaled = layout(state.n), rig.declared.force_sensitivity > 0
    return {
        "zero": state.zero,
        "zero_std": std[place["zero"]].reshape(state.n, 3),
        "sensitivity": np.eye(3) + symmetric(state.sensitivity) if scaled else None,
        "terminal": statistics.terminal(
            state.mass, std[place["mass"]], state.barycentre, std[place["barycentre"]]
        ),
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
    root = factored_information(result.fit).root[turns]
    return np.asarray(root @ root.T)


def _linear_angles(
    rotation: FloatArray,
    known: Uncertainty,
    trials: MonteCarlo | None,
    determined: BoolArray | None = None,
) -> Angles:
    rpy, half = so3.to_rpy(rotation), known.coverage_factor * known.rpy_std
    ends = (rpy - half, rpy + half)
    return _angles(rotation, known.covariance, known.rpy_std, ends, trials, determined)


def _angles(
    rotation: FloatArray,
    covariance: FloatArray,
    std: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    trials: MonteCarlo | TrackerMonteCarlo | None = None,
    determined: BoolArray | None = None,
) -> Angles:
    """With the linear interval's ends, or the trials' where these do not validate it."""
    if trials is not None and not trials.validated:
        ends = trials.low, trials.high
    known = np.ones(len(rotation), dtype=np.bool_) if determined is None else determined
    return Angles(rotation, covariance, std, *ends, determined=known)


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
