"""From a result's records to the calibration file, for each method."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from tdfscal import __version__
from tdfscal.acceptance import assess_stated, locked_sensors
from tdfscal.catalogue import documents, sentence
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
    finite,
    parameter_rows,
    parameters_document,
    status_of,
    turn_parameters,
    zeros_and_load,
)
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding
from tdfscal.frozen import record
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
from tdfscal.selfcal.estimator import prospects
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.significance import INTERVAL_COVERAGE

if TYPE_CHECKING:
    from tdfscal.comparison.compatibility import Joint
    from tdfscal.motioncal.pipeline import MotionCalibration
    from tdfscal.trackercal.pipeline import TrackerCalibration


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
    known, given, std = result.uncertainty, result.calibrated, result.uncertainty.parameter_std
    parts = _own_parts(result, origin)
    if parts["estimator"] == "ml":  # the linear method takes zeros and load as they are stated
        unscaled = None
        if isinstance(result, SelfCalibration):  # by the stated uncertainties, for `update`
            turns = np.flatnonzero(np.repeat(result.observability.determined, 3))
            root = factored_information(result.fit).root[turns]
            unscaled = root @ root.T
        parts["parameters"] = parameters_document(given, unscaled)
        std = published_std(given, std)
    state, determined = result.fit.still, result.observability.determined
    return _file(
        origin,
        Angles(
            state.rotation, known.covariance, determined, result.monte_carlo, known.coverage_factor
        ),
        (*result.reasons, *notes, *(one for one in result.findings if not one.rejects)),
        with_sources_of_earlier(known.contributions, result.fit.rig.earlier),
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
    std = np.sqrt(so3.rpy_variance(R, C))
    given = own.estimate.calibrated_at(C, R)
    parts = _own_parts(own, origin)
    parts |= {
        "method": "joint",
        "conformity": statistics.conformity(assess_stated(given)),
        "parameters": parameters_document(given),
        "tracker": {
            **statistics.tracker_statistics(tracker),
            "consistency_p_value": both.test.p_value,
            "largest_en": np.abs(both.test.en).max(),
        },
    }
    # With its weight in the joint estimate, C C_a⁻¹, each method moves it by what it has as exact,
    # and has the share C C_a⁻¹ C of its covariance, whose sum is C.
    # Zeros and load follow the turns by their correlation.
    of_self, of_tracker = (
        np.asarray(np.linalg.solve(covariance, C).T)
        for covariance in (own.uncertainty.covariance, tracker.rotations.covariance)
    )
    follow = np.asarray(np.linalg.solve(C, given.covariance[: len(C)]).T)
    moved = np.eye(len(follow))
    moved[:, : len(C)] += follow @ (of_self - np.eye(len(C)))
    exact = [one.by(moved) for one in exact_quantities(own.fit, own.estimate.parts)]
    exact += [one.by(follow @ of_tracker) for one in tracker.exact]
    return _file(
        origin,
        Angles(R, C, np.all(std < own.rig.acceptance.identifiable, axis=1)),
        findings,
        {
            "self-calibration": so3.rpy_variance(R, of_self @ C),
            "tracker": so3.rpy_variance(R, of_tracker @ C),
        },
        exact,
        parts | _state(given.state, published_std(given, own.uncertainty.parameter_std), own.rig),
    )


def _own_parts(result: SelfCalibration | MotionCalibration, origin: Provenance) -> dict[str, Any]:
    """What a self-calibration says of itself, of postures or in motion."""
    verdict = sentence(result.observability.finding)
    seen: dict[str, Any] = {"verdict": verdict, "forecasts": _forecasts(result)}
    parts = {
        "method": "self",
        "estimator": "ml",
        "fit": statistics.fit(result, origin.campaigns),
        "observability": seen,
        "validation": statistics.validation(result),
        "conformity": statistics.conformity(result.conformity),
    }
    if not isinstance(result, SelfCalibration):
        return parts | {"motion": statistics.motion(result, evidence.has_delay(origin.clocks))}
    if result.with_moves is not None:
        stand = result.with_moves[result.observability.determined]
        seen["with_moves"] = np.sqrt(np.mean(stand**2))
    return parts | {
        "estimator": result.estimator,
        "postures": statistics.postures(result),
        "dwells": statistics.dwells(result),
        "drift": statistics.drift(result),
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


def _file(
    origin: Provenance,
    angles: Angles,
    findings: Sequence[Finding],
    budget: Mapping[str, FloatArray],
    exact: Sequence[ExactMoves],
    parts: dict[str, Any],
) -> Calibration:
    """Return the file of what every method has; parts : further keys, and those of each support."""
    rig, R, determined = origin.rig.rig, angles.rotation, angles.determined
    stand, trials = np.repeat(determined, 3), angles.trials
    covariance = angles.covariance[np.ix_(stand, stand)]
    found = documents((*map(origin.rig.written, findings), *locked_sensors(rig.supports, R)))
    own = {name: parts.pop(name) for name in ("zero", "zero_std", "sensitivity")}
    turns = {"parameters": turn_parameters(tuple(compress(rig.supports, determined)))}
    rows = parameter_rows(parts.get("parameters", turns)["parameters"], rig.supports)
    taken = list[dict[str, Any]]()
    for quantity in exact:  # what a typical error of it does to the sensors that are determined
        moved = quantity.turns(len(R))
        known = angles_document(R, moved @ moved.T, determined)
        effect = np.where(np.isinf(known["rpy_std"]), known["turn_std"], known["rpy_std"])
        taken.append({"effect": effect[determined], **exact_moves_document(quantity, rows)})
    content = {
        "format": keys.CALIBRATION_FORMAT,
        "status": status_of((f["code"], f["severity"]) for f in found),
        "created": keys.instant(time.time()),
        **vars(origin),
        "measured": keys.MeasuredResult.of(origin.measured),
        "clocks": [{n: v for n, v in vars(c).items() if n != "reference"} for c in origin.clocks],
        "rig": origin.rig.document,
        "software": {"name": "tdfscal", "version": __version__},
        "convention": keys.CONVENTIONS[own["sensitivity"] is not None],
        "supports": _supports(rig, angles, own),
        "covariance": {
            **turns,
            "definition": keys.COVARIANCE_DEFINITION,
            "matrix": (covariance + covariance.T) / 2,
        },
        "budget": statistics.budget(rig.supports, budget, determined),
        "taken_as_exact": taken,
        "monte_carlo": trials
        and {
            "trials": trials.trials,
            "tolerance": trials.tolerance.min(),
            "linear_interval_validated": trials.validated,
        },
        "findings": found,
        **parts,
    }
    return Calibration.model_validate(finite(content))


def _supports(rig: Rig, angles: Angles, own: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What each sensor's entry says; one that is undetermined has the directions of its axes.

    own : further keys, a row per sensor.
    """
    R, determined, trials = angles.rotation, angles.determined, angles.trials
    known = angles_document(R, angles.covariance, determined)
    half = np.where(np.isinf(known["rpy_std"]), 0.0, angles.factor * known["rpy_std"])
    ends = known["rpy"] - half, known["rpy"] + half
    if trials is not None and trials.decides:
        ends = trials.low, trials.high
    low, high = (np.where(np.isinf(known["rpy_std"]), np.inf, end) for end in ends)
    columns = {name: values for name, values in own.items() if values is not None}
    columns |= {name: known[name] for name in ("rpy", "rpy_std")}
    of_rotation = {"rotation": R} | {n: known[n] for n in ("turn_std", "quaternion_xyzw")}
    supports: list[dict[str, Any]] = []
    for i, name in enumerate(rig.supports):
        entry: dict[str, Any] = {"name": name} | {key: v[i] for key, v in columns.items()}
        if determined[i]:
            entry |= {key: v[i] for key, v in of_rotation.items()}
            entry["rpy_interval"] = {"coverage": INTERVAL_COVERAGE, "low": low[i], "high": high[i]}
        else:
            axes = zip("xyz", R[i].T, rig.axes[i], strict=True)
            entry["directions"] = {axis: line for axis, line, used in axes if used}
        supports.append(entry)
    return supports
