"""Covariance and budget of a fit to static postures (theory, section 5).

With the estimates of zeros that move and of supports that give, and what they cost the angles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.estimation.fit import factored_information, information
from tdfscal.estimation.uncertainty import (
    NOISE,
    UNDECLARED,
    Estimate,
    Uncertainty,
    calibrated,
    of_shares,
    parameter_std,
    prior_shares,
    quality,
)
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import layout, sensing, vector
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit


def estimate(fit: Fit, *, noise_from_residuals: bool = False) -> Estimate[Fit]:
    """Judge a fit by its own residuals; see `evaluate`."""
    parts = information(fit)
    stats = quality(fit, parts)
    known = evaluate(fit, parts, stats.birge, noise_from_residuals=noise_from_residuals)
    return Estimate(fit, parts, stats, known)


def evaluate(
    fit: Fit,
    parts: Spectrum,
    birge: float,
    *,
    noise_from_residuals: bool = False,
    undeclared: FloatArray | None = None,
) -> Uncertainty:
    """Posterior covariance, budget and coverage factors.

    birge : its excess over 1 scales the standard deviation of the noise; it never shrinks any.
    noise_from_residuals : the noise level itself comes from this fit, with its few degrees.
    undeclared : (p,), by which the active parameters move with what the rig file may lack.
    """
    posterior = parts.root @ parts.root.T  # pseudo-inverse of the information
    inflate = max(1.0, birge) ** 2
    shares = {
        name: share * (inflate if name in NOISE else 1.0)
        for name, share in _shares(fit, posterior).items()
    }
    if undeclared is not None:
        shares[UNDECLARED] = np.outer(undeclared, undeclared)
        posterior = posterior + shares[UNDECLARED]
    dof = np.inf
    if birge > 1 or noise_from_residuals:
        dof = max(1, fit.rows - len(parts.values) + len(fit.prior_residual))
        dof += 0 if fit.rig.earlier is None else fit.rig.earlier.dof
    faked, std = faked_information(fit), parameter_std(fit.active, posterior, parts)
    return of_shares(fit.state.rotation, shares, faked, parts, std, dof)


def _shares(fit: Fit, posterior: FloatArray) -> dict[str, FloatArray]:
    """Covariance (p, p) by source; together they are the posterior covariance."""
    at, W = fit.at, fit.at.information
    gain = fit.weight[:, None, None] * (posterior @ np.swapaxes(fit.jacobian, 1, 2) @ W)

    def through(cov: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("kpa,kab,kqb->pq", gain, cov, gain, optimize=True))

    friction = np.diag([0, 0, 0, 1, 1, 1]) * fit.postures.moment_var
    reading = np.einsum(
        "kiab,kibc,kidc->kad", at.noise_force, fit.postures.force_cov, at.noise_force
    )
    turning = at.noise_turn @ at.turn_cov @ np.swapaxes(at.noise_turn, 1, 2)
    return {
        "noise": through(reading),
        "positioner": through(turning),
        "hinge friction": through(np.broadcast_to(friction, turning.shape)),
        **prior_shares(fit, posterior),
    }


def faked_information(fit: Fit) -> FloatArray:
    """Information (3n, 3n) about the rotations that noise in the readings fakes.

    JᵀWJ takes its levers from the measured forces, noise included: a sensor that feels nothing
    but its own noise sideways would seem to know its yaw. The expectation of that part is
    Σ_k E[[n]×ᵀ Bᵀ W B [n]×], B = [I; [ρ_i]×].
    """
    n, M = fit.rig.n, sensing(fit.state)
    B = fit.at.wrench
    W = fit.at.information * fit.weight[:, None, None]
    C = np.einsum("knra,krs,knsb->knab", B, W, B, optimize=True)
    values, axes = np.linalg.eigh(M @ fit.postures.force_cov @ np.swapaxes(M, -1, -2))
    faked = np.zeros((3 * n, 3 * n))
    for a in range(3):
        turn = so3.hat(axes[..., :, a])
        block = np.einsum("kn,knca,kncd,kndb->nab", values[..., a], turn, C, turn, optimize=True)
        for i in range(n):
            faked[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += block[i]
    return faked


def joint_posterior(
    fit: Fit, rotation_covariance: FloatArray, rotation: FloatArray | None = None
) -> Calibrated:
    """All parameters of a self-calibration, as `calibrated` has them."""
    root = factored_information(fit).root
    return calibrated(fit, root @ root.T, rotation_covariance, rotation)


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A group of parameters beside the angles.

    kind : time, temperature, parabola, walk; lateral, vertical. value, std : (m,), per channel in
    N/s, N/K, N/s², of a walk's modes in N; or (1,) in m/N. share : (n, 3), part of the variance of
    roll, pitch, yaw that would be gone if the group were known.
    """

    kind: str
    value: FloatArray
    std: FloatArray
    share: FloatArray


def nuisances(fit: Fit, parts: Spectrum, known: Uncertainty) -> tuple[Nuisance, ...]:
    """Estimate of each kind of drift, and of each compliance, that the rig file declares."""
    motion, n = fit.postures.motion, fit.rig.n
    kind, place = np.full(len(fit.active), "", dtype="U11"), layout(n, fit.state.motions)
    if motion is not None:
        kind[place["drift"]] = np.repeat(motion.kind, 3 * n)
    give = place["compliance"]
    kind[give] = np.where(fit.active[give], ["lateral", "vertical"], "")
    turns, columns = parts.root[: 3 * n], kind[fit.active]
    R = fit.state.rotation
    whole = np.maximum(so3.rpy_variance(R, turns @ turns.T), np.finfo(float).tiny)
    found = []
    for name in dict.fromkeys(kind[kind != ""].tolist()):
        # C_ad C_dd⁺ C_da over C_aa, a the angles, d the group.
        own = parts.root[columns == name]
        cross = turns @ own.T
        gone = cross @ np.linalg.pinv(own @ own.T, hermitian=True) @ cross.T
        share = so3.rpy_variance(R, gone) / whole
        which = kind == name
        found.append(Nuisance(name, vector(fit.state)[which], known.parameter_std[which], share))
    return tuple(found)
