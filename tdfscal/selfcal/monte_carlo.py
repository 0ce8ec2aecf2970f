"""Monte Carlo propagation of distributions through the estimator (JCGM 101)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model.batch import Equations, Perturbed, Trials
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.numerics.propagation import propagate
from tdfscal.records import BoolArray, FloatArray
from tdfscal.selfcal.covariance import Uncertainty
from tdfscal.selfcal.estimator import Fit
from tdfscal.significance import INTERVAL_COVERAGE

#: Trials solved together: what fits into a cache.
CHUNK = 100
_STEPS = 25
#: A trial is solved when its last step is below this many standard uncertainties; each step is a
#: hundredth of the one before.
_SOLVED = 1e-4


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """What the trials show, per angle; all (n, 3) in rad.

    mean, std : of roll, pitch, yaw. low, high : probabilistically symmetric 95 % interval.
    tolerance, stable : as `Propagated`. validated : the linear interval agrees with the trials'
    within the tolerance (JCGM 101, clause 8). sample : (trials, n, 3), deviations of some trials
    from the estimate.
    """

    trials: int
    mean: FloatArray
    std: FloatArray
    low: FloatArray
    high: FloatArray
    tolerance: FloatArray
    stable: bool
    validated: bool
    sample: FloatArray


class Sampler:
    """Perturbs all inputs about an estimate and solves again, many trials at once."""

    def __init__(self, fit: Fit, parts: Spectrum, birge: float) -> None:
        used, at = fit.weight > 0, fit.at
        self.fit = fit
        self.equations = Equations(at, used, fit.state, fit.active, fit.rig.gravity)
        self.reading = fit.postures.force[used]
        inflate = self.inflate = max(1.0, birge)
        self.force_root = inflate * covariance_root(fit.postures.force_cov[used])
        self.turn_root = inflate * at.noise_turn[used] @ covariance_root(at.turn_cov[used])
        self.moment_std = inflate * np.sqrt(fit.postures.moment_var)
        self.weight = at.information[used]
        self.posterior = parts.root @ parts.root.T

    def perturb(self, rng: np.random.Generator, trials: int) -> tuple[Perturbed, FloatArray]:
        """Draw the inputs of `trials` campaigns, and the offsets (m, T) of the prior rows."""
        K, n, _ = self.reading.shape
        noise = self.force_root @ rng.standard_normal((K, n, 3, trials))
        wrench = self.turn_root @ rng.standard_normal((K, 3, trials))
        if self.moment_std > 0:
            wrench[:, 3:] += self.moment_std * rng.standard_normal((K, 3, trials))
        offset = rng.standard_normal((len(self.fit.prior_residual), trials))
        if self.fit.rig.earlier is not None:
            offset[-len(self.fit.rig.earlier.root) :] *= self.inflate
        return Perturbed(self.reading[..., None] + noise, wrench), offset

    def solve(self, data: Perturbed, offset: FloatArray) -> tuple[Trials, FloatArray]:
        """Least-squares states of the T trials, and the total steps (p, T) to them.

        Newton steps with the estimate's normal matrix and each trial's exact gradient: the matrix
        only sets the pace, so the end is the trial's own solution.
        """
        fit, active = self.fit, np.flatnonzero(self.fit.active)
        T = offset.shape[1]
        total = np.zeros((len(active), T))
        trials = Trials.at(fit.state, T)
        scale = np.sqrt(np.diagonal(self.posterior))
        scale = np.where(scale > 0, scale, 1.0)[:, None]
        for _ in range(_STEPS):
            v = self.weight @ self.equations.residual(trials, data)
            gradient = self.equations.pull_back(trials, data, v)[active]
            prior = fit.prior_residual[:, None] + fit.prior_jacobian @ total - offset
            step = -self.posterior @ (gradient + fit.prior_jacobian.T @ prior)
            total += step
            full = np.zeros((len(fit.active), T))
            full[active] = step
            trials = trials.moved(full)
            if np.max(np.abs(step) / scale) < _SOLVED:
                break
        return trials, total


def covariance_root(cov: FloatArray) -> FloatArray:
    """Square root of covariances (..., 3, 3), zero variances included."""
    values, vectors = np.linalg.eigh(cov)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def simulate(
    fit: Fit,
    parts: Spectrum,
    linear: Uncertainty,
    birge: float,
    rng: np.random.Generator,
    max_trials: int,
    *,
    known: BoolArray | None = None,
) -> MonteCarlo:
    """Perturb and solve until the averages are stable or the trials run out.

    known : (n,), sensors whose angles the data determine; those of the others are not followed.
    """
    followed = np.ones((fit.rig.n, 1)) if known is None else known[:, None].astype(np.float64)
    sampler = Sampler(fit, parts, birge)
    estimate = so3.to_rpy(fit.state.rotation)

    def draw(size: int) -> FloatArray:
        chunks = [min(CHUNK, size - start) for start in range(0, size, CHUNK)]
        drawn = np.concatenate([_angles(sampler, rng, estimate, chunk) for chunk in chunks])
        return np.asarray(followed * drawn)

    found = propagate(draw, linear.rpy_std, INTERVAL_COVERAGE, max_trials)
    half = followed * linear.coverage_factor * linear.rpy_std
    return MonteCarlo(
        trials=found.trials,
        mean=estimate + found.mean,
        std=found.std,
        low=estimate + found.low,
        high=estimate + found.high,
        tolerance=found.tolerance,
        stable=found.stable,
        validated=found.validates(-half, half),
        sample=found.sample,
    )


def _angles(
    sampler: Sampler, rng: np.random.Generator, estimate: FloatArray, trials: int
) -> FloatArray:
    """Deviations (trials, n, 3) of roll, pitch, yaw from the estimate, in (−π, π]."""
    solved, _ = sampler.solve(*sampler.perturb(rng, trials))
    return so3.wrapped(so3.to_rpy(solved.rotation) - estimate)
