"""Maximum likelihood in motion: features → Fourier coefficients → spectrum ↔ fit → a new look.

The balance stays linear in the features of the model after tapering, Fourier transform and
weighting, so that the statistic of self-calibration, one triangular factor, holds for a moving
log too; what differs is the weight, which is estimated with the fit.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tdfscal.estimation.fit import solve
from tdfscal.frozen import replace
from tdfscal.motioncal.blocks import Block, rests_of
from tdfscal.motioncal.design import block_design
from tdfscal.motioncal.fit import MovingFit, MovingPriors, MovingState
from tdfscal.motioncal.rows import (
    NOTHING,
    NoiseModel,
    gather,
    improve,
    initial,
)
from tdfscal.numerics.least_squares import (
    Solution,
    block_diagonal,
    gram_root,
    triangular,
)
from tdfscal.records import FloatArray

#: Blocks that a long log is first fitted on.
_FEW = 2
#: Looks from a new linearisation at most, and the change, in standard deviations, that ends them.
_LOOKS, _SETTLED = 12, 0.01
#: That change for a long log, which starts from some of its blocks: what a step of 9 σ bends the
#: balance by is 0.01 to 0.02 σ (1,200 s at 40 to 1,000 Hz).
_NEAR = 2.0
#: Looks at most where forces that nobody measures have to be found along with the angles.
_LOOKS_ACROSS = 60
#: What a fit has by its state.
_AT_A_STATE = ("psi", "slope", "residual", "jacobian", "prior_residual", "prior_jacobian")
#: Steps of the spectrum per look, and the change of a logarithm that ends them.
_SCORES, _SCORED = 20, 0.02


def moved_to(fit: MovingFit, state: MovingState) -> MovingFit:
    """The fit at another state near by, by the same linearised balance.

    The turns at rests are the likeliest ones for it.
    """
    fit = _at(fit, state, np.zeros(fit.rests))
    if not fit.rests:
        return fit
    r, j = fit.whitened()
    C = j[:, -fit.rests :]  # the unit matrix among its rows is the turns' prior
    return _at(fit, state, np.asarray(-np.linalg.solve(C.T @ C, C.T @ r)))


def _at(fit: MovingFit, state: MovingState, turn: FloatArray) -> MovingFit:
    """The fit at a state and turns (rests,) at the rests."""
    psi, slope = fit.features_at(state), fit.slope_at(state)[:, fit.active]
    cut, unit, design = len(psi) - fit.rests, np.eye(fit.rests), fit.data.design
    psi[cut:] = turn
    jacobian = np.concatenate([design[:, :cut] @ slope[:cut], design[:, cut:]], axis=1)
    prior_r, prior_j = fit.priors(state)
    return replace(
        fit,
        state=state,
        psi=psi,
        slope=block_diagonal(slope[:cut], unit),
        residual=design @ psi,
        jacobian=jacobian,
        prior_residual=np.concatenate([prior_r, turn]),
        prior_jacobian=block_diagonal(prior_j, unit),
    )


def _solve(fit: MovingFit) -> Solution[MovingState]:
    """Gauss–Newton on the statistic of all rows, and the priors."""
    real = fit.whiten(fit.data.design)
    cut = real.shape[1] - fit.rests
    if fit.rests:
        # The turns at rests first: what is left below them has them eliminated.
        real = np.concatenate([real[:, cut:], real[:, :cut]], axis=1)
        real = np.concatenate([np.eye(fit.rests, real.shape[1]), real])
    compressed = triangular(real)[fit.rests :, fit.rests :]

    def psi(state: MovingState) -> tuple[FloatArray, FloatArray]:
        return fit.features_at(state)[:cut], fit.slope_at(state)[:cut]

    return solve(compressed, psi, fit.priors, MovingState.moved, fit.state, fit.active)


def at_state(
    priors: MovingPriors,
    blocks: tuple[Block, ...],
    state: MovingState,
    model: NoiseModel | None,
) -> MovingFit:
    """Linearise at a state; without a noise model, with one that is flat."""
    rig, slow = priors.rig, priors.slow
    resting = rests_of(slow, blocks)
    edges = np.cumsum([0, *(3 * len(own) for own in resting)]).tolist()
    pairs = [
        block_design(rig, slow, block, state.still, state.moving, own, slice(*place))
        for block, own, place in zip(blocks, resting, pairwise(edges), strict=True)
    ]
    designs = tuple(design for design, _ in pairs)
    low, rests = min(float(block.frequency[1]) for block in blocks) / 2, edges[-1]
    rows = gather(((item.rows(rests), len(item.mix)) for item in designs), low, model)
    fit = MovingFit(
        priors=priors,
        designs=designs,
        data=rows,
        origin=pairs[0][1],
        shift=state.moving,
        rests=rests,
        state=state,
        noise=model or NOTHING,
        iterations=0,
        converged=False,
        **dict.fromkeys(_AT_A_STATE, np.empty(0)),  # below
    )
    fit = _at(fit, state, np.zeros(rests))
    if model is None:
        longest = max(block.seconds for block in blocks)
        model = initial(rows.bins, fit.residual**2, rig.declared.positioner, longest)
    return replace(fit, noise=model)


def estimate_noise(fit: MovingFit) -> MovingFit:
    """Bring spectrum and linearised fit into agreement; the state stays."""
    model, rows, equations = fit.noise, fit.data, fit.normal_equations()
    for _ in range(_SCORES):
        step, root = equations.solved(model.log_density)
        variance = model.variance(rows.bins)
        fitted = np.sum((fit.jacobian @ root) ** 2, axis=1)
        power = (fit.residual + fit.jacobian @ step) ** 2 + fitted
        # A row stands for `count` values and is fitted as one: its share of them is used up.
        model, change = improve(model, rows.bins, power, fitted / variance)
        if change < _SCORED:
            break
    return replace(fit, noise=model)


def fit_moving(
    priors: MovingPriors,
    blocks: tuple[Block, ...],
    start: MovingState,
    model: NoiseModel | None = None,
    settled: float = _SETTLED,
) -> MovingFit:
    """Maximum-likelihood estimate of state and spectrum from one start.

    A long log is first fitted on a few of its blocks, then linearised there once as a whole.
    settled : change, in standard deviations, that ends the looks.
    """
    state, iterations, converged = start, 0, False
    few = blocks[:: -(-len(blocks) // _FEW)]
    if len(few) < len(blocks):
        settled = _NEAR
        first = fit_moving(priors, few, start, model, settled)
        state, model, iterations = first.state, first.noise, first.iterations
    for look in range(_LOOKS if priors.rig.axes.all() else _LOOKS_ACROSS):
        fit = estimate_noise(at_state(priors, blocks, state, model))
        model = fit.noise
        solution = _solve(fit)
        iterations += solution.iterations
        r, j = moved_to(fit, state).whitened()
        step = np.linalg.norm(gram_root(j.T @ j, len(j)).T @ (j.T @ r))
        state = solution.state
        fit = moved_to(fit, state)
        converged = bool(step < settled * np.sqrt(j.shape[1]))
        if converged or (look > 0 and not solution.converged):
            break
    return replace(fit, iterations=iterations, converged=converged)
