"""The calibration file put together from what every method has: angles, covariance, budget."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from tdfscal import __version__
from tdfscal.acceptance.turns import locked_warnings, turn_std
from tdfscal.errors import visible
from tdfscal.files.calibration.document import Calibration
from tdfscal.files.calibration.life import measured_document
from tdfscal.files.calibration.parameters import turn_parameters
from tdfscal.files.calibration.parts import (
    CALIBRATION_FORMAT,
    CONVENTION,
    CONVENTION_WITH_SENSITIVITY,
    COVARIANCE_DEFINITION,
    measured_only,
)
from tdfscal.files.rig.reading import LoadedRig
from tdfscal.numerics import so3
from tdfscal.records import ANGLES, BoolArray, FloatArray, InputFile, Measured
from tdfscal.selfcal.exact_quantities import ExactQuantity
from tdfscal.significance import INTERVAL_COVERAGE


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
class Angles:
    """Rotations (n, 3, 3), their covariance (3n, 3n), and intervals (n, 3), rad."""

    rotation: FloatArray
    covariance: FloatArray
    std: FloatArray
    low: FloatArray
    high: FloatArray
    determined: BoolArray


def assembled(
    origin: Provenance,
    *,
    method: str,
    reasons: Sequence[str],
    warnings: Sequence[str],
    angles: Angles,
    budget: Mapping[str, FloatArray],
    zero: FloatArray,
    zero_std: FloatArray,
    sensitivity: FloatArray | None = None,
    advice: Sequence[str] = (),
    exact: Sequence[ExactQuantity] = (),
    **parts: Any,
) -> Calibration:
    """Return the file's model of a result; parts : its further keys."""
    names = origin.rig.rig.supports
    stand = np.repeat(angles.determined, 3)
    covariance = angles.covariance[np.ix_(stand, stand)]
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
        "supports": _supports(origin, angles, zero, zero_std, sensitivity),
        "covariance": {
            "parameters": turn_parameters(tuple(np.array(names)[angles.determined].tolist())),
            "definition": COVARIANCE_DEFINITION,
            "matrix": (covariance + covariance.T) / 2,
        },
        "budget": _budget(names, budget, angles.determined),
        "taken_as_exact": [_exact(names, angles, quantity) for quantity in exact],
        "quality": {"reasons": tuple(reasons), "advice": tuple(advice)},
        # Names in files of others may hold control characters.
        "warnings": (*map(visible, warnings), *locked_warnings(names, angles.rotation)),
    }
    return Calibration.model_validate(document | parts)


def _supports(
    origin: Provenance,
    angles: Angles,
    zero: FloatArray,
    zero_std: FloatArray,
    sensitivity: FloatArray | None,
) -> list[dict[str, Any]]:
    """What each sensor's entry says; one that is undetermined has the directions of its axes."""
    axes = origin.rig.rig.axes
    rpy, quaternion = so3.to_rpy(angles.rotation), so3.to_quaternion(angles.rotation)
    locked, turns = so3.locked(angles.rotation), turn_std(angles.covariance)
    zeros, zero_stds = measured_only(zero, axes), measured_only(zero_std, axes)
    nobody = (None,) * 3
    supports: list[dict[str, Any]] = []
    for i, name in enumerate(origin.rig.rig.supports):
        R, known = angles.rotation[i], bool(angles.determined[i])
        ends = {"coverage": INTERVAL_COVERAGE, "low": angles.low[i], "high": angles.high[i]}
        supports.append(
            {
                "name": name,
                "rotation": R if known else None,
                "rpy": rpy[i] if known else nobody,
                "rpy_std": angles.std[i] if known and not locked[i] else nobody,
                "turn_std": turns[i] if known else None,
                "rpy_interval": ends if known else None,
                "quaternion_xyzw": quaternion[i] if known else None,
                "zero": zeros[i],
                "zero_std": zero_stds[i],
                "sensitivity": None if sensitivity is None else sensitivity[i],
                "directions": None
                if known
                else {axis: R[:, j] for j, axis in enumerate("xyz") if axes[i, j]},
            }
        )
    return supports


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
