"""From a result's records to the calibration file's model, for each method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal.estimation.exact_quantities import ExactQuantity, exact_quantities
from tdfscal.estimation.fit import factored_information
from tdfscal.files.calibration import statistics
from tdfscal.files.calibration.assembled import Angles, Provenance, assembled
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import parameters_document
from tdfscal.findings import Finding
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, layout, nominal, prior_std, symmetric
from tdfscal.numerics import so3
from tdfscal.planning.recorded_postures import prospects
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.covariance import joint_posterior
from tdfscal.selfcal.result import SelfCalibration

if TYPE_CHECKING:
    from tdfscal.comparison.joint import Joint
    from tdfscal.motioncal.pipeline import MotionCalibration
    from tdfscal.trackercal import TrackerCalibration


def from_self(
    result: SelfCalibration | MotionCalibration, origin: Provenance, notes: Sequence[Finding] = ()
) -> Calibration:
    """Return the calibration file of a self-calibration, from postures or in motion."""
    if isinstance(result, SelfCalibration):
        found, state, std = result.uncertainty, result.fit.state, result.uncertainty.parameter_std
        parts, exact = _self_parts(result, origin), exact_quantities(result.fit)
        if result.estimator == "ml":  # the linear method takes zeros and load as they are stated
            given = joint_posterior(result.fit, found.covariance)
            std = published_std(given, std)
            parts["parameters"] = parameters_document(given, _unscaled(result))
    else:
        found, state, given = result.uncertainty, result.fit.state.still, result.calibrated
        std, exact = published_std(given, found.parameter_std), exact_quantities(result.fit)
        parts = _own_parts(result, origin) | {
            "parameters": parameters_document(given),
            "motion": statistics.motion(result),
        }
    angles = Angles(
        state.rotation,
        found.covariance,
        result.observability.determined,
        result.monte_carlo,
        found.coverage_factor,
    )
    return assembled(
        origin,
        angles,
        findings=(*result.reasons, *notes, *_others(result.findings)),
        budget=found.contributions,
        exact=exact,
        **parts,
        **_state(state, std, result.rig),
    )


def from_tracker(
    result: TrackerCalibration, origin: Provenance, notes: Sequence[Finding]
) -> Calibration:
    """Return the calibration file of a laser-tracker calibration: zeros and load as stated.

    notes : findings beside its own.
    """
    rig, at = origin.rig.rig, result.rotations
    return assembled(
        origin,
        Angles(at.rotation, at.covariance, np.ones(rig.n, dtype=np.bool_), result.monte_carlo),
        method="tracker",
        findings=(*notes, *result.findings),
        budget=result.budget,
        exact=result.exact,
        tracker=statistics.tracker_statistics(result),
        **_state(nominal(rig), prior_std(rig), rig) | {"sensitivity": None},
    )


def from_joint(
    both: Joint,
    own: SelfCalibration,
    tracker: TrackerCalibration,
    origin: Provenance,
    findings: Sequence[Finding],
) -> Calibration:
    """Return the calibration file of both methods together.

    Zeros, mass and barycentre are those of the self-calibration, moved by their correlation with
    the rotations that the tracker has moved.
    """
    R, C = both.rotations.rotation, both.rotations.covariance
    given = joint_posterior(own.fit, C, R)
    determined = np.all(both.rpy_std < own.rig.acceptance.identifiable, axis=1)
    test = {
        "consistency_p_value": both.test.p_value,
        "largest_en": float(np.abs(both.test.en).max()),
    }
    apart = (
        ("self", own.fit.state.rotation, own.uncertainty.rpy_std),
        ("tracker", tracker.rotations.rotation, tracker.rpy_std),
    )
    # With its weight in the joint estimate, C C_a⁻¹, each method moves it by what it has as exact,
    # and has the share C C_a⁻¹ C of its covariance, whose sum is C.
    of_self, of_tracker = (
        np.asarray(np.linalg.solve(covariance, C).T)
        for covariance in (own.uncertainty.covariance, tracker.rotations.covariance)
    )
    return assembled(
        origin,
        Angles(R, C, determined),
        findings=findings,
        budget={
            "self-calibration": so3.rpy_variance(R, of_self @ C),
            "tracker": so3.rpy_variance(R, of_tracker @ C),
        },
        exact=[
            *_weighted(exact_quantities(own.fit), of_self),
            *_weighted(tracker.exact, of_tracker),
        ],
        parameters=parameters_document(given),
        tracker=statistics.tracker_statistics(tracker) | test,
        methods=[{"method": m, "rpy": so3.to_rpy(X), "rpy_std": std} for m, X, std in apart],
        **_self_parts(own, origin) | {"method": "joint"},
        **_state(given.state, published_std(given, own.uncertainty.parameter_std), own.rig),
    )


def _weighted(quantities: Sequence[ExactQuantity], weight: FloatArray) -> list[ExactQuantity]:
    return [replace(quantity, moves=weight @ quantity.moves) for quantity in quantities]


def _own_parts(result: SelfCalibration | MotionCalibration, origin: Provenance) -> dict[str, Any]:
    """What a self-calibration says of itself, of postures or in motion."""
    return {
        "method": "self",
        "estimator": result.estimator if isinstance(result, SelfCalibration) else "ml",
        "fit": statistics.fit(result, origin.campaigns),
        "observability": statistics.observability(result.observability),
        "validation": statistics.validation(result.validation),
        "conformity": result.conformity,
    }


def _self_parts(result: SelfCalibration, origin: Provenance) -> dict[str, Any]:
    """What a self-calibration from postures says of itself."""
    parts = _own_parts(result, origin)
    parts["observability"]["loads"] = statistics.loads(result)
    if result.with_moves is not None:
        stand = result.with_moves[result.observability.determined]
        parts["observability"]["with_moves"] = np.sqrt(np.mean(stand**2))
    if result.observability.determined.all() and not result.reasons:
        parts["observability"]["forecasts"] = [
            {"change": p.change, "amount": p.amount, "worst_std": p.rpy_std.max()}
            for p in prospects(result.fit, result.uncertainty.rpy_std)
        ]
    return {
        **parts,
        "postures": statistics.postures(result),
        "dwells": statistics.dwells(result),
        **({} if result.estimator == "linear" else statistics.nuisances(result)),
    }


def _others(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    return tuple(finding for finding in findings if not finding.rejects)


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
