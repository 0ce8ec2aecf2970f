"""Maximum likelihood in motion: features → Fourier coefficients → spectrum ↔ fit → a new look.

The balance stays linear in the features of the model after tapering, Fourier transform and
weighting, so that the statistic of self-calibration, one triangular factor, holds for a moving
log too; what differs is the weight, which is estimated with the fit.

A trial (JCGM 101) draws all parameters together from their covariance, and takes the estimate to
where the balance, which is bent in rotations, zeros and load, leads it: one step of Gauss and
Newton on the statistic from the linear answer, whose error is of the third order. The evidence is
whether the result holds on stretches held out, and what is left over time.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tdfscal.estimation.fit import solve
from tdfscal.estimation.judged import HeldOut
from tdfscal.estimation.uncertainty import Estimate, simulate_angles
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, retract, with_motions
from tdfscal.model.statics import features, features_jacobian
from tdfscal.motioncal.blocks import SHORTEST, Block, blocks, rests_of
from tdfscal.motioncal.design import block_design, rms, unknowns_at_rest
from tdfscal.motioncal.fit import MovingFit, MovingPriors, MovingState
from tdfscal.motioncal.rows import NOTHING, NoiseModel, at_mean, gather, improve, initial
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo
from tdfscal.numerics.least_squares import (
    Solution,
    block_diagonal,
    covariance_root,
    gram_root,
    spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray

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
    edges = np.cumsum([0, *(unknowns_at_rest(rig) * len(own) for own in resting)]).tolist()
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
    return replace(fit, noise=at_mean(model, rows.bins, fitted / variance))


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


#: Trials at most unless asked otherwise.
MOST_TRIALS = 30_000
#: Trials worked on together.
_CHUNK = 2_000


def simulate(
    of: Estimate[MovingFit], rng: np.random.Generator, max_trials: int, known: BoolArray
) -> MonteCarlo:
    """Draw until the averages are stable or the trials run out.

    known : (n,), sensors whose angles the data determine; those of the others are not followed.
    """
    fit, still, g = of.fit, of.fit.still, of.fit.rig.gravity
    start, slope = features(still, fit.origin, g), features_jacobian(still, fit.origin, g)
    root = covariance_root(of.calibrated.covariance)
    followed = np.repeat(known, 3).astype(np.float64)
    turns, P = len(followed), slope.shape[1]
    # Where a change of the features takes the turns: (JᵀJ)⁻¹ Jᵀ of their columns.
    back = fit.whiten(fit.jacobian).T @ fit.whiten(fit.data.design[:, : len(start)])
    gain = -of.parts.root[:turns] @ (of.parts.root.T @ back)

    def draw(trials: int) -> FloatArray:
        step = np.zeros((trials, P))
        step[:, : len(root)] = rng.standard_normal((trials, len(root))) @ root.T
        step[:, :turns] *= followed
        bent = features(retract(still, step), fit.origin, g) - start - step @ slope.T
        turn = (step[:, :turns] + bent @ gain.T) * followed
        return np.asarray(so3.exp(turn.reshape(trials, -1, 3)) @ still.rotation)

    sure = of.uncertainty
    return simulate_angles(
        draw, still.rotation, sure.rpy_std, sure.coverage_factor, known, max_trials, chunk=_CHUNK
    )


#: Length of the stretches that are held out in turn, s, and how many at most.
_FOLD, _MOST = 15.0, 8
#: Blocks from which a log's own are held out.
_MANY = 4
#: Length of the means that are kept, s, and how many of them at most in a long log.
_MEAN, _MEANS = 1.0, 600


def hold_out(fit: MovingFit, keep: BoolArray, start: MovingState) -> HeldOut | None:
    """Predict stretches of the log from all the others; start : the nominal state.

    The blocks of a long log serve as they are; those of a short one are cut anew. None where there
    is but one.
    """
    at, time = fit, fit.slow.time
    if len(fit.blocks) < _MANY:
        seconds = float(keep.sum()) * fit.slow.step
        count = int(np.clip(seconds / max(_FOLD, 2 * SHORTEST), 2, _MOST))
        part = np.minimum(count * (time - time[0]) / (np.ptp(time) + fit.slow.step), count - 1)
        cut = [blocks(fit.slow, keep & (part.astype(int) == k)) for k in range(count)]
        together = tuple(block for own in cut for block in own)
        if len(together) < 2:
            return None
        at = at_state(fit.priors, together, fit.state, fit.noise)
    nominal = moved_to(at, start).psi
    folds = np.array_split(np.arange(len(at.blocks)), min(len(at.blocks), _MOST))
    both = np.concatenate([at.psi[:, None], at.slope], axis=1)
    prior = np.concatenate([at.prior_residual[:, None], at.prior_jacobian], axis=1)
    before, after, factors = [], [], []
    for fold in folds:
        items = [at.designs[k] for k in fold]
        rows = [item.white(item.wrench(both), at.noise) for item in items]
        factors.append(triangular(np.concatenate(rows)))
    for k, fold in enumerate(folds):
        others = np.concatenate([prior, *factors[:k], *factors[k + 1 :]])
        step = spectrum(others[:, 1:]).solve(others[:, 0])
        after.append(rms([at.designs[i] for i in fold], at.psi + at.slope @ step))
        before.append(rms([at.designs[i] for i in fold], nominal))
    return HeldOut(np.array(before), np.array(after))


@record
class ResidualWrench:
    """Means over a second, or over more of it in a long log.

    time : (N,), s, their middles. before, after : (N, 2), length of the residual force, N, and of
    the residual moment about the barycentre, N·m, with the nominal mounting and calibrated.
    """

    time: FloatArray
    before: FloatArray
    after: FloatArray


def residual_wrench(fit: MovingFit, before: State, after: State) -> ResidualWrench:
    """Residual wrench of two states in the band of a fit, both with its motion's parameters.

    An instant counts by the taper. Of forces that nobody measures it is what they leave.
    """
    states = (with_motions(state, fit.priors.motions) for state in (before, after))
    each = [fit.features_at(MovingState(state, fit.state.moving)) for state in states]
    psi, times, lengths = np.stack(each, axis=1), [], []
    mean = max(_MEAN, sum(block.seconds for block in fit.blocks) / _MEANS)
    for item in fit.designs:
        block, N = item.block, len(item.block)
        weighted = np.fft.irfft(item.wrench(psi) / block.scale, N, axis=0)
        count = max(1, round(block.seconds / mean))
        first = np.linspace(0, N, count, endpoint=False).astype(int)
        times.append(np.add.reduceat(fit.slow.time[block.index], first) / np.diff(first, append=N))
        weight = np.add.reduceat(block.taper[0], first)
        means = np.add.reduceat(weighted, first, axis=0) / weight[:, None, None]
        lengths.append(np.linalg.norm(means.reshape(count, 2, 3, 2), axis=2))
    length = np.concatenate(lengths)
    return ResidualWrench(np.concatenate(times), length[..., 0], length[..., 1])
