"""Maximum likelihood in motion: features → Fourier coefficients → spectrum ↔ fit → a new look.

The balance stays linear in the features of the model after tapering, Fourier transform and
weighting, so that the statistic of self-calibration, one triangular factor, holds for a moving
log too; what differs is the weight, which is estimated with the fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model import dynamics
from tdfscal.model.dynamics import Moving
from tdfscal.model.parameters import State, retract
from tdfscal.model.statics import Balance, features, features_jacobian
from tdfscal.motioncal import noise
from tdfscal.motioncal.blocks import Block, ComplexArray
from tdfscal.motioncal.design import BlockDesign, block_design, drifting
from tdfscal.motioncal.noise import NoiseModel
from tdfscal.motioncal.normal_equations import NormalEquations
from tdfscal.motioncal.rests import rests as find_rests
from tdfscal.motioncal.rows import Rows, bins_of, gather, independent
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.least_squares import (
    Solution,
    Spectrum,
    gauss_newton,
    gram_root,
    spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import Priors

#: Blocks that a long log is first fitted on, and those that a linearisation is checked on.
_FEW, _PROBES = 2, 1
#: Looks from a new linearisation at most, and the change, in standard deviations, that ends them.
_LOOKS, _SETTLED = 12, 0.01
#: Looks at most where forces that nobody measures have to be found along with the angles.
_LOOKS_ACROSS = 60
#: Steps of the spectrum per look, and the change of a logarithm that ends them.
_SCORES, _SCORED = 20, 0.02


@dataclass(frozen=True, slots=True)
class MovingState:
    """All parameters: those of statics and those of the motion."""

    still: State
    moving: Moving

    def moved(self, step: FloatArray) -> MovingState:
        """Retract by a step (P + 8,)."""
        cut = len(step) - dynamics.PARAMETERS
        return MovingState(
            retract(self.still, step[:cut]), Moving.of(self.moving.vector + step[cut:])
        )


class MovingPriors:
    """Whitened prior rows of all parameters, statics first, by the active ones.

    delay : stated in the rig file, s.
    """

    def __init__(self, rig: Rig, slow: Slow, delay: UncertainValue) -> None:
        self.still = Priors(rig, drifting(rig, slow))
        self.mean, self.std = dynamics.prior(rig, float(delay.value), float(delay.std))
        self.free = self.std > 0
        self.active = np.concatenate([self.still.active, self.free])

    def __call__(self, state: MovingState) -> tuple[FloatArray, FloatArray]:
        """Residual (m,) and Jacobian (m, p)."""
        r, j = self.still(state.still)
        more = (state.moving.vector - self.mean.vector)[self.free] / self.std[self.free]
        own = np.diag(1 / self.std[self.free])
        rows = np.zeros((len(r) + len(more), j.shape[1] + len(more)))
        rows[: len(r), : j.shape[1]] = j
        rows[len(r) :, j.shape[1] :] = own
        return np.concatenate([r, more]), rows


@dataclass(frozen=True, slots=True)
class MovingFit:
    """An estimate with all that its uncertainty needs.

    rests : number of turns at rests, unknowns after the p active parameters. psi : (q + 12 + s +
    rests,), features. slope : (…, p + rests), their slopes by all that is unknown.
    residual (M + C,), jacobian (M + C, p + rests) : of the rows at the estimate, not whitened.
    prior_residual (m,), prior_jacobian (m, p + rests) : whitened. origin : what the features
    count from.
    delay : s, by which the poses of the designs are shifted.
    """

    rig: Rig
    slow: Slow
    designs: tuple[BlockDesign, ...]
    rows: Rows
    origin: Balance
    delay: float
    state: MovingState
    active: BoolArray
    rests: int
    noise: NoiseModel
    psi: FloatArray
    slope: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    prior_residual: FloatArray
    prior_jacobian: FloatArray
    iterations: int
    converged: bool

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The stretches that were used."""
        return tuple(design.block for design in self.designs)

    def whitened(self) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian as rows of unit variance, priors last."""
        rows, variance = self.rows, self.noise.variance(self.rows.bins)
        return (
            np.concatenate([rows.weighted(self.residual, variance), self.prior_residual]),
            np.concatenate([rows.weighted(self.jacobian, variance), self.prior_jacobian]),
        )

    def normal_equations(self, more: FloatArray | None = None) -> NormalEquations:
        """Those of the residual, the Jacobian and more columns (M + C + m, c), white as they are.

        They hold for any spectrum of the noise.
        """
        r, j = self.whitened()
        columns = [r[:, None], j] if more is None else [r[:, None], j, more]
        return NormalEquations(self.rows, self.noise, np.concatenate(columns, axis=1))

    def information(self) -> Spectrum:
        """Decompose the white Jacobian by its triangular factor, whose rows are no coefficients."""
        _, jacobian = self.whitened()
        return spectrum(triangular(jacobian), len(jacobian))

    def wrenches(self) -> list[ComplexArray]:
        """Residual wrench (F, 6) of every block."""
        return [item.wrench(self.psi) for item in self.designs]

    @property
    def cost(self) -> float:
        """χ² of rows and priors."""
        r, _ = self.whitened()
        return float(r @ r)


def _features(rig: Rig, state: MovingState, origin: Balance, delay: float, size: int) -> FloatArray:
    still = features(state.still, origin, rig.gravity)
    more = dynamics.features(state.still, state.moving, origin.centre, delay)
    out = np.zeros(size)
    out[: len(still) + len(more)] = np.concatenate([still, more])
    return out


def slope_of(rig: Rig, state: MovingState, origin: Balance, size: int) -> FloatArray:
    """∂ features / ∂ all parameters, (size, P + 8); suspects have none."""
    still = features_jacobian(state.still, origin, rig.gravity)
    more = dynamics.features_jacobian(state.still, origin.centre)
    out = np.zeros((size, more.shape[1]))
    out[: len(still), : still.shape[1]] = still
    out[len(still) : len(still) + len(more)] = more
    return out


def moved_to(fit: MovingFit, state: MovingState, priors: MovingPriors) -> MovingFit:
    """The fit at another state near by, by the same linearised balance.

    The turns at rests are the likeliest ones for it.
    """
    fit = _at(fit, state, priors, np.zeros(fit.rests))
    if not fit.rests:
        return fit
    r, j = fit.whitened()
    C = j[:, -fit.rests :]  # the unit matrix among its rows is the turns' prior
    turn = -np.linalg.solve(C.T @ C, C.T @ r)
    return _at(fit, state, priors, np.asarray(turn))


def _at(fit: MovingFit, state: MovingState, priors: MovingPriors, turn: FloatArray) -> MovingFit:
    """The fit at a state and turns (rests,) at the rests."""
    size, cut, p = len(fit.psi), len(fit.psi) - fit.rests, int(fit.active.sum())
    psi = _features(fit.rig, state, fit.origin, fit.delay, size)
    psi[cut:] = turn
    slope = np.zeros((size, p + fit.rests))
    slope[:, :p] = slope_of(fit.rig, state, fit.origin, size)[:, fit.active]
    slope[cut:, p:] = np.eye(fit.rests)
    prior_r, prior_j = priors(state)
    prior = np.zeros((len(prior_r) + fit.rests, p + fit.rests))
    prior[: len(prior_r), :p] = prior_j
    prior[len(prior_r) :, p:] = np.eye(fit.rests)
    return replace(
        fit,
        state=state,
        psi=psi,
        slope=slope,
        residual=fit.rows.design @ psi,
        jacobian=fit.rows.design @ slope,
        prior_residual=np.concatenate([prior_r, turn]),
        prior_jacobian=prior,
    )


def _solve(fit: MovingFit, priors: MovingPriors) -> Solution[MovingState]:
    """Gauss–Newton on the statistic of all rows, and the priors."""
    rig, rows, active = fit.rig, fit.rows, fit.active
    real = rows.weighted(rows.design, fit.noise.variance(rows.bins))
    size = real.shape[1] - fit.rests
    if fit.rests:
        # The turns at rests first: what is left below them has them eliminated.
        real = np.concatenate([real[:, size:], real[:, :size]], axis=1)
        real = np.concatenate([np.eye(fit.rests, real.shape[1]), real])
    compressed = triangular(real)[fit.rests :, fit.rests :]

    def model(state: MovingState) -> tuple[FloatArray, FloatArray]:
        prior_r, prior_j = priors(state)
        r = compressed @ _features(rig, state, fit.origin, fit.delay, size)
        j = compressed @ slope_of(rig, state, fit.origin, size)[:, active]
        return np.concatenate([r, prior_r]), np.concatenate([j, prior_j])

    def move(state: MovingState, step: FloatArray) -> MovingState:
        full = np.zeros(len(active))
        full[active] = step
        return state.moved(full)

    return gauss_newton(model, move, fit.state)


def at_state(
    rig: Rig,
    slow: Slow,
    blocks: tuple[Block, ...],
    state: MovingState,
    priors: MovingPriors,
    model: NoiseModel | None,
) -> MovingFit:
    """Linearise at a state; without a noise model, with one that is flat."""
    resting = find_rests(slow, blocks)
    pairs = [
        block_design(rig, slow, b, state.still, state.moving, own)
        for b, own in zip(blocks, resting, strict=True)
    ]
    last = np.cumsum([3 * len(own) for own in resting])
    designs = tuple(
        replace(design, place=slice(int(stop) - 3 * len(own), int(stop)))
        for (design, _), own, stop in zip(pairs, resting, last, strict=True)
    )
    rows, none = gather(designs, model), np.empty(0)
    size = rows.design.shape[1]
    fit = MovingFit(
        rig=rig,
        slow=slow,
        designs=designs,
        rows=rows,
        origin=pairs[0][1],
        delay=state.moving.delay,
        state=state,
        active=priors.active,
        rests=int(last[-1]),
        noise=model or noise.NOTHING,
        psi=np.zeros(size),
        slope=np.empty(0),
        residual=none,
        jacobian=none,
        prior_residual=np.empty(0),
        prior_jacobian=np.empty(0),
        iterations=0,
        converged=False,
    )
    fit = _at(fit, state, priors, np.zeros(fit.rests))
    if model is None:
        longest = max(b.step * b.taper.shape[1] for b in blocks)
        power = rows.power(fit.residual[:, None])
        model = noise.initial(rows.bins, power, rig.declared.positioner, longest)
    return replace(fit, noise=model)


def estimate_noise(fit: MovingFit) -> MovingFit:
    """Bring spectrum and linearised fit into agreement; the state stays."""
    model, rows, equations = fit.noise, fit.rows, fit.normal_equations()
    for _ in range(_SCORES):
        step, root = equations.solved(model.log_density)
        variance = model.variance(rows.bins)
        fitted = rows.power(fit.jacobian @ root)
        power = rows.power((fit.residual + fit.jacobian @ step)[:, None]) + fitted
        # A row stands for `count` values and is fitted as one: its share of them is used up.
        model, change = noise.improve(model, rows.bins, power, fitted / variance)
        if change < _SCORED:
            break
    return replace(fit, noise=model)


def fit_moving(
    rig: Rig,
    slow: Slow,
    blocks: tuple[Block, ...],
    start: MovingState,
    delay: UncertainValue,
    model: NoiseModel | None = None,
) -> MovingFit:
    """Maximum-likelihood estimate of state and spectrum from one start.

    A long log is first fitted on a few of its blocks, then linearised there once as a whole.
    """
    priors = MovingPriors(rig, slow, delay)
    state, iterations, converged = start, 0, False
    few = blocks[:: -(-len(blocks) // _FEW)]
    if len(few) < len(blocks):
        first = fit_moving(rig, slow, few, start, delay, model)
        state, model, iterations = first.state, first.noise, first.iterations
    for look in range(_LOOKS if rig.axes.all() else _LOOKS_ACROSS):
        fit = estimate_noise(at_state(rig, slow, blocks, state, priors, model))
        model = fit.noise
        solution = _solve(fit, priors)
        iterations += solution.iterations
        r, j = moved_to(fit, state, priors).whitened()
        step = np.linalg.norm(gram_root(j.T @ j, len(j)).T @ (j.T @ r))
        state = solution.state
        fit = moved_to(fit, state, priors)
        settled = _SETTLED * np.sqrt(j.shape[1])
        converged = bool(step < settled)
        if not converged and len(few) < len(blocks):
            converged = _bent(fit, few[:_PROBES], priors) < settled
        if converged or (look > 0 and not solution.converged):
            break
    return replace(fit, iterations=iterations, converged=converged)


def _bent(fit: MovingFit, some: tuple[Block, ...], priors: MovingPriors) -> float:
    """How far the balance at the fit's state is from its linearisation, in standard deviations
    of the whole; looked at on some of its blocks.
    """
    index = [fit.blocks.index(block) for block in some]
    anew = at_state(fit.rig, fit.slow, some, fit.state, priors, fit.noise)
    cut = len(fit.psi) - fit.rests
    square = 0.0
    for k, item in zip(index, anew.designs, strict=True):
        gap = item.design @ anew.psi[:cut] - fit.designs[k].design @ fit.psi[:cut]
        mix, ratio = independent(item)
        bins = bins_of(item, ratio)
        gap = (gap @ mix.T).ravel()
        square += float(np.sum(np.abs(gap) ** 2 * bins.count / fit.noise.variance(bins)))
    return float(np.sqrt(square * len(fit.blocks) / len(some)))
