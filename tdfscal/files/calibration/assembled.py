"""The calibration file put together from what every method has: angles, covariance, budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import compress
from typing import Any

import numpy as np

from tdfscal import __version__
from tdfscal.acceptance.turns import locked_sensors, turn_std
from tdfscal.catalogue import documents
from tdfscal.estimation.exact_quantities import ExactQuantity
from tdfscal.files.calibration.consistency import status_of
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.parameters import turn_parameters
from tdfscal.files.calibration.parts import (
    CALIBRATION_FORMAT,
    CONVENTION,
    CONVENTION_WITH_SENSITIVITY,
    COVARIANCE_DEFINITION,
    EDGES,
    measured_document,
)
from tdfscal.files.field_types import measured_only
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.findings import Finding
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo, coverage_factor
from tdfscal.records import ANGLES, BoolArray, FloatArray, InputFile, Measured, RecorderClock, Rig
from tdfscal.significance import INTERVAL_COVERAGE

_NORMAL = float(coverage_factor(INTERVAL_COVERAGE))


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
    clocks: tuple[RecorderClock, ...] = ()


@dataclass(frozen=True, slots=True)
class Angles:
    """Rotations (n, 3, 3), their covariance (3n, 3n), and which of them the data determine, (n,).

    trials : of their Monte Carlo. factor : k of the linear intervals; the trials' own stand where
    they do not validate these.
    """

    rotation: FloatArray
    covariance: FloatArray
    determined: BoolArray
    trials: MonteCarlo | None = None
    factor: FloatArray | float = _NORMAL

    @property
    def std(self) -> FloatArray:
        """Standard uncertainty (n, 3) of roll, pitch, yaw, rad."""
        return np.asarray(np.sqrt(np.maximum(self.variance(self.covariance), 0.0)))

    def variance(self, covariance: FloatArray) -> FloatArray:
        """Variance (n, 3), rad², of roll, pitch, yaw by a covariance (3n, 3n) of the turns."""
        return so3.rpy_variance(self.rotation, covariance)


def assembled(
    origin: Provenance,
    angles: Angles,
    *,
    method: str,
    findings: Sequence[Finding],
    budget: Mapping[str, FloatArray],
    exact: Sequence[ExactQuantity],
    zero: FloatArray,
    zero_std: FloatArray,
    sensitivity: FloatArray | None = None,
    **parts: Any,
) -> Calibration:
    """Return the file's model of a result; parts : its further keys."""
    rig = origin.rig.rig
    stand = np.repeat(angles.determined, 3)
    covariance = angles.covariance[np.ix_(stand, stand)]
    found = documents((*findings, *locked_sensors(rig.supports, angles.rotation)))
    document = {
        "format": CALIBRATION_FORMAT,
        "status": status_of((f["code"], f["severity"]) for f in found),
        "method": method,
        "created": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "measured": measured_document(origin.measured),
        "campaigns": origin.campaigns,
        "history": origin.history,
        "rig": {**origin.rig.document, "sha256": origin.rig.sha256},
        "software": {"name": "tdfscal", "version": __version__},
        "command": origin.command,
        "seed": origin.seed,
        "inputs": origin.inputs,
        "clocks": origin.clocks,
        "convention": CONVENTION if sensitivity is None else CONVENTION_WITH_SENSITIVITY,
        "supports": _supports(rig, angles, zero, zero_std, sensitivity),
        "covariance": {
            "parameters": turn_parameters(tuple(compress(rig.supports, angles.determined))),
            "definition": COVARIANCE_DEFINITION,
            "matrix": (covariance + covariance.T) / 2,
        },
        "budget": _budget(rig.supports, budget, angles.determined),
        "taken_as_exact": [_exact(rig.supports, angles, quantity) for quantity in exact],
        "monte_carlo": _trials(angles),
        "findings": found,
    }
    return Calibration.model_validate(document | parts)


def _supports(
    rig: Rig,
    angles: Angles,
    zero: FloatArray,
    zero_std: FloatArray,
    sensitivity: FloatArray | None,
) -> list[dict[str, Any]]:
    """What each sensor's entry says; one that is undetermined has the directions of its axes."""
    R, std, known = angles.rotation, angles.std, angles.determined[:, None]
    rpy, quaternion, turns = so3.to_rpy(R), so3.to_quaternion(R), turn_std(angles.covariance)
    half = angles.factor * std
    low, high = rpy - half, rpy + half
    if angles.trials is not None and not angles.trials.validated:
        low, high = angles.trials.low, angles.trials.high
    stated = np.where(known, rpy, np.inf)
    separable = known & ~so3.locked(R)[:, None]
    stated_std = np.where(separable, std, np.inf)
    low, high = np.where(separable, low, np.inf), np.where(separable, high, np.inf)
    zeros, zero_stds = measured_only(zero, rig.axes), measured_only(zero_std, rig.axes)
    supports: list[dict[str, Any]] = []
    for i, name in enumerate(rig.supports):
        axes = {axis: R[i, :, j] for j, axis in enumerate("xyz") if rig.axes[i, j]}
        ends = {"coverage": INTERVAL_COVERAGE, "low": low[i], "high": high[i]}
        mounting = {
            "rotation": R[i],
            "turn_std": turns[i],
            "rpy_interval": ends,
            "quaternion_xyzw": quaternion[i],
        }
        absent = {**dict.fromkeys(mounting), "directions": axes}
        supports.append(
            {
                "name": name,
                "rpy": stated[i],
                "rpy_std": stated_std[i],
                "zero": zeros[i],
                "zero_std": zero_stds[i],
                "sensitivity": None if sensitivity is None else sensitivity[i],
                **(mounting if angles.determined[i] else absent),
            }
        )
    return supports


def _trials(angles: Angles) -> dict[str, Any] | None:
    """Monte Carlo of either method, with its trials in bins of the linear standard uncertainty."""
    trials = angles.trials
    if trials is None:
        return None
    columns = np.moveaxis(trials.sample / angles.std, 0, -1)
    return {
        "trials": trials.trials,
        "rpy_std": trials.std,
        "low": trials.low,
        "high": trials.high,
        "tolerance": float(trials.tolerance.min()),
        "linear_interval_validated": trials.validated,
        "histogram": [[np.histogram(angle, EDGES)[0] for angle in three] for three in columns],
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


def _exact(names: Sequence[str], angles: Angles, quantity: ExactQuantity) -> dict[str, Any]:
    """Effect of a quantity's typical error on the sensors that are determined."""
    locked, turn = so3.locked(angles.rotation), turn_std(quantity.covariance)
    rpy = np.sqrt(np.maximum(angles.variance(quantity.covariance), 0.0))
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
