"""Proof on data not used: the residual contact wrench of leave-one-out postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.parameters import nominal
from tdfscal.model.statics import balance, features
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray, IntArray
from tdfscal.selfcal.estimator import Fit


@dataclass(frozen=True, slots=True)
class Remaining:
    """Residual contact wrench per used posture, about the LCS origin.

    force : (K, 3), N, BCS. moment : (K, 3), N·m, BCS.
    """

    force: FloatArray
    moment: FloatArray

    def rms(self) -> tuple[float, float]:
        """Quadratic mean of the lengths, N and N·m."""
        return _rms(self.force), _rms(self.moment)

    def largest(self) -> tuple[float, float]:
        """Largest lengths, N and N·m."""
        return (
            float(np.linalg.norm(self.force, axis=1).max()),
            float(np.linalg.norm(self.moment, axis=1).max()),
        )


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """Residual wrench of the postures, each predicted from all the others.

    before : with the nominal mounting and the stated zeros, mass and barycentre.
    after : with the calibration found without that posture. cov : (K, 6, 6), of force and moment
    after, N and N·m, by what is stated.
    """

    index: IntArray
    before: Remaining
    after: Remaining
    cov: FloatArray

    @property
    def kurtosis(self) -> float | None:
        """Mardia's, of the residual wrenches over that of normal ones; None where it has none.

        mean(q²) / mean(q)² of the squared lengths q by the covariance, whatever the scale, which is
        (m + 2) / m for normal ones of m components (Biometrika 57, 1970).
        """
        e = np.concatenate([self.after.force, self.after.moment], axis=1)
        if len(e) < 2 or np.linalg.matrix_rank(self.cov, hermitian=True).min() < e.shape[1]:
            return None
        q = np.einsum("ka,ka->k", e, np.linalg.solve(self.cov, e[..., None])[..., 0])
        m = e.shape[1]
        return float(np.mean(q**2) / np.mean(q) ** 2 * m / (m + 2))


def _rms(vectors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def cross_validate(fit: Fit, parts: Spectrum) -> CrossValidation:
    """Leave each used posture out in turn.

    The deleted residual is (I − H_kk)⁻¹ e_k with H_kk = J_k (JᵀJ)⁺ J_kᵀ in whitened units: the
    refit without posture k to the second order of its change, without refitting.
    """
    used = np.flatnonzero(fit.weight > 0)
    L = np.linalg.cholesky(fit.at.cov[used])
    J = np.linalg.solve(L, fit.jacobian[used]) @ parts.root
    e = np.linalg.solve(L, fit.residual[used][..., None])
    # pinv: a posture that alone carries a direction predicts nothing there.
    apart = L @ np.linalg.pinv(np.eye(6) - J @ np.swapaxes(J, 1, 2), hermitian=True)
    deleted = (apart @ e)[..., 0]

    rig, start = fit.rig, nominal(fit.rig, fit.postures.motions)
    at = balance(fit.postures, start, rig.barycentre.value, rig.gravity)
    before = (at.design @ features(start, at, rig.gravity))[used]
    return CrossValidation(
        index=used,
        before=_about_origin(before, at.rotation[used], at.centre),
        after=_about_origin(deleted, fit.at.rotation[used], fit.at.centre),
        cov=_cov_about_origin(apart @ np.swapaxes(L, 1, 2), fit.at.rotation[used], fit.at.centre),
    )


def _about_origin(residual: FloatArray, rotation: FloatArray, centre: FloatArray) -> Remaining:
    """Contact wrench −e, its moment moved from c to the LCS origin (theory, section 7)."""
    force = residual[:, :3]
    moment = residual[:, 3:] + (so3.hat(rotation @ centre) @ force[..., None])[..., 0]
    return Remaining(force=-force, moment=-moment)


def _cov_about_origin(cov: FloatArray, rotation: FloatArray, centre: FloatArray) -> FloatArray:
    """Covariance (K, 6, 6) of a wrench about c, moved to the LCS origin."""
    moved = np.zeros_like(cov)
    moved[:, :6, :6] = np.eye(6)
    moved[:, 3:, :3] = so3.hat(rotation @ centre)
    return np.asarray(moved @ cov @ np.swapaxes(moved, 1, 2))
