"""Self-calibration: the maximum-likelihood estimate on SO(3)ⁿ from static postures.

The way inside: postures → balance at a state → statistic (one small triangular matrix) →
Gauss–Newton on the statistic and the priors → balance again at the new state, until nothing
moves. Everything that is not a rotation is a parameter with a prior: standard deviation 0 drops
its column, ∞ drops its prior row (theory, section 3).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tdfscal.estimation.fit import Fitted, Priors, solve
from tdfscal.estimation.observability import Prospect, noise_pull, prospect
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import pinned
from tdfscal.model.parameters import State, deviation, retract, sensing, with_motions
from tdfscal.model.statics import (
    Balance,
    Postures,
    balance,
    features,
    features_jacobian,
    internal_part,
)
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.least_squares import STEPS, Solution, block_diagonal, triangular
from tdfscal.records import FloatArray, IntArray, Rig, UncertainValue
from tdfscal.significance import OF_CAPACITY

#: Largest change of any parameter, in whitened units, at which re-linearising has converged.
_SETTLED = 1e-6
_PASSES = 40
#: Iterations for a look at a start, which settles in ten if it is good.
LOOK = 15
#: Postures that are compressed together, in a cache.
_TOGETHER = 400
#: Residuals per posture.
ROWS = 6


@record(kw_only=True)
class Fit(Fitted):
    """An estimate from postures.

    state : the estimate. at : the balance linearised there. weight : (K,), 1 used, 0 left out,
    robust between. residual : (K, 6), e_F (N) and e_M (N·m about c, BCS) at the estimate.
    jacobian : (K, 6, p), of the residual by the active parameters, not whitened.
    """

    priors: Priors
    postures: Postures
    state: State
    at: Balance
    weight: FloatArray

    @property
    def still(self) -> State:
        """The estimate: at rest there are no other parameters."""
        return self.state

    @property
    def stated(self) -> Priors:
        """What is stated of the parameters."""
        return self.priors

    @property
    def root(self) -> FloatArray:
        """The whitener (K, 6, 6) of a posture's residual by its weight: 0 where it is left out."""
        return np.asarray(np.sqrt(self.weight)[:, None, None] * self.at.whitener)

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Columns (K, 6, …) of the residual as whitened rows (6 K, …)."""
        white = self.root @ columns.reshape(*columns.shape[:2], -1)
        return white.reshape(-1, *columns.shape[2:])

    @cached_property
    def feature_pull(self) -> FloatArray:
        """Score (q,) of the features that noise makes by standing in their own columns."""
        W = self.at.information * self.weight[:, None, None]
        return noise_pull(self.at, self.state, W)

    @property
    def noise_pull(self) -> FloatArray:
        """The same of all parameters (P,)."""
        return self.feature_pull @ features_jacobian(self.state, self.at, self.rig.gravity)

    @cached_property
    def slopes(self) -> FloatArray:
        """Whitened derivative (K, 6, P) of the residual by all parameters, active or not."""
        by_state = features_jacobian(self.state, self.at, self.rig.gravity)
        return self.root @ (self.at.design @ by_state)

    def all_slopes(self) -> FloatArray:
        """The same row by row, (6 K, P)."""
        return self.slopes.reshape(-1, len(self.active))

    @property
    def by_wrench(self) -> FloatArray:
        """The same (K, 6, 6) by a wrench on the terminal about c, alike in the LCS, N and N·m."""
        columns = np.zeros((len(self.root), ROWS, 6))
        columns[:, :3, :3] = columns[:, 3:, 3:] = self.at.rotation
        return self.root @ columns

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
    def misfit(self) -> float:
        """Variance of the residuals by their median, in units of the stated one; never below 1."""
        return spread(self.distance, self.at.rows)

    @property
    def dof(self) -> int:
        """Degrees of freedom of `cost`, all free parameters taken as determined."""
        return self.rows + len(self.prior_residual) - int(self.jacobian.shape[-1])

    def noise_scale(self, birge: float, dof: int) -> tuple[float, float]:
        """χ² beyond what is stated widens the noise, and never shrinks it; by so many degrees."""
        if birge <= 1 and not self.postures.noise_from_residuals:
            return 1.0, np.inf
        earlier = self.rig.earlier
        return max(1.0, birge) ** 2, max(1, dof) + (0 if earlier is None else earlier.dof)

    def noise_shares(self, posterior: FloatArray) -> dict[str, FloatArray]:
        """Covariance (p, p) by readings, positions and friction of the hinges."""
        at, W = self.at, self.at.information
        gain = self.weight[:, None, None] * (posterior @ np.swapaxes(self.jacobian, 1, 2) @ W)

        def through(cov: FloatArray) -> FloatArray:
            return np.asarray(np.einsum("kpa,kab,kqb->pq", gain, cov, gain, optimize=True))

        friction = np.diag([0, 0, 0, 1, 1, 1]) * self.postures.moment_var
        reading = np.einsum(
            "kiab,kibc,kidc->kad", at.noise_force, self.postures.force_cov, at.noise_force
        )
        turning = at.noise_turn @ at.turn_cov @ np.swapaxes(at.noise_turn, 1, 2)
        return {
            "noise": through(reading),
            "positioner": through(turning),
            "hinge friction": through(np.broadcast_to(friction, turning.shape)),
        }

    def faked_information(self) -> FloatArray:
        """Information (3n, 3n) about the rotations that noise in the readings fakes.

        JᵀWJ takes its levers from the measured forces, noise included: a sensor that feels nothing
        but its own noise sideways would seem to know its yaw. The expectation of that part is
        Σ_k E[[n]×ᵀ Bᵀ W B [n]×], B = [I; [ρ_i]×].
        """
        M, B = sensing(self.state), self.at.wrench
        W = self.at.information * self.weight[:, None, None]
        C = np.einsum("knra,krs,knsb->knab", B, W, B, optimize=True)
        noise = M @ self.at.seen.force_cov @ np.swapaxes(M, -1, -2)
        return block_diagonal(*so3.information_of_crossing(C, noise).sum(axis=0))


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


@record
class Problem:
    """Postures compressed at a balance, and what is stated.

    compressed : (≤ q, q), as `statistic` forms it.
    """

    at: Balance
    compressed: FloatArray
    priors: Priors

    def features(self, state: State) -> tuple[FloatArray, FloatArray]:
        """ψ (q,) at a state, and its derivative (q, P)."""
        g = self.priors.rig.gravity
        return features(state, self.at, g), features_jacobian(state, self.at, g)

    def solved(
        self, start: State, *, pull: FloatArray | None = None, iterations: int = STEPS
    ) -> Solution[State]:
        """Gauss–Newton on the compressed postures and the priors; pull : as in `solve`."""
        active = self.priors.active
        return solve(
            self.compressed, self.features, self.priors, retract, start, active,
            pull=pull, iterations=iterations,
        )  # fmt: skip


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
        priors=priors,
        postures=at.seen,
        state=state,
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
        pull = noise_pull(at, state, at.information * weight[:, None, None])
        solution = Problem(at, statistic(at, weight), priors).solved(state, pull=pull)
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


#: Postures that a campaign is easily given besides; N, what a tare just before it leaves.
_MORE, _TARED = 5.0, 0.1
#: How much harder it is squeezed.
HARDER = 2.0


def prospects(of: Estimate[Fit]) -> tuple[Prospect, ...]:
    """What a few postures more, a harder squeeze, or a tare just before would bring."""
    fit, rig = of.fit, of.fit.rig
    used = int((fit.weight > 0).sum())
    found = [prospect(of, "postures", _MORE, count=(used + _MORE) / used)]
    if (squeezed := _squeezed(fit)) is not None:
        size, harder = squeezed
        found.append(prospect(of, "squeeze", size, rows=harder.factor))
    if np.any(rig.zero.std > 2 * _TARED):
        zero = UncertainValue(rig.zero.value, np.minimum(rig.zero.std, _TARED))
        tared = Priors(replace(rig, zero=zero), fit.postures.motion)(fit.state)[1]
        found.append(prospect(of, "tare", _TARED, priors=tared))
    return tuple(found)


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
