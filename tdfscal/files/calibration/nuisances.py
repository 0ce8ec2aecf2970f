"""Zeros that move and supports that give, as the calibration file states them."""

from __future__ import annotations

from typing import Any

from tdfscal.files.calibration.parts import OpenRows, OpenStd, OpenStdRows, measured_only
from tdfscal.files.field_types import Number, Strict, key
from tdfscal.files.rig.reading import HOUR
from tdfscal.records import BoolArray
from tdfscal.selfcal.covariance import factored_information
from tdfscal.selfcal.nuisances import Estimate, compliance_estimates, drift_estimates
from tdfscal.selfcal.result import SelfCalibration

_POWERS_OF_TIME = {"time": 1, "parabola": 2}


class Slopes(Strict):
    """A slope per channel; null for an axis that is not measured."""

    value: OpenRows = key("per support, of each axis; null where not measured")
    std: OpenStdRows = key(
        "standard uncertainties, in the same unit; null where not measured or open"
    )
    share: OpenRows = key("part of the variance of roll, pitch, yaw that knowing them takes away")


class WalkShare(Strict):
    """What a random walk of the zeros costs."""

    share: OpenRows = key("part of the variance of roll, pitch, yaw that knowing it takes away")


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
    share: OpenRows = key("part of the variance of roll, pitch, yaw that knowing it takes away")


class ComplianceResult(Strict):
    """What gives between encoder and hinge, sideways and along Z of the BCS."""

    lateral: Give | None = key("sideways", None)
    vertical: Give | None = key("along Z of the BCS", None)


def nuisance_documents(result: SelfCalibration) -> dict[str, Any]:
    """The blocks `drift` and `compliance`, each None where the rig file declares none."""
    fit, found = result.fit, result.uncertainty
    parts, determined = factored_information(fit), result.observability.determined
    return {
        block: {one.kind: _estimate(one, fit.rig.axes, determined) for one in estimates} or None
        for block, estimates in (
            ("drift", drift_estimates(fit, parts, found)),
            ("compliance", compliance_estimates(fit, parts, found)),
        )
    }


def _estimate(one: Estimate, axes: BoolArray, determined: BoolArray) -> dict[str, Any]:
    share = {"share": measured_only(one.share, determined[:, None])}
    if one.value is None or one.std is None:
        return share
    unit = HOUR ** _POWERS_OF_TIME.get(one.kind, 0)
    values = {"value": unit * one.value, "std": unit * one.std}
    if one.value.ndim:
        values = {name: measured_only(each, axes) for name, each in values.items()}
    return values | share
