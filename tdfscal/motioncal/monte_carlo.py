"""Propagation of distributions in motion (JCGM 101): spectrum, noise and the turns' own curvature.

A trial draws the spectrum from its own uncertainty, then what noise of that spectrum does to all
parameters, the positioners' errors as the covariance has them, and takes the estimate to where
the balance, which is bent in rotations, zeros and load, leads it: one step of Gauss and Newton on
the statistic from the linear answer, whose error is of the third order. The linear interval has
the first of these to the second order and the last not at all.
"""

from __future__ import annotations

import numpy as np

from tdfscal.estimation.uncertainty import simulate_angles
from tdfscal.model.parameters import parameter_count, retract
from tdfscal.model.statics import features
from tdfscal.motioncal.covariance import MovingEstimate, faked_information
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo
from tdfscal.numerics.least_squares import block_diagonal, triangular
from tdfscal.records import BoolArray, FloatArray

#: Spectra drawn, which the trials share, and trials at most unless asked otherwise.
_SPECTRA, MOST_TRIALS = 48, 30_000
#: Least share of an information that noise in the readings has not faked.
_LEAST = 0.1
#: Trials worked on together.
_CHUNK = 2_000


class Sampler:
    """Draws what a log with other noise would have given.

    of : the estimate, whose covariance at the spectrum the draws have.
    followed : (n, 1), 1 for sensors whose turns count, 0 for those that stay as they are.
    """

    def __init__(self, of: MovingEstimate, rng: np.random.Generator, followed: FloatArray) -> None:
        fit = of.fit
        self.fit, self.followed = fit, followed
        rows, model = fit.data, fit.noise
        q = len(features(fit.state.still, fit.origin, fit.rig.gravity))
        equations = fit.normal_equations()
        here, root = equations.solved(model.log_density)
        variance = model.variance(rows.bins)
        white = rows.weighted(rows.design[:, :q], variance)
        p = int(fit.active.sum())
        # Gain (p, q): where a change of the static features takes the estimate.
        self.gain = -root[:p] @ (root.T @ (rows.weighted(fit.jacobian, variance).T @ white))
        wider = _mapping(root[:p] @ root[:p].T, of.drawn)
        unfaked = np.zeros((len(here) - 3 * fit.rig.n,) * 2)
        faked = block_diagonal(faked_information(fit), unfaked)
        self.shift, self.root = [], []
        values, axes = np.linalg.eigh(model.covariance)
        spread = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
        away = rng.standard_normal((_SPECTRA // 2, len(spread))) @ spread
        # In pairs about the estimate, so that few of them have its mean.
        for density in model.log_density + np.concatenate([away, -away]):
            step, root = equations.solved(density)
            self.shift.append((step - here)[:p])
            # (JᵀJ − faked)⁻¹ within the directions that are seen.
            less = np.eye(root.shape[1]) - root.T @ faked @ root
            left, vectors = np.linalg.eigh(less)
            own = root @ (vectors / np.sqrt(np.maximum(left, _LEAST)))
            # A root that rounding leaves as it is: the same numbers draw the same trials.
            half = triangular((wider @ own[:p]).T).T
            self.root.append(half * np.sign(np.diagonal(half)))

    def draw(self, rng: np.random.Generator, trials: int) -> FloatArray:
        """Rotations (T, n, 3, 3)."""
        step = np.empty((trials, len(self.gain)))
        which = rng.integers(_SPECTRA, size=trials)
        for k in range(_SPECTRA):
            own = np.flatnonzero(which == k)
            noise = rng.standard_normal((len(own), self.root[k].shape[1]))
            step[own] = self.shift[k] + noise @ self.root[k].T
        still = np.repeat(self.followed, 3)
        step[:, : len(still)] *= still
        step += self._bent(step) @ self.gain.T
        turns = (step[:, : len(still)] * still).reshape(trials, -1, 3)
        return np.asarray(so3.exp(turns) @ self.fit.state.still.rotation)

    def _bent(self, step: FloatArray) -> FloatArray:
        """Static features (T, q) at steps (T, p) less their linearisation."""
        fit, g = self.fit, self.fit.rig.gravity
        still, static = fit.state.still, np.flatnonzero(fit.active)
        P = parameter_count(still.n, still.motions)
        static = static[static < P]
        full = np.zeros((len(step), P))
        full[:, static] = step[:, : len(static)]
        start = features(still, fit.origin, g)
        bent = features(retract(still, full), fit.origin, g) - start
        bent -= step[:, : len(static)] @ fit.slope[: len(start), : len(static)].T
        return np.asarray(bent)


def _mapping(before: FloatArray, after: FloatArray) -> FloatArray:
    """T (p, p) with T before Tᵀ = after, the symmetric one where `before` is the unit matrix."""
    scale = np.sqrt(np.diagonal(before))
    scale = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(before / np.outer(scale, scale))
    seen = values > values[-1] * len(values) * np.finfo(float).eps
    white = axes[:, seen] / np.sqrt(values[seen])
    grown, along = np.linalg.eigh(white.T @ (after / np.outer(scale, scale)) @ white)
    root = (along * np.sqrt(np.maximum(grown, 0.0))) @ along.T
    back = axes[:, seen] * np.sqrt(values[seen])
    return np.asarray(scale[:, None] * (back @ root @ white.T) / scale)


def simulate(
    of: MovingEstimate, rng: np.random.Generator, max_trials: int, known: BoolArray
) -> MonteCarlo:
    """Draw until the averages are stable or the trials run out.

    known : (n,), sensors whose angles the data determine; those of the others are not followed.
    """
    sampler = Sampler(of, rng, known[:, None].astype(np.float64))
    base, linear = of.fit.state.still.rotation, of.uncertainty
    return simulate_angles(
        lambda size: sampler.draw(rng, size), base, linear, known, max_trials, chunk=_CHUNK
    )
