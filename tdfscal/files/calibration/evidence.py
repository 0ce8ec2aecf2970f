"""From a result's records to the evidence that its calibration file keeps for reports."""

from __future__ import annotations

from typing import Any

import numpy as np

from tdfscal.files.calibration.evidence_model import HISTOGRAM_DEFINITION, POSTURES_DEFINITION
from tdfscal.model.pose import register
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.selfcal.observability import load_directions
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.selfcal.undetermined import Undetermined
from tdfscal.trackercal import TrackerCalibration

#: Dwells that a file keeps for a figure, at most.
_LOOKED_AT = 2000
#: Bins of a quarter of a standard uncertainty; normally one trial in 16 000 lies beyond.
_EDGES = np.linspace(-4.0, 4.0, 33)


def postures(result: SelfCalibration | Undetermined) -> dict[str, Any]:
    """Time and residual wrench of each posture in the fit, in LCS axes."""
    dwells, check = result.dwells, result.validation
    used = [k for k in range(len(dwells)) if k not in result.rejected]
    stated, _ = register(result.rig.hinge, result.fit.postures.position[check.index])
    found = result.fit.at.rotation[check.index]
    std = _std_in_lcs(found, check.cov)
    return {
        "definition": POSTURES_DEFINITION,
        "index": used,
        "start": dwells.start[used],
        "end": dwells.end[used],
        "force_before": _in_lcs(stated, check.before.force),
        "force_after": _in_lcs(found, check.after.force),
        "moment_before": _in_lcs(stated, check.before.moment),
        "moment_after": _in_lcs(found, check.after.moment),
        "force_std": std[:, :3],
        "moment_std": std[:, 3:],
        "left_out": [
            {"start": piece.start, "end": piece.end, "reason": piece.reason}
            for piece in dwells.left_out
        ],
    }


def _in_lcs(pose: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (K, 3) of the BCS in LCS axes; pose (K, 3, 3), LCS → BCS."""
    return np.asarray(np.einsum("kba,kb->ka", pose, vectors))


def dwells(result: SelfCalibration | Undetermined) -> dict[str, Any] | None:
    """Mean readings of all dwells, where they are few enough to be looked at."""
    found = result.dwells
    if len(found) > _LOOKED_AT:
        return None
    force = np.where(result.rig.axes, found.force, 0.0)
    warm = None if found.temperature is None else found.temperature.mean(axis=1)
    return {
        "start": found.start,
        "end": found.end,
        "force": np.swapaxes(force, 0, 1),
        "temperature": warm,
    }


def _std_in_lcs(pose: FloatArray, cov: FloatArray) -> FloatArray:
    """Standard uncertainties (K, 6) in LCS axes of wrenches with cov (K, 6, 6) in the BCS."""
    blocks = (cov[:, k : k + 3, k : k + 3] for k in (0, 3))
    variance = [np.einsum("kba,kbc,kca->ka", pose, block, pose) for block in blocks]
    return np.asarray(np.sqrt(np.maximum(np.hstack(variance), 0.0)))


def loads(result: SelfCalibration) -> list[dict[str, Any]]:
    """Mean line of action and spread of the loads on each sensor."""
    fit = result.fit
    axis, spread, across = load_directions(fit.state, fit.postures.subset(fit.weight > 0))
    return [
        {"support": name, "axis": axis[i], "spread": spread[i], "across": across[i]}
        for i, name in enumerate(result.rig.supports)
    ]


def histogram(deviations: FloatArray, rpy_std: FloatArray) -> dict[str, Any]:
    """Monte Carlo trials (trials, n, 3) in bins of the linear standard uncertainty (n, 3)."""
    sample = deviations / rpy_std
    n = sample.shape[1]
    return {
        "definition": HISTOGRAM_DEFINITION,
        "edges": _EDGES,
        "counts": [[np.histogram(sample[:, i, j], _EDGES)[0] for j in range(3)] for i in range(n)],
    }


def methods(own: SelfCalibration, tracker: TrackerCalibration) -> list[dict[str, Any]]:
    """Return what each method alone says, beside a joint result."""
    return [
        {
            "method": "self",
            "rpy": so3.to_rpy(own.fit.state.rotation),
            "rpy_std": own.uncertainty.rpy_std,
        },
        {"method": "tracker", "rpy": tracker.rpy, "rpy_std": tracker.rpy_std},
    ]


def survey_residuals(result: TrackerCalibration) -> dict[str, Any]:
    """Residual per surveyed point: m in the tracker's frame, and in standard uncertainties."""
    return {
        "points": list(result.point_names),
        "residual": result.residual.tolist(),
        "normalised": result.normalised.tolist(),
    }
