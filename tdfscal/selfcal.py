"""Self-calibration: the maximum-likelihood estimate on SO(3)ⁿ from static postures.

The way inside: postures → balance at a state → statistic (one small triangular matrix) →
Gauss–Newton on the statistic and the priors → balance again at the new state, until nothing
moves. Everything that is not a rotation is a parameter with a prior: standard deviation 0 drops
its column, ∞ drops its prior row (theory, section 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import NotConvergedError
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Solution, gauss_newton
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.starts import linear_start
from tdfscal.statics import (
    Balance,
    Postures,
    State,
    balance,
    deviation,
    features,
    features_jacobian,
    layout,
    nominal,
    prior_std,
    retract,
)

#: Largest change of any parameter, in whitened units, at which re-linearising has converged.
_SETTLED = 1e-7
_PASSES = 40


@dataclass(frozen=True, slots=True)
class Fit:
    """An estimate with all that its uncertainty needs.

    state : the estimate. active : (P,), which parameters were free.
    at : the balance linearised at the estimate. weight : (K,), 1 used, 0 left out, robust between.
    residual : (K, 6), e_F (N) and e_M (N·m about c, BCS) at the estimate.
    jacobian : (K, 6, p), of the residual by the active parameters, not whitened.
    prior_residual : (m,), prior_jacobian : (m, p), the whitened prior rows.
    """

    rig: Rig
    postures: Postures
    state: State
    active: BoolArray
    at: Balance
    weight: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    prior_residual: FloatArray
    prior_jacobian: FloatArray
    passes: int
    iterations: int

    @property
    def whitener(self) -> FloatArray:
        """L⁻¹ (K, 6, 6) with L Lᵀ the covariance of a posture's residual."""
        return np.linalg.inv(np.linalg.cholesky(self.at.cov))

    @property
    def distance(self) -> FloatArray:
        """Squared Mahalanobis length (K,) of each posture's residual."""
        return np.asarray(np.sum((self.whitener @ self.residual[..., None])[..., 0] ** 2, axis=1))

    @property
    def cost(self) -> float:
        """χ²: weighted squared residuals and prior rows."""
        return float(self.weight @ self.distance + self.prior_residual @ self.prior_residual)


def prior_rows(rig: Rig, state: State, active: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Whitened rows (m,), (m, p) of all priors with 0 < std < ∞, by the active parameters."""
    std, n = prior_std(rig), rig.n
    offset = deviation(state, nominal(rig))
    held = np.flatnonzero(np.isfinite(std) & (std > 0))
    rows = np.zeros((len(held), len(std)))
    rows[np.arange(len(held)), held] = 1 / std[held]
    residual = offset[held] / std[held]
    angled = np.flatnonzero(np.isfinite(rig.rpy_std).ravel())
    if len(angled):  # a prior on roll, pitch, yaw about the nominal mounting
        turn = so3.to_rpy(state.rotation) - rig.nominal_rpy
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        jac = np.zeros((3 * n, len(std)))
        for i, block in enumerate(so3.rpy_jacobian(state.rotation)):
            jac[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        scale = rig.rpy_std.ravel()[angled]
        residual = np.concatenate([residual, turn.ravel()[angled] / scale])
        rows = np.concatenate([rows, jac[angled] / scale[:, None]])
    return residual, rows[:, active]


def statistic(at: Balance, weight: FloatArray) -> FloatArray:
    """Triangular factor (≤ q, q) of the whitened design of all postures.

    |statistic · ψ|² is the sum of all postures' squared whitened residuals, so this matrix holds
    all that the postures say, however many they are.
    """
    rows = np.linalg.solve(np.linalg.cholesky(at.cov), at.design)
    rows = rows * np.sqrt(weight)[:, None, None]
    return np.asarray(np.linalg.qr(rows.reshape(-1, rows.shape[-1]), mode="r"))


def solve_statistic(
    rig: Rig, at: Balance, compressed: FloatArray, start: State, active: BoolArray
) -> Solution[State]:
    """Gauss–Newton on the compressed postures and the priors."""
    size = layout(rig.n)["tilt"].stop

    def model(state: State) -> tuple[FloatArray, FloatArray]:
        prior_r, prior_j = prior_rows(rig, state, active)
        r = compressed @ features(state, at, rig.gravity)
        j = compressed @ features_jacobian(state, at, rig.gravity)[:, active]
        return np.concatenate([r, prior_r]), np.concatenate([j, prior_j])

    def move(state: State, step: FloatArray) -> State:
        full = np.zeros(size)
        full[active] = step
        return retract(state, full)

    return gauss_newton(model, move, start)


def at_state(
    rig: Rig,
    postures: Postures,
    state: State,
    weight: FloatArray,
    *,
    passes: int = 0,
    iterations: int = 0,
) -> Fit:
    """Gather residuals and Jacobians at a state, whoever found it."""
    active = prior_std(rig) > 0
    at = balance(postures, state, rig.barycentre.value, rig.gravity)
    prior_r, prior_j = prior_rows(rig, state, active)
    jacobian = at.design @ features_jacobian(state, at, rig.gravity)[:, active]
    return Fit(
        rig=rig,
        postures=postures,
        state=state,
        active=active,
        at=at,
        weight=weight,
        residual=at.design @ features(state, at, rig.gravity),
        jacobian=jacobian,
        prior_residual=prior_r,
        prior_jacobian=prior_j,
        passes=passes,
        iterations=iterations,
    )


def fit(rig: Rig, postures: Postures, start: State, weight: FloatArray | None = None) -> Fit:
    """Maximum-likelihood estimate from one start with given posture weights (K,).

    Raises
    ------
    NotConvergedError
        The iteration does not settle.
    """
    active = prior_std(rig) > 0
    weight = np.ones(len(postures)) if weight is None else weight
    state, iterations = start, 0
    for passes in range(1, _PASSES + 1):
        at = balance(postures, state, rig.barycentre.value, rig.gravity)
        solution = solve_statistic(rig, at, statistic(at, weight), state, active)
        iterations += solution.iterations
        step = deviation(solution.state, state)[active]
        state = solution.state
        if not solution.converged:
            break
        if np.linalg.norm(solution.jacobian @ step) < _SETTLED * (1 + np.sqrt(solution.cost)):
            return at_state(rig, postures, state, weight, passes=passes, iterations=iterations)
    raise NotConvergedError(
        f"the estimate did not settle in {iterations} iterations",
        hint="check the rig file's mass, hinges and nominal mounting, and record more postures",
    )


def starting_points(rig: Rig, postures: Postures) -> list[State]:
    """Nominal mounting and the linear solution: the two starts of theory, section 3."""
    return [nominal(rig), linear_start(rig, postures)]


def best_start(rig: Rig, postures: Postures, weight: FloatArray) -> State:
    """Return the start from which one pass reaches the lowest cost."""
    active = prior_std(rig) > 0
    found: list[tuple[float, State]] = []
    for start in starting_points(rig, postures):
        at = balance(postures, start, rig.barycentre.value, rig.gravity)
        solution = solve_statistic(rig, at, statistic(at, weight), start, active)
        found.append((solution.cost, solution.state))
    return min(found, key=lambda pair: pair[0])[1]
