"""What noise makes by standing in the columns of the design, which are made of readings.

Least squares take a design as exact. Noise in it seems to tell turns of which it knows nothing, and
gains come out smaller than they are, by its share of the readings' variance however many postures
there are. What it makes of the score on the mean is taken away (corrected score); turns are free of
it where the noise is alike in all directions (theory, section 3).

References
----------
Nakamura: Corrected score function for errors-in-variables models. Biometrika 77 (1990) 127–137.
"""

from __future__ import annotations

import numpy as np

from tdfscal.model.parameters import State, sensing
from tdfscal.model.postures import forces, zeros
from tdfscal.model.statics import Balance
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import block_diagonal
from tdfscal.records import FloatArray


def faked_information(at: Balance, state: State, weight: FloatArray) -> FloatArray:
    """Information (3n, 3n) about the rotations that noise in the readings fakes.

    JᵀWJ takes its levers from the measured forces, noise included: a sensor that feels nothing
    but its own noise sideways would seem to know its yaw. The expectation of that part is
    Σ_k E[[n]×ᵀ Bᵀ W B [n]×], B = [I; [ρ_i]×].
    """
    M, B = sensing(state), at.wrench
    W = at.information * weight[:, None, None]
    C = np.einsum("knra,krs,knsb->knab", B, W, B, optimize=True)
    noise = M @ at.seen.force_cov @ np.swapaxes(M, -1, -2)
    return block_diagonal(*so3.information_of_crossing(C, noise).sum(axis=0))


def noise_pull(at: Balance, state: State, weight: FloatArray) -> FloatArray:
    """Score (q,) of the features that noise makes by standing in their own columns.

    Σ_k w_k Σ_ν (∂Φ/∂ν)ᵀ W cov(ν) (∂e/∂ν), ν : readings, and the turn of the registered pose.
    """
    n, W, A = state.n, at.information * weight[:, None, None], at.noise_turn[:, 3:]
    both = at.seen.measured[:, :, None] & at.seen.measured[:, None, :]
    F = forces(state, at.seen.force - (zeros(state, at.seen) - state.zero))
    pull = np.zeros(at.design.shape[2])
    # W (∂e/∂ν) cov(ν) of the readings, (K, n, 6, 3), and of the turn, (K, 3, 3), moments alone.
    felt = W[:, None] @ at.noise_force @ np.where(both, at.seen.force_cov, 0.0)
    turned = (W @ at.noise_turn @ at.turn_cov)[:, 3:]
    across = np.swapaxes(turned, 1, 2) - _traces(turned)
    levers = at.arm @ np.swapaxes(across, 1, 2)
    mixed = np.swapaxes(at.wrench, -1, -2) @ felt + levers[..., None] * at.seen.force[:, :, None]
    pull[: 9 * n] = mixed.sum(axis=0).ravel()
    pull[9 * n : 12 * n] = -levers.sum(axis=0).ravel()
    pull[12 * n + 3 : 12 * n + 12] = (across @ at.rotation).sum(axis=0).T.ravel()
    # Hinges, datums and what gives turn the pose, at levers A that are made of both.
    in_bcs = felt[:, :, 3:] @ np.swapaxes(sensing(state), -1, -2)
    L, lever = A - _traces(A) / 2, -A[:, None] @ at.turn
    base = (turned @ _axial(L)[..., None])[..., 0] - _axial(np.swapaxes(A, 1, 2) @ turned)
    base -= (np.swapaxes(L, 1, 2) @ _axial(turned)[..., None])[..., 0]
    base += ((in_bcs - np.swapaxes(in_bcs, -1, -2)) @ at.arm[..., None])[..., 0].sum(axis=1)
    by_turn = np.einsum("knab,ka->knb", at.turn, base)
    hinge = by_turn - _axial(in_bcs - so3.hat(F) @ turned[:, None])
    datum = by_turn - _axial(np.swapaxes(lever, -1, -2) @ turned[:, None])
    pull[12 * n + 12 : 15 * n + 12] = (hinge @ at.rotation).sum(axis=0).ravel()
    pull[15 * n + 12 : 18 * n + 12] = datum.sum(axis=0).ravel()
    gives = (datum * F + np.sum(lever * in_bcs, axis=2)).sum(axis=(0, 1))
    pull[18 * n + 12 : 18 * n + 14] = gives[:2].sum(), gives[2]
    return pull


def _traces(matrix: FloatArray) -> FloatArray:
    """The trace of each matrix (K, 3, 3) times the unit matrix."""
    return np.asarray(np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(3))


def _axial(matrix: FloatArray) -> FloatArray:
    """Σ_j x_j × e_j (..., 3) of the columns x_j of matrices (..., 3, 3)."""
    a, b = (1, 2, 0), (2, 0, 1)
    return matrix[..., a, b] - matrix[..., b, a]
