"""Proof on data not used: the residual contact wrench of leave-one-out postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.parameters import nominal
from tdfscal.model.statics import Balance, balance, features
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import FloatArray, IntArray
from tdfscal.selfcal.estimator import ROWS, Fit


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """Residual contact wrench of the postures, each predicted from all the others.

    index : (K,), the used postures. before, after : (K, 6), force and moment about the LCS origin,
    N and N·m, BCS; with the nominal mounting and the stated zeros, mass and barycentre, and with
    the calibration found without that posture. cov : (K, 6, 6), of `after`, by what is stated.
    """

    index: IntArray
    before: FloatArray
    after: FloatArray
    cov: FloatArray

    @property
    def kurtosis(self) -> float | None:
        """Mardia's, of the residual wrenches over that of normal ones; None where it has none.

        mean(q²) / mean(q)² of the squared lengths q by the covariance, whatever the scale, which is
        (m + 2) / m for normal ones of m components (Biometrika 57, 1970).
        """
        e, full = self.after, np.linalg.matrix_rank(self.cov, hermitian=True).min(initial=ROWS)
        if len(e) < 2 or full < ROWS:
            return None
        q = np.einsum("ka,ka->k", e, np.linalg.solve(self.cov, e[..., None])[..., 0])
        return float(np.mean(q**2) / np.mean(q) ** 2 * ROWS / (ROWS + 2))


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
    apart = L @ np.linalg.pinv(np.eye(ROWS) - J @ np.swapaxes(J, 1, 2), hermitian=True)

    rig, start = fit.rig, nominal(fit.rig, fit.postures.motions)
    at = balance(fit.postures, start, rig.barycentre.value, rig.gravity)
    before = (at.design @ features(start, at, rig.gravity))[used]
    here = _to_origin(fit.at, used)
    return CrossValidation(
        index=used,
        before=-(_to_origin(at, used) @ before[..., None])[..., 0],
        after=-(here @ apart @ e)[..., 0],
        cov=here @ apart @ np.swapaxes(L, 1, 2) @ np.swapaxes(here, 1, 2),
    )


def _to_origin(at: Balance, used: IntArray) -> FloatArray:
    """Matrices (K, 6, 6) that move a wrench from c to the LCS origin (theory, section 7)."""
    moved = np.tile(np.eye(ROWS), (len(used), 1, 1))
    moved[:, 3:, :3] = so3.hat(at.rotation[used] @ at.centre)
    return moved
