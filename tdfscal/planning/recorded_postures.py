"""Postures recorded already: a plan builds on them, and what more would make of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.checks import faulty_sensors, log_against_rig
from tdfscal.errors import DataError, NotConvergedError
from tdfscal.estimation.fit import information
from tdfscal.estimation.uncertainty import Change, Prospect, linear_rpy_std
from tdfscal.frozen import replace
from tdfscal.model.parameters import nominal, sensing
from tdfscal.model.statics import Postures, internal_part, postures
from tdfscal.records import Dwells, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import Fit, at_state, evaluate
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.significance import OF_CAPACITY


def recorded(rig: Rig, dwells: Dwells, noise: float) -> Fit:
    """Fit recorded dwells; too few for an estimate are seen from the nominal mounting.

    noise : N, taken for readings that state none.

    Raises DataError where no dwell can be used or the log contradicts the rig file.
    """
    if len(dwells) == 0:
        from tdfscal.dwells.find import no_dwell

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


def scatter_of(seen: Postures, rig: Rig) -> float:
    """Quadratic mean, N per axis, of the postures' force noise beyond what the rig declares."""
    variance = np.diagonal(seen.force_cov, axis1=2, axis2=3)[:, rig.axes].mean()
    return float(np.sqrt(max(0.0, variance - rig.declared.force_noise**2)))


#: Postures that a campaign is easily given besides; N, what a tare just before it leaves.
_MORE, _TARED = 5, 0.1
#: How much harder it is squeezed.
HARDER = 2.0


def prospects(fit: Fit, rpy_std: FloatArray) -> tuple[Prospect, ...]:
    """Linearise a campaign as it would be at the estimate of the one that is there.

    rpy_std : (n, 3), rad, as published; what the linear covariance promises of it is its share.
    """
    now = _linear_std(fit)
    return tuple(
        Prospect(change, amount, rpy_std * _linear_std(other, more) / now)
        for change, amount, other, more in _changes(fit)
    )


def _changes(fit: Fit) -> Iterator[tuple[Change, float, Fit, float]]:
    """Each change with its amount, its fit, and by how much its rows count more."""
    rig, used = fit.rig, int((fit.weight > 0).sum())
    yield "postures", float(_MORE), fit, (used + _MORE) / used
    squeezed = _squeezed(fit)
    if squeezed is not None:
        yield "squeeze", *squeezed, 1.0
    if np.any(rig.zero.std > 2 * _TARED):
        zero = UncertainValue(rig.zero.value, np.minimum(rig.zero.std, _TARED))
        tared = replace(rig, zero=zero)
        yield "tare", _TARED, at_state(tared, fit.postures, fit.state, fit.weight), 1.0


def _squeezed(fit: Fit) -> tuple[float, Fit] | None:
    """The same postures with larger internal forces; None where a sensor would be full."""
    seen, M = fit.postures, sensing(fit.state)
    force = np.einsum("nab,knb->kna", M, seen.force - fit.state.zero)
    arm = seen.position - fit.state.datum
    inside = internal_part(arm - arm.mean(axis=1, keepdims=True), force)
    more = np.einsum("nab,knb->kna", np.linalg.inv(M), (HARDER - 1.0) * inside)
    reading = np.where(seen.measured, seen.force + more, 0.0)
    if not np.all(seen.measured) or np.any(np.abs(reading) > OF_CAPACITY * fit.rig.capacity):
        return None
    size = HARDER * float(np.median(np.linalg.norm(inside, axis=2).max(axis=1)))
    harder = replace(seen, force=reading)
    return size, at_state(fit.rig, harder, fit.state, fit.weight)


def _linear_std(fit: Fit, more: float = 1.0) -> FloatArray:
    """Standard uncertainties (n, 3), rad, where each posture counts `more` times."""
    data = (fit.root @ fit.jacobian).reshape(-1, fit.jacobian.shape[-1])
    return linear_rpy_std(fit.state.rotation, data, fit.prior_jacobian, more)
