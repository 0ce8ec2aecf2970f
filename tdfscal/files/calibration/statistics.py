"""How well a result stands: fit, observability, trials, validation, as the file states them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tdfscal.acceptance.conformity import Conformity
from tdfscal.files.calibration import evidence
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import Dwells, FloatArray
from tdfscal.selfcal.monte_carlo import MonteCarlo
from tdfscal.selfcal.observability import Observability
from tdfscal.selfcal.pipeline import SelfCalibration
from tdfscal.trackercal import MonteCarlo as TrackerMonteCarlo
from tdfscal.trackercal import TrackerCalibration


def terminal(
    mass: FloatArray, mass_std: FloatArray, bary: FloatArray, bary_std: FloatArray
) -> dict[str, Any]:
    """Mass (kg) and barycentre (3,), m, each with its standard uncertainty."""
    return {
        "mass": {"value": float(mass), "std": np.reshape(mass_std, 1)[0]},
        "barycenter": {"value": bary, "std": bary_std},
    }


def fit(result: SelfCalibration) -> dict[str, Any]:
    """Residuals, rejected postures, iterations."""
    return {
        "postures": len(result.dwells) - len(result.rejected),
        "rejected": rejected(result.dwells, result.rejected),
        **asdict(result.quality),
        "iterations": result.fit.iterations,
        "converged": result.fit.converged,
        "channel_noise": None if result.channels is None else result.channels.factor,
        "kurtosis": result.validation.kurtosis,
    }


def rejected(dwells: Dwells, reasons: Mapping[int, str]) -> list[dict[str, Any]]:
    """Postures left out, dwell index → reason, with their times."""
    return [
        {"index": k, "start": dwells.start[k], "end": dwells.end[k], "reason": reason}
        for k, reason in sorted(reasons.items())
    ]


def totals(campaigns: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
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


def observability(seen: Observability) -> dict[str, Any]:
    """Verdict, weakest turn, each angle against its prior, and advice."""
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


def trials(
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


def validation(result: SelfCalibration) -> dict[str, Any]:
    """Residual wrench at leave-one-out postures, before and after."""
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


def conformity(judged: Conformity | None) -> dict[str, Any] | None:
    """Contact wrench against its limits; None where none are stated."""
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


def tracker_statistics(result: TrackerCalibration) -> dict[str, Any]:
    """Residuals, points and rejected points of a survey."""
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
