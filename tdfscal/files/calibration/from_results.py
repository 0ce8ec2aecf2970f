"""From a result's records to the calibration file, for each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal import __version__
from tdfscal.acceptance import assess_stated, locked_sensors
from tdfscal.catalogue import documents
from tdfscal.estimation.exact_quantities import exact_quantities
from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.observability import LONGER, prospect
from tdfscal.estimation.uncertainty import with_sources_of_earlier
from tdfscal.files.calibration import evidence, statistics
from tdfscal.files.calibration import parts as keys
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import (
    angles_document,
    exact_moves_document,
    parameter_rows,
    parameters_document,
    status_of,
    turn_parameters,
    zeros_and_load,
)
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, nominal, placed, prior_std, symmetric
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, MonteCarlo
from tdfscal.records import (
    BoolArray,
    ExactMoves,
    FloatArray,
    InputFile,
    Measured,
    RecorderClock,
    Rig,
)
from tdfscal.selfcal.result import SelfCalibration, prospects
from tdfscal.significance import INTERVAL_COVERAGE

if TYPE_CHECKING:
    from tdfscal.comparison.compatibility import Joint
    from tdfscal.motioncal.pipeline import MotionCalibration
    from tdfscal.trackercal import TrackerCalibration


@record
class Provenance:
    """Where a result comes from, as the file's keys have it."""

    rig: LoadedRig
    inputs: tuple[InputFile, ...]
    command: str
    seed: int
    measured: Measured
    campaigns: tuple[evidence.CampaignResult, ...] = ()
    history: tuple[keys.HistoryEntry, ...] = ()
    clocks: tuple[RecorderClock, ...] = ()


@record
class Angles:
    """Rotations (n, 3, 3), their covariance (3n, 3n), and which of them the data determine, (n,).

    trials : of their Monte Carlo. factor : k of the linear intervals; the trials' own stand where
    they do not validate these.
    """

    rotation: FloatArray
    covariance: FloatArray
    determined: BoolArray
    trials: MonteCarlo | None = None
    factor: FloatArray | float = INTERVAL_FACTOR


def from_self(
    result: SelfCalibration | MotionCalibration, origin: Provenance, notes: Sequence[Finding] = ()
) -> Calibration:
    """Return the calibration file of a self-calibration, from postures or in motion."""
    found = result.uncertainty
    std, parts = found.parameter_std, _own_parts(result, origin)
    if isinstance(result, SelfCalibration):
        state = result.fit.state
        if result.estimator == "ml":  # the linear method takes zeros and load as they are stated
            given = result.calibrated
            std = published_std(given, std)
            parts["parameters"] = parameters_document(given, _unscaled(result))
    else:
        state, std = result.fit.state.still, published_std(result.calibrated, std)
        parts["parameters"] = parameters_document(result.calibrated)
        parts["motion"] = statistics.motion(result, evidence.has_delay(origin.clocks))
    determined = result.observability.determined
    return _file(
        origin,
        Angles(
            state.rotation, found.covariance, determined, result.monte_carlo, found.coverage_factor
        ),
        (*result.reasons, *notes, *(one for one in result.findings if not one.rejects)),
        with_sources_of_earlier(found.contributions, result.fit.rig.earlier),
        exact_quantities(result.fit, result.estimate.parts),
        parts | _state(state, std, result.rig),
    )


def from_tracker(
    result: TrackerCalibration, origin: Provenance, notes: Sequence[Finding]
) -> Calibration:
    """Return the calibration file of a laser-tracker calibration: zeros and load as stated.

    notes : findings beside its own.
    """
    rig, at = origin.rig.rig, result.rotations
    parts = {"method": "tracker", "tracker": statistics.tracker_statistics(result)}
    return _file(
        origin,
        Angles(at.rotation, at.covariance, np.ones(rig.n, dtype=np.bool_), result.monte_carlo),
        (*notes, *result.findings),
        result.budget,
        result.exact,
        parts | _state(nominal(rig), prior_std(rig), rig) | {"sensitivity": None},
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
    given = own.estimate.calibrated_at(C, R)
    determined = np.all(both.rpy_std < own.rig.acceptance.identifiable, axis=1)
    test = {
        "consistency_p_value": both.test.p_value,
        "largest_en": float(np.abs(both.test.en).max()),
    }
    parts = _own_parts(own, origin)
    parts |= {
        "method": "joint",
        "conformity": assess_stated(given),
        "parameters": parameters_document(given),
        "tracker": statistics.tracker_statistics(tracker) | test,
    }
    # With its weight in the joint estimate, C C_a⁻¹, each method moves it by what it has as exact,
    # and has the share C C_a⁻¹ C of its covariance, whose sum is C.
    # Zeros and load follow the turns by their correlation.
    of_self, of_tracker = (
        np.asarray(np.linalg.solve(covariance, C).T)
        for covariance in (own.uncertainty.covariance, tracker.rotations.covariance)
    )
    follow = np.asarray(np.linalg.solve(C, given.covariance[: len(C)]).T)
    exact = [
        _followed(one, of_self, follow) for one in exact_quantities(own.fit, own.estimate.parts)
    ]
    exact += [_followed(one, of_tracker, follow) for one in tracker.exact]
    return _file(
        origin,
        Angles(R, C, determined),
        findings,
        {
            "self-calibration": so3.rpy_variance(R, of_self @ C),
            "tracker": so3.rpy_variance(R, of_tracker @ C),
        },
        exact,
        parts | _state(given.state, published_std(given, own.uncertainty.parameter_std), own.rig),
    )


def _followed(one: ExactMoves, weight: FloatArray, follow: FloatArray) -> ExactMoves:
    """Moves of all parameters (P,) where the turns are weighted with those of another method.

    weight : (3n, 3n), of this method. follow : (P, 3n), moves of all by turns.
    """
    sides = {}
    for side in ("common", "apart"):
        moves = getattr(one, side)
        turns = moves[: len(weight)]
        # A tracker knows no more than turns.
        whole = moves if len(moves) > len(turns) else follow @ turns
        sides[side] = whole + follow @ (weight @ turns - turns)
    return replace(one, **sides)


def _own_parts(result: SelfCalibration | MotionCalibration, origin: Provenance) -> dict[str, Any]:
    """What a self-calibration says of itself, of postures or in motion."""
    seen = statistics.observability(result.observability) | {"forecasts": _forecasts(result)}
    parts = {
        "method": "self",
        "estimator": "ml",
        "fit": statistics.fit(result, origin.campaigns),
        "observability": seen,
        "validation": statistics.validation(result),
        "conformity": result.conformity,
    }
    if not isinstance(result, SelfCalibration):
        return parts
    if result.with_moves is not None:
        stand = result.with_moves[result.observability.determined]
        seen["with_moves"] = np.sqrt(np.mean(stand**2))
    return parts | {
        "estimator": result.estimator,
        "postures": statistics.postures(result),
        "dwells": statistics.dwells(result),
        "drift": None if result.estimator == "linear" else statistics.drift(result),
    }


def _forecasts(result: SelfCalibration | MotionCalibration) -> list[dict[str, Any]]:
    """What changes of the campaign would bring, where its angles stand."""
    if not result.observability.determined.all() or result.reasons:
        return []
    if isinstance(result, SelfCalibration):
        found = prospects(result.estimate)
    else:
        longer = LONGER * result.seconds
        found = (prospect(result.estimate, "seconds", longer, count=LONGER),)
    return [{"change": p.change, "amount": p.amount, "worst_std": p.rpy_std.max()} for p in found]


def _state(state: State, std: FloatArray, rig: Rig) -> dict[str, Any]:
    """Zeros, sensitivities and load; std (P,) of the state's parameters."""
    scaled = rig.declared.force_sensitivity > 0
    scale = np.eye(3) + symmetric(state.sensitivity) if scaled else None
    return zeros_and_load(state, placed(state, std), rig.axes) | {"sensitivity": scale}


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


def _file(
    origin: Provenance,
    angles: Angles,
    findings: Sequence[Finding],
    budget: Mapping[str, FloatArray],
    exact: Sequence[ExactMoves],
    parts: dict[str, Any],
) -> Calibration:
    """Return the file of what every method has; parts : further keys, and those of each support."""
    rig, R = origin.rig.rig, angles.rotation
    stand = np.repeat(angles.determined, 3)
    covariance = angles.covariance[np.ix_(stand, stand)]
    found = documents((*findings, *locked_sensors(rig.supports, R)))
    names = tuple(compress(rig.supports, angles.determined))
    own = {name: parts.pop(name) for name in ("zero", "zero_std", "sensitivity")}
    scaled, turns = own["sensitivity"] is not None, {"parameters": turn_parameters(names)}
    rows = parameter_rows(parts.get("parameters", turns)["parameters"], rig.supports)
    status = status_of((f["code"], f["severity"]) for f in found)
    return Calibration.model_validate(
        {
            "format": keys.CALIBRATION_FORMAT,
            "status": status,
            "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            **vars(origin),
            "rig": origin.rig.document,
            "software": {"name": "tdfscal", "version": __version__},
            "convention": keys.CONVENTION_WITH_SENSITIVITY if scaled else keys.CONVENTION,
            "supports": _supports(rig, angles, own),
            "covariance": {
                **turns,
                "definition": keys.COVARIANCE_DEFINITION,
                "matrix": (covariance + covariance.T) / 2,
            },
            "budget": statistics.budget(rig.supports, budget, angles.determined),
            "taken_as_exact": [
                {"effect": _effect(angles, quantity), **exact_moves_document(quantity, rows)}
                for quantity in exact
            ],
            "monte_carlo": statistics.trials(angles.trials),
            "findings": found,
            **parts,
            "conformity": statistics.conformity(
                parts.get("conformity"), rejected=status == "rejected"
            ),
        }
    )


def _supports(rig: Rig, angles: Angles, own: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What each sensor's entry says; one that is undetermined has the directions of its axes.

    own : further keys, a row per sensor.
    """
    R, determined, known = angles.rotation, angles.determined, _stated(angles, angles.covariance)
    rpy, std = known["rpy"], known["rpy_std"]
    ends = rpy - angles.factor * std, rpy + angles.factor * std
    if angles.trials is not None and angles.trials.decides:
        ends = angles.trials.low, angles.trials.high
    low, high = (np.where(np.isinf(std), np.inf, end) for end in ends)
    columns = {name: values for name, values in own.items() if values is not None}
    columns |= {"rpy": np.where(determined[:, None], rpy, np.inf), "rpy_std": std}
    supports: list[dict[str, Any]] = []
    for i, name in enumerate(rig.supports):
        entry: dict[str, Any] = {"name": name} | {key: v[i] for key, v in columns.items()}
        entry |= dict.fromkeys(("rotation", "rpy_interval", "quaternion_xyzw"))
        if determined[i]:
            entry |= {"rotation": R[i]}
            entry |= {key: known[key][i] for key in ("turn_std", "quaternion_xyzw")}
            entry["rpy_interval"] = {"coverage": INTERVAL_COVERAGE, "low": low[i], "high": high[i]}
        else:
            axes = zip("xyz", R[i].T, rig.axes[i], strict=True)
            entry["directions"] = {axis: line for axis, line, used in axes if used}
        supports.append(entry)
    return supports


def _stated(angles: Angles, covariance: FloatArray) -> dict[str, FloatArray]:
    """What is stated of the angles by a covariance; ∞ for a sensor that is undetermined."""
    known = angles_document(angles.rotation, covariance)
    std = np.where(angles.determined[:, None], known["rpy_std"], np.inf)
    return known | {"rpy_std": std}


def _effect(angles: Angles, quantity: ExactMoves) -> FloatArray:
    """Effect (k, 3), rad, of a quantity's typical error on the sensors that are determined."""
    turns = quantity.turns(len(angles.rotation))
    known = _stated(angles, turns @ turns.T)
    effect = np.where(np.isinf(known["rpy_std"]), known["turn_std"], known["rpy_std"])
    return effect[angles.determined]
