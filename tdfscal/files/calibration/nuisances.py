"""Zeros that move and supports that give, as the calibration file states them."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.files.calibration.parts import (
    OpenAngles,
    OpenStd,
    OpenStds,
    measured_only,
    none_where_open,
)
from tdfscal.files.field_types import Number, Strict, key
from tdfscal.files.rig.reading import HOUR
from tdfscal.records import BoolArray
from tdfscal.selfcal.covariance import factored_information
from tdfscal.selfcal.nuisances import Estimate, compliance_estimates, drift_estimates
from tdfscal.selfcal.result import SelfCalibration

Shares = tuple[OpenAngles, ...]
_POWERS_OF_TIME = {"time": 1, "parabola": 2}


class Slopes(Strict):
    """A slope per channel; null for an axis that is not measured."""

    value: tuple[OpenAngles, ...] = key("per support, of each axis; null where not measured")
    std: tuple[OpenStds, ...] = key(
        "standard uncertainties, in the same unit; null where not measured or open"
    )
    share: Shares = key("part of the variance of roll, pitch, yaw that knowing them takes away")


class WalkShare(Strict):
    """What a random walk of the zeros costs."""

    share: Shares = key("part of the variance of roll, pitch, yaw that knowing it takes away")


class DriftResult(Strict):
    """How the zeros moved: slopes in time (N/h) and temperature (N/K), a parabola (N/h²)."""

    time: Slopes | None = key("slopes in time, N/h", None)
    temperature: Slopes | None = key("slopes in temperature, N/K", None)
    parabola: Slopes | None = key("where the residuals ask for it: N/h²", None)
    walk: WalkShare | None = key("what a random walk costs", None)


class Give(Strict):
    """A compliance between encoder and hinge, m/N."""

    value: Number = key("m/N")
    std: OpenStd = key("m/N: its standard uncertainty; null where open")
    share: Shares = key("part of the variance of roll, pitch, yaw that knowing it takes away")


class ComplianceResult(Strict):
    """What gives between encoder and hinge, sideways and along Z of the BCS."""

    lateral: Give | None = key("sideways", None)
    vertical: Give | None = key("along Z of the BCS", None)


def nuisance_documents(result: SelfCalibration) -> dict[str, Any]:
    """The blocks `drift` and `compliance`, each None where the rig file declares none."""
    fit, found = result.fit, result.uncertainty
    parts, determined = factored_information(fit), result.observability.determined
    drift: dict[str, Any] = {}
    for estimate in drift_estimates(fit, parts, found):
        drift[estimate.kind] = {"share": _shares(estimate, determined)}
        if estimate.value is not None and estimate.std is not None:
            unit = HOUR ** _POWERS_OF_TIME.get(estimate.kind, 0)
            axes = fit.rig.axes
            drift[estimate.kind]["value"] = measured_only(unit * estimate.value, axes)
            drift[estimate.kind]["std"] = measured_only(unit * estimate.std, axes)
    give = {
        estimate.kind: {
            "value": float(np.asarray(estimate.value)),
            "std": none_where_open(np.asarray(estimate.std)[()]),
            "share": _shares(estimate, determined),
        }
        for estimate in compliance_estimates(fit, parts, found)
    }
    return {"drift": drift or None, "compliance": give or None}


def _shares(estimate: Estimate, determined: BoolArray) -> tuple[tuple[float | None, ...], ...]:
    return tuple(
        tuple(map(float, row)) if known else (None, None, None)
        for row, known in zip(estimate.share, determined, strict=True)
    )
