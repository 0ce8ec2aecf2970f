"""Does the rig file keep something from us? Score tests on the residual of a motion.

As for postures: each suspect is a set of columns that the model does not have, in the Fourier
coefficients whitened by the noise's own spectrum.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal.estimation.score_tests import (
    Suspect,
    Suspicion,
    likeliest,
    misstated_mountings,
    moving_zeros,
    speaking,
    stated_suspects,
)
from tdfscal.model.parameters import parameter_count
from tdfscal.model.statics import balance
from tdfscal.motioncal.design import instants, shifted, suspected
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.rows import reading_gain
from tdfscal.motioncal.uncertainty import MovingEstimate, by_spectrum
from tdfscal.numerics.least_squares import Asked
from tdfscal.records import FloatArray

#: One of so many instants of a block shows how its columns are made of readings.
_EVERY = 20
#: Share of the largest variance of an amount below which it is rounding.
_ROUNDING = 1e-12


def suspicions(of: MovingEstimate) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely."""
    fit = of.fit

    def widened(columns: FloatArray, lean: FloatArray, asked: Asked) -> Asked:
        return _widened(fit, columns, lean, asked)

    def noise() -> FloatArray:
        return noise_scores(fit, fit.slope_at(fit.state))

    suspects = [*_stated(fit), *_drifts(fit)]
    return likeliest(speaking(of, suspects, noise, always=True, widened=widened))


def undeclared(doubts: tuple[Suspicion, ...]) -> FloatArray | None:
    """Covariance (p, p) by what is suspected, as if declared with the size that it has here.

    Of suspects about as likely only one is true: the moves count by their likelihood. None where
    nothing is suspected, or so surely and harmfully that the result is rejected.
    """
    if not doubts or any(doubt.spoils_motion for doubt in doubts):
        return None
    moves = np.array([doubt.move for doubt in doubts])
    weight = np.array([doubt.weight for doubt in doubts])
    share = np.exp((weight - weight.max()) / 2)
    return np.asarray((moves.T * (share / share.sum())) @ moves)


def _widened(fit: MovingFit, columns: FloatArray, lean: FloatArray, asked: Asked) -> Asked:
    """The test with what the spectrum's own uncertainty adds to that of the amount."""
    equations, own = fit.normal_equations(columns), slice(-len(lean), None)
    leaning = np.zeros(fit.jacobian.shape[1] + len(lean))
    leaning[own] = lean

    def at(log_density: FloatArray) -> tuple[FloatArray, FloatArray]:
        step, root = equations.solved(log_density)
        return (step + root @ (root.T @ leaning))[own], root[own] @ root[own].T

    amount, covariance = at(fit.noise.log_density)
    values, axes = np.linalg.eigh(covariance + by_spectrum(fit, covariance, at))
    seen = values > _ROUNDING * values[-1]
    along = axes[:, seen].T @ amount
    return replace(asked, statistic=np.minimum(asked.statistic, np.sum(along**2 / values[seen])))


def _stated(fit: MovingFit) -> Iterator[Suspect]:
    """What the rig file states."""
    std, priors = fit.priors.still.full_std, len(fit.prior_residual)
    columns = np.pad(fit.all_slopes()[:, : len(std)], ((0, priors), (0, 0)))
    yield from stated_suspects(fit.rig, columns, std, fit.still.motions, priors)
    yield from misstated_mountings(fit.rig, len(columns), priors - fit.still_priors)


def _drifts(fit: MovingFit) -> Iterator[Suspect]:
    """Zeros that move with time or temperature, where the rig file declares none that move."""
    motion, n = suspected(fit.rig, fit.slow), fit.rig.n
    if motion is None:
        return
    names = ["drift" if kind == "time" else kind for kind in motion.kind]
    last = len(fit.psi) - fit.rests
    columns = fit.whiten(fit.data.design[:, last - 3 * n * len(names) : last])
    columns = np.pad(columns, ((0, len(fit.prior_residual)), (0, 0)))
    for name, part in zip(names, np.split(columns, len(names), axis=1), strict=True):
        yield from moving_zeros(name, part.reshape(-1, n, 3), 1.0)


def noise_scores(fit: MovingFit, slope: FloatArray) -> FloatArray:
    """Expected scores (P,) of the static parameters by the noise of the readings alone.

    slope : (q + …, P + 9), of the features. Noise of density S_F in reading a at one instant moves
    a column by ∂c/∂f_a and the balance by B M e_a: Σ S_F (∂c/∂f_a)ᵀ S⁻¹ (B M e_a), over all
    frequencies, and instants by the taper's weight.
    """
    rig, state = fit.rig, fit.state.still
    P = parameter_count(rig.n, state.motions)
    total = np.zeros(P)
    support, axis = np.nonzero(rig.axes)
    for item in fit.designs:
        some = slice(item.block.index.start, item.block.index.stop, _EVERY)
        weight = item.block.taper[0, ::_EVERY] ** 2
        place = shifted(fit.slow, item.block.index, fit.shift)[::_EVERY]
        seen = instants(rig, fit.slow, place, some)
        # The instants as they are, and again for every reading, that one moved by a newton.
        K, reading = len(seen), np.arange(len(support))
        seen = seen.subset(np.tile(np.arange(K), 1 + len(support)))
        force = seen.force.reshape(1 + len(support), K, rig.n, 3).copy()
        force[1 + reading, :, support, axis] += 1.0
        seen = replace(seen, force=force.reshape(-1, rig.n, 3))
        at = balance(seen, state, fit.origin.centre, rig.gravity)
        design = at.design.reshape(1 + len(support), K, 6, -1)
        # Σ_a over readings of (∂design/∂f_a)ᵀ W B M e_a.
        felt = reading_gain(item, fit.noise) @ at.noise_force[:K] * weight[:, None, None, None]
        along = np.tensordot(felt[:, support, :, axis], design[1:] - design[0], axes=3)
        total += along @ slope[: len(along), :P] / weight.sum()
    return total
