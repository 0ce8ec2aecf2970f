"""Monte Carlo propagation of distributions through the estimator (JCGM 101).

Noise ν in the readings changes the design of a posture by D = Σ_i V B_i X_i U_i ν_i, linear in the
rotations. Of all postures' designs A the estimate needs only A's triangular factor R, A = Q R; of
those of a perturbed campaign, (A + D)ᵀ(A + D) = (R + QᵀD)ᵀ(R + QᵀD) + D⊥ᵀD⊥. QᵀD is normal, with a
covariance that is summed over the postures once, and D⊥ᵀD⊥, which no part of A sees, is its mean:
turned forces of one sensor with noise alike in all directions cost the same whatever the turn. So
a trial is drawn on a few dozen numbers, exactly in what is linear in the noise and in the mean in
what is quadratic, and costs the same for ten postures as for ten thousand. Of QᵀD a trial near the
estimate needs no more than what it makes of the estimate and of its slopes by turns.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tdfscal.estimation.fit import Priors
from tdfscal.estimation.uncertainty import UNDECLARED, Estimate, simulate_angles
from tdfscal.frozen import replace
from tdfscal.model.parameters import EVEN_TURN, unmixing
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.numerics.rotation_fits import crossed, descend, stacked
from tdfscal.records import BoolArray, FloatArray
from tdfscal.selfcal.estimator import Fit, Problem, statistic
from tdfscal.selfcal.mounting_search import Profile, profile

#: Trials solved together: what fits into a cache.
CHUNK = 1_000
#: Steps with the estimate's own Hessian, and damped Newton steps for the trials that need them.
_STEPS, _DAMPED = 8, 100
#: A trial is solved when its next step would be below this many standard uncertainties.
_SOLVED = 1e-3
#: Noise is drawn in single precision, at half the cost: it is a thousandth of what it is added to.
_NOISE = np.float32
#: Turns up to which what the noise makes of the balance is linear in them, rad.
_NEAR = 0.05
#: A direction with turns less certain than this is that of a sensor which lacks an axis, rad.
_UNMEASURED = 0.3 * EVEN_TURN


class Sampler:
    """Draws perturbed campaigns about an estimate as what they leave of the balance, and solves."""

    def __init__(self, fit: Fit, parts: Spectrum, birge: float) -> None:
        self.fit = fit
        self.inflate = max(1.0, birge)
        priors = Priors(fit.rig, fit.postures.motion)
        problem = Problem(fit.at, statistic(fit.at, fit.weight), priors)
        self.profile = profile(problem, fit.state, pull=fit.feature_pull)
        _, values, right = np.linalg.svd(self.profile.root, full_matrices=False)
        keep = values > values[0] * len(values) * np.finfo(float).eps
        self.root = values[keep, None] * right[keep]  # R, up to a turn of its rows
        inverse = right[keep].T / values[keep]
        turns = np.flatnonzero(fit.active)[: 3 * fit.rig.n]
        # A turn that only its prior knows is followed by no trial: readings do not depend on it.
        root = parts.root[: len(turns)]
        root = root[:, np.linalg.norm(root, axis=0) < _UNMEASURED]
        self.covariance = root @ root.T
        self._postures(inverse, self.profile)

    def _postures(self, inverse: FloatArray, given: Profile) -> None:
        """Sum over the postures what their noise does to QᵀD, and the mean of D⊥ᵀD⊥."""
        fit, at = self.fit, self.fit.at
        used, n = fit.weight > 0, fit.rig.n
        whitener = at.whitener[used] * np.sqrt(fit.weight[used])[:, None, None]
        design = whitener @ at.design[used]
        Q = design @ (given.features @ inverse)  # (K, 6, r)
        spanned = np.concatenate([Q, design @ given.eliminated], axis=2)
        unmix = unmixing(fit.state.sensitivity)
        cov = self.inflate**2 * unmix @ at.seen.force_cov[used] @ np.swapaxes(unmix, -1, -2)
        axes = np.linalg.eigh(cov.mean(axis=0))[1]  # (n, 3, 3), columns
        variance = np.einsum("knas,nas->kns", cov @ axes, axes)
        self.mixing, self.effects, rest = [], [], []
        for i in range(n):
            VB = whitener @ at.wrench[used][:, i]  # (K, 6, 3)
            own = (np.swapaxes(Q, 1, 2) @ VB).reshape(len(VB), -1)  # (K, 3r)
            loose = np.swapaxes(VB, 1, 2) @ VB
            seen = np.swapaxes(spanned, 1, 2) @ VB
            loose -= np.swapaxes(seen, 1, 2) @ seen
            # What a unit of each number does to QᵀD, (m, r, 9), axis after axis of the noise.
            roots = [_root(own * np.sqrt(variance[:, i, s])[:, None]) for s in range(3)]
            along = [np.multiply.outer(root.T, axes[i, :, s]) for s, root in enumerate(roots)]
            self.mixing.append(np.concatenate(along).reshape(-1, Q.shape[2], 9))
            # To the balance at the estimate, and to its slopes by turns about x, y, z.
            X = fit.state.rotation[i]
            turned = np.stack([X, *(so3.hat(np.eye(3)) @ X)]).reshape(4, 9)
            effect = np.swapaxes(self.mixing[i] @ turned.T, 1, 2)
            self.effects.append(effect.reshape(len(effect), -1).astype(_NOISE))
            lost = np.einsum("kab,kcd->acbd", loose, cov[:, i]).reshape(9, 9)
            rest.append(np.pad(_root_of(lost).T, ((0, 0), (9 * i, 9 * (n - i) - 8))))
        self.rest = np.concatenate(rest)
        turning = at.noise_turn[used] @ at.turn_cov[used] @ np.swapaxes(at.noise_turn[used], 1, 2)
        turning[:, 3:, 3:] += fit.postures.moment_var * np.eye(3)
        through = np.swapaxes(Q, 1, 2) @ whitener
        other = self.inflate**2 * np.tensordot(through @ turning, through, axes=((0, 2), (0, 2)))
        prior = given.prior @ inverse
        if fit.rig.earlier is not None:
            prior[-len(fit.rig.earlier.root) :] *= self.inflate
        self.common = _root_of(other + prior.T @ prior)

    def _roots(self, numbers: list[npt.NDArray[np.float32]], common: FloatArray) -> FloatArray:
        """Roots (T, m, 9n + 1) of perturbed campaigns; numbers, common : their noise."""
        T, (rank, width) = len(common), self.root.shape
        noise = np.zeros((T, rank, width))
        noise[:, :, -1] = common
        for i, (mixing, own) in enumerate(zip(self.mixing, numbers, strict=True)):
            noise[:, :, 9 * i : 9 * i + 9] = np.tensordot(own, mixing, 1)
        rest = np.broadcast_to(self.rest, (T, *self.rest.shape))
        return np.concatenate([self.root + noise, rest], axis=1)

    def draw(self, rng: np.random.Generator, T: int) -> tuple[FloatArray, BoolArray]:
        """Rotations (T, n, 3, 3) of perturbed campaigns, and which settled.

        Steps with the estimate's Hessian and each trial's gradient: where these do not contract
        (weak rigs), or lead far, a damped Newton iteration from the estimate takes over.
        """
        base, rank = self.fit.state.rotation, len(self.root)
        # Standard normal, per sensor; and of poses, hinges and priors together.
        numbers = [rng.standard_normal((T, len(effect)), dtype=_NOISE) for effect in self.effects]
        common = rng.standard_normal((T, self.common.shape[1])) @ self.common.T
        each = zip(numbers, self.effects, strict=True)
        noise = [(z @ effect).reshape(T, 4, rank) for z, effect in each]
        felt = common + sum(own[:, 0] for own in noise)
        rotation, turn = np.broadcast_to(base, (T, *base.shape)), np.zeros((T, len(base), 3))
        scale = np.sqrt(np.diagonal(self.covariance))
        scale = np.where(scale > 0, scale, np.inf)  # what no posture sees stays where it is
        gram, shrinks, size = self.rest.T @ self.rest, np.ones(T), np.full(T, np.inf)
        with np.errstate(over="ignore", invalid="ignore"):
            for look in range(_STEPS):
                y = stacked(rotation)
                residual = y @ self.root.T + felt
                for i, own in enumerate(noise if look else ()):
                    residual += np.einsum("tjr,tj->tr", own[:, 1:], turn[:, i].astype(_NOISE))
                gradient = so3.axial(crossed(rotation, residual @ self.root + y @ gram))
                left = residual.astype(_NOISE)
                for i, own in enumerate(noise):
                    gradient[:, i] += np.einsum("tjr,tr->tj", own[:, 1:], left)
                step = -gradient.reshape(T, -1) @ self.covariance
                before, size = size, np.abs(step / scale).max(axis=1)
                step = step.reshape(turn.shape)
                rotation, turn = so3.exp(step) @ rotation, turn + step
                # Steps shrink by the same factor each time: so large will the next one be.
                shrinks = np.minimum(size / before, 1.0) if look else shrinks
                solved = size * shrinks < _SOLVED
                if solved.all() or not (size < 0.7 * before).any():
                    break
        hard = np.flatnonzero(~(solved & (np.abs(turn).max(axis=(1, 2)) < _NEAR)))
        settled = np.ones(T, dtype=np.bool_)
        if len(hard):
            start = np.broadcast_to(base, (len(hard), *base.shape))
            roots = self._roots([own[hard] for own in numbers], common[hard])
            found = descend(roots, start, iterations=_DAMPED, tolerance=_SOLVED, curved=True)
            rotation[hard], settled[hard] = found.rotation, found.settled
        return rotation, settled


def _root(rows: FloatArray) -> FloatArray:
    """U (m, r) with U Uᵀ = rowsᵀ rows, rows (K, m), in as few columns as may be."""
    if len(rows) <= rows.shape[1]:
        return np.asarray(rows.T)
    return _root_of(rows.T @ rows)


def _root_of(covariance: FloatArray) -> FloatArray:
    """U (m, r) with U Uᵀ the covariance."""
    values, vectors = np.linalg.eigh(covariance)
    keep = values > values[-1] * 1e-12
    return np.asarray(vectors[:, keep] * np.sqrt(values[keep]))


def simulate(
    of: Estimate[Fit], rng: np.random.Generator, max_trials: int, known: BoolArray
) -> MonteCarlo:
    """Perturb and solve until the averages are stable or the trials run out.

    known : (n,), sensors whose angles the data determine; those of the others are not followed.
    """
    sampler = Sampler(of.fit, of.parts, of.quality.birge)
    base, unsettled = of.fit.state.rotation, 0
    undeclared = None
    if UNDECLARED in of.shares:
        undeclared = _root_of(of.shares[UNDECLARED][: 3 * len(base), : 3 * len(base)])

    def draw(size: int) -> FloatArray:
        nonlocal unsettled
        rotation, settled = sampler.draw(rng, size)
        unsettled += int(np.sum(~settled))
        if undeclared is not None:
            turn = rng.standard_normal((size, undeclared.shape[1])) @ undeclared.T
            rotation = so3.exp(turn.reshape(size, -1, 3)) @ rotation
        return rotation

    sure = of.uncertainty
    found = simulate_angles(
        draw, base, sure.rpy_std, sure.coverage_factor, known, max_trials, chunk=CHUNK
    )
    return replace(found, unsettled=unsettled)
