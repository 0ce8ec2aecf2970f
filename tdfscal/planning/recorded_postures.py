"""Postures recorded already, as a plan builds on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.dwells.absence import no_dwell
from tdfscal.errors import DataError, NotConvergedError
from tdfscal.estimation.fit import information
from tdfscal.model.parameters import nominal
from tdfscal.model.statics import postures
from tdfscal.records import Dwells, Rig
from tdfscal.selfcal.covariance import evaluate
from tdfscal.selfcal.estimator import Fit, at_state
from tdfscal.selfcal.outliers import fit_robust


def recorded(rig: Rig, dwells: Dwells, noise: float) -> Fit:
    """Fit recorded dwells; too few for an estimate are seen from the nominal mounting.

    noise : N, taken for readings that state none.

    Raises DataError where no dwell can be used or the log contradicts the rig file.
    """
    if len(dwells) == 0:
        raise no_dwell(dwells)
    log_against_rig.check_geometry(rig, dwells.position, dwells.force)
    kept = faulty_sensors.screen(rig, dwells).keep
    if not kept.any():
        raise DataError("every dwell is saturated or frozen", where="given log")
    observed = postures(rig, dwells).subset(kept)
    if np.diagonal(observed.force_cov, axis1=2, axis2=3).min() == 0.0:
        observed = replace(observed, force_cov=observed.force_cov + noise**2 * np.eye(3))
    try:
        result = fit_robust(rig, observed).fit
    except NotConvergedError:
        return at_state(rig, observed, nominal(rig), np.ones(len(observed)))
    std = evaluate(result, information(result), 1.0).rpy_std
    if std.max() < rig.acceptance.identifiable:
        return result
    return at_state(rig, observed, nominal(rig), result.weight)


def scatter_of(fit: Fit) -> float:
    """Quadratic mean, N per axis, of the postures' force noise beyond what the rig declares."""
    variance = np.diagonal(fit.postures.force_cov, axis1=2, axis2=3).mean()
    return float(np.sqrt(max(0.0, variance - fit.rig.declared.force_noise**2)))
