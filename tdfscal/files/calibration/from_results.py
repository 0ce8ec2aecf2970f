"""From a result's records to the calibration file's model, for each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from tdfscal import __version__
from tdfscal.acceptance.conformity import Conformity
from tdfscal.acceptance.turns import locked_warnings, turn_std
from tdfscal.comparison.joint import Joint
from tdfscal.files.calibration import evidence
from tdfscal.files.calibration.document import Calibration, parameter_names
from tdfscal.files.calibration.life import measured_document
from tdfscal.files.calibration.motion import held_out_document, motion_document
from tdfscal.files.calibration.nuisances import nuisance_documents
from tdfscal.files.calibration.parameters import parameters_document
from tdfscal.files.calibration.parts import (
    CALIBRATION_FORMAT,
    CONVENTION,
    CONVENTION_WITH_SENSITIVITY,
    COVARIANCE_DEFINITION,
    none_where_open,
)
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, layout, symmetric
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf, normal_quantile
from tdfscal.records import ANGLES, BoolArray, FloatArray, InputFile, Measured
from tdfscal.selfcal.covariance import information_root
from tdfscal.selfcal.exact_quantities import ExactQuantity, exact_quantities
from tdfscal.selfcal.joint_posterior import from_fit
from tdfscal.selfcal.monte_carlo import MonteCarlo
from tdfscal.selfcal.observability import Observability
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.significance import INTERVAL_COVERAGE
from tdfscal.trackercal import MonteCarlo as TrackerMonteCarlo
from tdfscal.trackercal import TrackerCalibration


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a result comes from."""

    rig: LoadedRig
    inputs: tuple[InputFile, ...]
    command: str
    seed: int
    measured: Measured | None = None
    campaigns: tuple[Mapping[str, Any], ...] = ()
    history: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, slots=True)
class _Angles:
    """Rotations (n, 3, 3), their covariance (3n, 3n), and intervals (n, 3), rad."""

    rotation: FloatArray
    covariance: FloatArray
    std: FloatArray
    low: FloatArray
    high: FloatArray
    determined: BoolArray


def from_self(
    result: SelfCalibration, origin: Provenance, notes: Sequence[str] = ()
) -> Calibration:
    """Return the calibration file of a self-calibration."""
    parameters, std = None, result.uncertainty.parameter_std
    if result.estimator == "ml":  # the linear method takes zeros and load as they are stated
        given = from_fit(result.fit, result.uncertainty.covariance)
        parameters, std = parameters_document(given, _unscaled(result)), published_std(given, std)
    return _calibration(
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
    half = known.coverage_factor * known.rpy_std
    declared = result.rig.declared.force_sensitivity > 0
    return _calibration(
        origin,
        method="self",
        estimator="ml",
        reasons=result.reasons,
        warnings=(*notes, *result.warnings),
        angles=_Angles(
            state.rotation,
            known.covariance,
            known.rpy_std,
            rpy - half,
            rpy + half,
            np.ones(n, dtype=np.bool_),
        ),
        parameters=parameters_document(result.calibrated),
        budget=known.contributions,
        zero=state.zero,
        zero_std=std[place["zero"]].reshape(n, 3),
        sensitivity=np.eye(3) + symmetric(state.sensitivity) if declared else None,
        terminal=_terminal(
            state.mass, std[place["mass"]], state.barycentre, std[place["barycentre"]]
        ),
        fit={
            "postures": result.dwells,
            **asdict(result.quality),
            "iterations": result.fit.iterations,
            "converged": result.fit.converged,
            **_totals(origin.campaigns),
        },
        observability=_observability(result.observability),
        validation=held_out_document(result.validation),
        conformity=_conformity(result.conformity),
        motion=motion_document(result),
    )


def from_tracker(
    result: TrackerCalibration, origin: Provenance, reasons: Sequence[str], notes: Sequence[str]
) -> Calibration:
    """Return the calibration file of a laser-tracker calibration."""
    rig, trials = origin.rig.rig, result.monte_carlo
    return _calibration(
        origin,
        method="tracker",
        reasons=reasons,
        warnings=(*notes, *result.warnings),
        angles=_tracker_angles(result),
        budget=result.budget,
        exact=result.exact,
        zero=rig.zero.value,
        zero_std=rig.zero.std,
        terminal=_terminal(rig.mass.value, rig.mass.std, rig.barycentre.value, rig.barycentre.std),
        monte_carlo=_trials(
            trials,
            origin.seed,
            result.rpy_std,
            validated=trials is not None and trials.linear_interval_validated,
        ),
        tracker=_tracker_statistics(result),
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
    angles = _Angles(
        both.rotations.rotation,
        both.rotations.covariance,
        both.rpy_std,
        both.rpy - half,
        both.rpy + half,
        determined=np.all(both.rpy_std < own.rig.acceptance.identifiable, axis=1),
    )
    std = published_std(given, own.uncertainty.parameter_std)
    parts = _self_parts(own, origin, given.state, std) | {"monte_carlo": None}
    return _calibration(
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
        tracker=_tracker_statistics(tracker)
        | {
            "consistency_p_value": both.test.p_value,
            "largest_en": float(np.abs(both.test.en).max()),
        },
        methods=evidence.methods(own, tracker),
        **parts,
    )


def _calibration(
    origin: Provenance,
    *,
    method: str,
    reasons: Sequence[str],
    warnings: Sequence[str],
    angles: _Angles,
    budget: Mapping[str, FloatArray],
    zero: FloatArray,
    zero_std: FloatArray,
    sensitivity: FloatArray | None = None,
    advice: Sequence[str] = (),
    exact: Sequence[ExactQuantity] = (),
    **parts: Any,
) -> Calibration:
    names, axes = origin.rig.rig.supports, origin.rig.rig.axes
    rpy, quaternion = so3.to_rpy(angles.rotation), so3.to_quaternion(angles.rotation)
    nobody: dict[str, Any] = {
        "rotation": None,
        "rpy": (None,) * 3,
        "rpy_std": (None,) * 3,
        "rpy_interval": None,
        "quaternion_xyzw": None,
    }
    locked, turns = so3.locked(angles.rotation), turn_std(angles.covariance)
    stand = np.repeat(angles.determined, 3)
    covariance = angles.covariance[np.ix_(stand, stand)]
    supports = [
        {
            "name": name,
            **(
                {
                    "rotation": angles.rotation[i],
                    "rpy": rpy[i],
                    "rpy_std": (None,) * 3 if locked[i] else angles.std[i],
                    "turn_std": turns[i],
                    "rpy_interval": {
                        "coverage": INTERVAL_COVERAGE,
                        "low": angles.low[i],
                        "high": angles.high[i],
                    },
                    "quaternion_xyzw": quaternion[i],
                }
                if angles.determined[i]
                else nobody | {"directions": _directions(origin, angles.rotation[i], i)}
            ),
            "zero": _measured(zero[i], axes[i]),
            "zero_std": _measured(none_where_open(zero_std[i]), axes[i]),
            "sensitivity": None if sensitivity is None else sensitivity[i],
        }
        for i, name in enumerate(names)
    ]
    document = {
        "format": CALIBRATION_FORMAT,
        "status": "rejected" if reasons else "accepted",
        "method": method,
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "measured": None if origin.measured is None else measured_document(origin.measured),
        "campaigns": origin.campaigns,
        "history": origin.history,
        "rig": {**origin.rig.document, "sha256": origin.rig.sha256},
        "software": {"name": "tdfscal", "version": __version__},
        "command": origin.command,
        "seed": origin.seed,
        "inputs": origin.inputs,
        "convention": CONVENTION if sensitivity is None else CONVENTION_WITH_SENSITIVITY,
        "supports": supports,
        "covariance": {
            "parameters": parameter_names(
                tuple(n for n, known in zip(names, angles.determined, strict=True) if known)
            ),
            "definition": COVARIANCE_DEFINITION,
            "matrix": (covariance + covariance.T) / 2,
        },
        "budget": _budget(names, budget, angles.determined),
        "taken_as_exact": [_exact(names, angles, quantity) for quantity in exact],
        "quality": {"reasons": tuple(reasons), "advice": tuple(advice)},
        "warnings": (*warnings, *locked_warnings(names, angles.rotation)),
    }
    return Calibration.model_validate(document | parts)


def _advice(result: SelfCalibration) -> tuple[str, ...]:
    """Cures of what the residuals say, each once, that of the surest finding first."""
    cures: dict[str, str] = {}
    for doubt in result.suspicions:  # one key of the rig file is one cure, whatever its size
        act, _, rest = doubt.advice.partition(": ")
        cures.setdefault(act + rest.rpartition("`")[2], doubt.advice)
    return tuple(cures.values())


def _measured(values: Sequence[Any], axes: Sequence[bool]) -> tuple[Any, ...]:
    """Values per axis; None for an axis that is not measured."""
    return tuple(v if there else None for v, there in zip(values, axes, strict=True))


def _directions(origin: Provenance, rotation: FloatArray, index: int) -> dict[str, FloatArray]:
    """Directions in the BCS of the axes that a sensor measures."""
    axes = origin.rig.rig.axes[index]
    return {name: rotation[:, j] for j, name in enumerate("xyz") if axes[j]}


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
        "terminal": _terminal(
            state.mass, std[place["mass"]], state.barycentre, std[place["barycentre"]]
        ),
        "fit": _fit(result) | _totals(origin.campaigns),
        "postures": evidence.postures(result),
        "dwells": evidence.dwells(result),
        "observability": _observability(result.observability) | {"loads": evidence.loads(result)},
        "monte_carlo": _trials(
            trials,
            origin.seed,
            result.uncertainty.rpy_std,
            validated=trials is not None and trials.validated,
        ),
        "validation": _validation(result),
        "stability": result.stability,
        "conformity": _conformity(result.conformity),
        **({} if result.estimator == "linear" or origin.campaigns else nuisance_documents(result)),
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


def _terminal(
    mass: FloatArray, mass_std: FloatArray, bary: FloatArray, bary_std: FloatArray
) -> dict[str, Any]:
    return {
        "mass": {"value": float(mass), "std": np.reshape(mass_std, 1)[0]},
        "barycenter": {"value": bary, "std": bary_std},
    }


def _self_angles(result: SelfCalibration) -> _Angles:
    spread, rpy = result.uncertainty, so3.to_rpy(result.fit.state.rotation)
    low = rpy - spread.coverage_factor * spread.rpy_std
    high = rpy + spread.coverage_factor * spread.rpy_std
    trials = result.monte_carlo
    if trials is not None and not trials.validated:
        low, high = trials.low, trials.high
    return _Angles(
        result.fit.state.rotation,
        spread.covariance,
        spread.rpy_std,
        low,
        high,
        result.observability.determined,
    )


def _tracker_angles(result: TrackerCalibration) -> _Angles:
    found = result.rotations
    low, high = result.low, result.high
    if result.monte_carlo is not None and not result.monte_carlo.linear_interval_validated:
        low, high = result.monte_carlo.low, result.monte_carlo.high
    known = np.ones(len(low), dtype=np.bool_)
    return _Angles(found.rotation, found.covariance, result.rpy_std, low, high, known)


def _fit(result: SelfCalibration) -> dict[str, Any]:
    dwells = result.dwells
    return {
        "postures": len(dwells) - len(result.rejected),
        "rejected": [
            {"index": k, "start": dwells.start[k], "end": dwells.end[k], "reason": reason}
            for k, reason in sorted(result.rejected.items())
        ],
        **asdict(result.quality),
        "iterations": result.fit.iterations,
        "converged": result.fit.converged,
    }


def _totals(campaigns: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What `fit` says of all campaigns together, where there are several."""
    if not campaigns:
        return {}
    chi2, dof = (sum(campaign[name] for campaign in campaigns) for name in ("chi2", "dof"))
    return {
        "postures": sum(campaign["postures"] for campaign in campaigns),
        "chi2": chi2,
        "dof": dof,
        "p_value": float(chi2_sf(chi2, dof)) if dof else 1.0,
        "birge": float(np.sqrt(chi2 / dof)) if dof else 1.0,
    }


def _observability(seen: Observability) -> dict[str, Any]:
    cause = "the smallest load across the direction of this turn"
    return {
        "verdict": seen.verdict,
        "weakest": {"name": seen.weakest.name, "std": seen.weakest.std, "cause": cause},
        "angles": [
            asdict(a)
            | {"prior_std": np.float64(a.prior_std)}
            | ({"std": None} if a.support in seen.undetermined else {})
            for a in seen.angles
        ],
        "weak": [
            {"name": w.angle.name, "cause": w.cause, "advice": w.advice} for w in seen.lacking
        ],
        "correlations": seen.correlations,
    }


def _budget(
    names: Sequence[str], shares: Mapping[str, FloatArray], determined: BoolArray
) -> dict[str, Any]:
    """Variances by source of the angles that are determined; sources without any are left out."""
    sources = [source for source, variance in shares.items() if np.any(variance[determined] > 0)]
    return {
        "sources": sources,
        "angles": [
            {
                "support": name,
                "angle": angle,
                "variance": {source: float(max(0.0, shares[source][i, j])) for source in sources},
            }
            for i, name in enumerate(names)
            if determined[i]
            for j, angle in enumerate(ANGLES)
        ],
    }


def _exact(names: Sequence[str], angles: _Angles, quantity: ExactQuantity) -> dict[str, Any]:
    """Effect of a quantity's typical error on the sensors that are determined."""
    covariance, locked = quantity.covariance, so3.locked(angles.rotation)
    turn = np.sqrt(np.diagonal(covariance)).reshape(-1, 3)
    rpy = np.sqrt(np.maximum(so3.rpy_variance(angles.rotation, covariance), 0.0))
    return {
        "name": quantity.name,
        "error": quantity.error,
        "unit": quantity.unit,
        "supports": [
            {"name": name, "turn": turn[i], "rpy": None if locked[i] else rpy[i]}
            for i, name in enumerate(names)
            if angles.determined[i]
        ],
    }


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


def _trials(
    trials: MonteCarlo | TrackerMonteCarlo | None,
    seed: int,
    rpy_std: FloatArray,
    *,
    validated: bool,
) -> dict[str, Any] | None:
    """Monte Carlo of either method."""
    if trials is None:
        return None
    return {
        "trials": trials.trials,
        "seed": seed,
        "rpy_std": trials.std,
        "low": trials.low,
        "high": trials.high,
        "tolerance": float(trials.tolerance.min()),
        "linear_interval_validated": validated,
        "histogram": evidence.histogram(trials.sample, rpy_std),
    }


def _validation(result: SelfCalibration) -> dict[str, Any]:
    before, after = result.validation.before, result.validation.after
    columns = (before.rms(), after.rms(), before.largest(), after.largest())
    names = ("rms_before", "rms_after", "max_before", "max_after")
    force, moment = (dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True))
    count = len(result.validation.index)
    return {
        "method": "leave one posture out",
        "postures": count,
        "force": force,
        "moment": moment,
    }


def _conformity(judged: Conformity | None) -> dict[str, Any] | None:
    if judged is None:
        return None
    parts = {
        part.quantity: {
            "expanded_uncertainty": part.expanded,
            "limit": np.float64(part.limit),
            "probability_exceeding": part.exceeding,
            "conforms": part.conforms,
        }
        for part in (judged.force, judged.torque)
    }
    return {"rpy": judged.rpy, **parts}


def _tracker_statistics(result: TrackerCalibration) -> dict[str, Any]:
    return {
        "chi2": result.chi2,
        "dof": result.dof,
        "p_value": result.p_value,
        "birge": result.birge,
        "points": len(result.point_names),
        "rejected": [point.name for point in result.rejected],
        "coplanar_targets": list(result.coplanar_targets),
        "rms_residual": float(np.sqrt(np.mean(np.sum(result.residual**2, axis=1)))),
        "residuals": evidence.survey_residuals(result),
    }
