"""Self-calibration: the maximum-likelihood estimate on SO(3)ⁿ from static postures.

The way inside: postures → balance at a state → statistic (one small triangular matrix) →
Gauss–Newton on the statistic and the priors → balance again at the new state, until nothing
moves. Everything that is not a rotation is a parameter with a prior: standard deviation 0 drops
its column, ∞ drops its prior row (theory, section 3).

Covariance and budget of a fit to static postures (theory, section 5).

With the estimates of zeros that move and of supports that give, and what they cost the angles.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tdfscal.estimation.fit import Priors, factored_information, information, solve
from tdfscal.estimation.observability import faked_information, noise_pull
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
from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated, pinned
from tdfscal.model.parameters import State, deviation, retract, with_motions
from tdfscal.model.statics import (
    Balance,
    Postures,
    balance,
    features,
    features_jacobian,
)
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.least_squares import (
    STEPS,
    Solution,
    Spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig

#: Largest change of any parameter, in whitened units, at which re-linearising has converged.
_SETTLED = 1e-6
_PASSES = 40
#: Iterations for a look at a start, which settles in ten if it is good.
LOOK = 15
#: Postures that are compressed together, in a cache.
_TOGETHER = 400
#: Residuals per posture.
ROWS = 6


@record
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
    iterations: int
    converged: bool

    @property
    def root(self) -> FloatArray:
        """The whitener (K, 6, 6) of a posture's residual by its weight: 0 where it is left out."""
        return np.asarray(np.sqrt(self.weight)[:, None, None] * self.at.whitener)

    @property
    def white(self) -> FloatArray:
        """Whitened residual (6 K + m,): the postures', then the priors'."""
        postures = (self.root @ self.residual[..., None]).ravel()
        return np.concatenate([postures, self.prior_residual])

    @cached_property
    def feature_pull(self) -> FloatArray:
        """Score (q,) of the features that noise makes by standing in their own columns."""
        return noise_pull(self.at, self.state, self.weight)

    @property
    def noise_pull(self) -> FloatArray:
        """The same of all parameters (P,)."""
        return self.feature_pull @ features_jacobian(self.state, self.at, self.rig.gravity)

    def whitened(self) -> tuple[FloatArray, FloatArray]:
        """Whitened residual (6 K + m,) and Jacobian (6 K + m, p)."""
        J = self.root @ self.jacobian
        return self.white, np.concatenate([J.reshape(-1, J.shape[-1]), self.prior_jacobian])

    @cached_property
    def slopes(self) -> FloatArray:
        """Whitened derivative (K, 6, P) of the residual by all parameters, active or not."""
        by_state = features_jacobian(self.state, self.at, self.rig.gravity)
        return self.root @ (self.at.design @ by_state)

    def all_slopes(self) -> FloatArray:
        """The same row by row, (6 K, P)."""
        return self.slopes.reshape(-1, len(self.active))

    @property
    def still(self) -> State:
        """The estimate: at rest there are no other parameters."""
        return self.state

    @property
    def still_priors(self) -> int:
        """Number of prior rows."""
        return len(self.prior_residual)

    @property
    def rms(self) -> tuple[float, float]:
        """Quadratic mean over the used postures of the residual force's length, and moment's."""
        e = self.residual[self.weight > 0].reshape(-1, 2, 3)
        force, moment = np.sqrt(np.mean(np.sum(e**2, axis=2), axis=0))
        return float(force), float(moment)

    @property
    def rows(self) -> int:
        """Number of residuals of the used postures that no free force reaches."""
        return int(self.at.rows[self.weight > 0].sum())

    @property
    def distance(self) -> FloatArray:
        """Squared Mahalanobis length (K,) of each posture's residual."""
        return np.asarray(
            np.sum((self.at.whitener @ self.residual[..., None])[..., 0] ** 2, axis=1)
        )

    @property
    def dof(self) -> int:
        """Degrees of freedom of `cost`, all free parameters taken as determined."""
        return self.rows + len(self.prior_residual) - int(self.jacobian.shape[-1])

    @property
    def cost(self) -> float:
        """χ²: weighted squared residuals and prior rows."""
        return float(self.weight @ self.distance + self.prior_residual @ self.prior_residual)


def statistic(at: Balance, weight: FloatArray) -> FloatArray:
    """Triangular factor (≤ q, q) of the whitened design of all postures.

    |statistic · ψ|² is the sum of all postures' squared whitened residuals, so this matrix holds
    all that the postures say, however many they are.
    """
    root, q = at.whitener * np.sqrt(weight)[:, None, None], at.design.shape[2]
    parts = [
        triangular((root[k : k + _TOGETHER] @ at.design[k : k + _TOGETHER]).reshape(-1, q))
        for k in range(0, len(root), _TOGETHER)
    ]
    return parts[0] if len(parts) == 1 else triangular(np.concatenate(parts))


def solve_statistic(
    rig: Rig,
    at: Balance,
    compressed: FloatArray,
    start: State,
    priors: Priors,
    *,
    pull: FloatArray | None = None,
    iterations: int = STEPS,
) -> Solution[State]:
    """Gauss–Newton on the compressed postures and the priors; pull : as in `solve`."""

    def psi(state: State) -> tuple[FloatArray, FloatArray]:
        return features(state, at, rig.gravity), features_jacobian(state, at, rig.gravity)

    return solve(
        compressed,
        psi,
        priors,
        retract,
        start,
        priors.active,
        pull=pull,
        iterations=iterations,
    )


def at_state(
    rig: Rig,
    postures: Postures,
    state: State,
    weight: FloatArray,
    *,
    iterations: int = 0,
    converged: bool = True,
) -> Fit:
    """Gather residuals and Jacobians at a state, whoever found it."""
    priors, state = Priors(rig, postures.motion), with_motions(state, postures.motions)
    at = balance(postures, state, rig.barycentre.value, rig.gravity)
    prior_r, prior_j = priors(state)
    jacobian = at.design @ features_jacobian(state, at, rig.gravity)[:, priors.active]
    return Fit(
        rig=rig,
        postures=at.seen,
        state=state,
        active=priors.active,
        at=at,
        weight=weight,
        residual=at.design @ features(state, at, rig.gravity),
        jacobian=jacobian,
        prior_residual=prior_r,
        prior_jacobian=prior_j,
        iterations=iterations,
        converged=converged,
    )


def fit(rig: Rig, postures: Postures, start: State, weight: FloatArray | None = None) -> Fit:
    """Maximum-likelihood estimate from one start with given posture weights (K,).

    Whether it settled stands in the result: where the data leave a direction open the iteration
    may wander along it, and the verdict on what is observable has to come first.
    """
    priors = Priors(pinned(rig), postures.motion)
    weight = np.ones(len(postures)) if weight is None else weight
    state, iterations, converged = with_motions(start, postures.motions), 0, False
    for _ in range(_PASSES):
        at = balance(postures, state, rig.barycentre.value, rig.gravity)
        pull = noise_pull(at, state, weight)
        solution = solve_statistic(rig, at, statistic(at, weight), state, priors, pull=pull)
        iterations += solution.iterations
        step = deviation(solution.state, state)[priors.active]
        state = solution.state
        moved = np.linalg.norm(solution.jacobian @ step)
        converged = solution.converged and bool(moved < _SETTLED * (1 + np.sqrt(solution.cost)))
        if converged or not solution.converged:
            break
    return at_state(rig, postures, state, weight, iterations=iterations, converged=converged)


def spread(distance: FloatArray, rows: IntArray | int = ROWS) -> float:
    """Variance of the residuals by their median, never below 1: d² (K,) is χ² of `rows` at 1."""
    typical = max(1, int(np.median(rows)))
    return max(1.0, float(np.median(distance) / chi2_quantile(0.5, typical)))


def worth(one: Fit, other: Fit, unknowns: int, weight: FloatArray | float = 1.0) -> float:
    """Fall of −2 ln L from one fit to another of the same postures, less k ln N (Schwarz).

    weight : (K,), of the postures in the other; by default all count, also those that either leaves
    out, which its noise may have made outliers. In the one all do.
    """

    def deviance(fit: Fit, weight: FloatArray | float) -> float:
        volume = np.linalg.slogdet(fit.at.cov)[1]
        return float(np.sum(weight * fit.distance + volume) + np.sum(fit.prior_residual**2))

    cost = unknowns * float(np.log(max(one.rows, 2)))
    return deviance(one, 1.0) - deviance(other, weight) - cost


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
    faked = faked_information(fit.at, fit.state, fit.weight)
    std = parameter_std(fit.active, posterior, parts)
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


def joint_posterior(
    fit: Fit, rotation_covariance: FloatArray, rotation: FloatArray | None = None
) -> Calibrated:
    """All parameters of a self-calibration, as `calibrated` has them."""
    root = factored_information(fit).root
    return calibrated(fit, root @ root.T, rotation_covariance, rotation)
