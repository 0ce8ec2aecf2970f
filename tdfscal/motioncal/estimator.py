"""Maximum likelihood in motion: features → Fourier coefficients → spectrum ↔ fit → a new look.

The balance stays linear in the features of the model after tapering, Fourier transform and
weighting, so that the statistic of self-calibration, one triangular factor, holds for a moving
log too; what differs is the weight, which is estimated with the fit.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tdfscal.estimation.fit import Priors, solve
from tdfscal.frozen import record, replace
from tdfscal.model import dynamics
from tdfscal.model.dynamics import Moving
from tdfscal.model.parameters import State, retract, with_motions
from tdfscal.model.statics import Balance, features, features_jacobian
from tdfscal.motioncal.blocks import Block, ComplexArray, rests_of
from tdfscal.motioncal.design import BlockDesign, block_design, drifting, rms
from tdfscal.motioncal.rows import (
    NOTHING,
    NoiseModel,
    NormalEquations,
    Rows,
    gather,
    improve,
    initial,
)
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.least_squares import (
    Solution,
    block_diagonal,
    gram_root,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray, Rig, UncertainValue

#: Blocks that a long log is first fitted on.
_FEW = 2
#: Looks from a new linearisation at most, and the change, in standard deviations, that ends them.
_LOOKS, _SETTLED = 12, 0.01
#: That change for a long log, which starts from some of its blocks: what a step of 9 σ bends the
#: balance by is 0.01 to 0.02 σ (1,200 s at 40 to 1,000 Hz).
_NEAR = 2.0
#: Looks at most where forces that nobody measures have to be found along with the angles.
_LOOKS_ACROSS = 60
#: Steps of the spectrum per look, and the change of a logarithm that ends them.
_SCORES, _SCORED = 20, 0.02


@record
class MovingState:
    """All parameters: those of statics and those of the motion."""

    still: State
    moving: Moving

    def moved(self, step: FloatArray) -> MovingState:
        """Retract by a step (P + 9,)."""
        cut = len(step) - dynamics.PARAMETERS
        return MovingState(
            retract(self.still, step[:cut]), Moving.of(self.moving.vector + step[cut:])
        )


class MovingPriors:
    """What is stated of a log in motion, as whitened prior rows by the active parameters.

    rig, slow : the rig file and the log's streams. motions : G, of the zeros. delay : stated in
    the rig file, s, (); or with the rate of clocks that are apart, (2,).
    active : (P + 9,), statics first.
    """

    def __init__(self, rig: Rig, slow: Slow, delay: UncertainValue) -> None:
        motion = drifting(rig, slow)
        self.rig, self.slow = rig, slow
        self.motions = 0 if motion is None else len(motion.std)
        self.still = Priors(rig, motion)
        value, std = np.atleast_1d(delay.value), np.atleast_1d(delay.std)
        self.mean, self.std = dynamics.prior(rig, float(value[0]), *map(float, std))
        self.free = self.std > 0
        self.active = np.concatenate([self.still.active, self.free])

    def start(self, still: State) -> MovingState:
        """All parameters, those of the motion as stated."""
        return MovingState(with_motions(still, self.motions), self.mean)

    def __call__(self, state: MovingState) -> tuple[FloatArray, FloatArray]:
        """Residual (m,) and Jacobian (m, p)."""
        r, j = self.still(state.still)
        more = (state.moving.vector - self.mean.vector)[self.free] / self.std[self.free]
        own = np.diag(1 / self.std[self.free])
        return np.concatenate([r, more]), block_diagonal(j, own)


@record
class MovingFit:
    """An estimate with all that its uncertainty needs.

    rests : number of turns at rests, unknowns after the p active parameters. psi : (q + 13 + s +
    rests,), features. slope : (…, p + rests), their slopes by all that is unknown.
    residual (M,), jacobian (M, p + rests) : of the rows at the estimate, not whitened.
    prior_residual (m,), prior_jacobian (m, p + rests) : whitened. origin : what the features
    count from.
    shift : whose delay and rate the poses of the designs are shifted by.
    """

    priors: MovingPriors
    designs: tuple[BlockDesign, ...]
    data: Rows
    origin: Balance
    shift: Moving
    rests: int
    state: MovingState
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
    def rig(self) -> Rig:
        """The rig."""
        return self.priors.rig

    @property
    def slow(self) -> Slow:
        """The log's streams."""
        return self.priors.slow

    @property
    def active(self) -> BoolArray:
        """Which parameters (P + 9,) are free."""
        return self.priors.active

    @property
    def still(self) -> State:
        """The parameters of statics."""
        return self.state.still

    @property
    def rows(self) -> int:
        """Number of independent values that the rows stand for."""
        return round(float(self.data.bins.count.sum()))

    @property
    def still_priors(self) -> int:
        """How many of the prior rows are those of statics."""
        return len(self.prior_residual) - int(self.priors.free.sum()) - self.rests

    @property
    def rms(self) -> tuple[float, float]:
        """Quadratic mean over time of the residual force's length, and the moment's."""
        force, moment = rms(self.designs, self.psi)
        return float(force), float(moment)

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The stretches that were used."""
        return tuple(design.block for design in self.designs)

    def features_at(self, state: MovingState) -> FloatArray:
        """Features (q + 13 + s + rests,) of a state, without turns at rests."""
        still = features(state.still, self.origin, self.rig.gravity)
        more = dynamics.features(state.still, state.moving, self.origin.centre, self.shift)
        out = np.zeros(self.data.design.shape[1])
        out[: len(still) + len(more)] = np.concatenate([still, more])
        return out

    def slope_at(self, state: MovingState) -> FloatArray:
        """∂ features / ∂ all parameters, (…, P + 9); suspects have none."""
        still = features_jacobian(state.still, self.origin, self.rig.gravity)
        more = dynamics.features_jacobian(state.still, self.origin.centre)
        out = np.zeros((self.data.design.shape[1], more.shape[1]))
        out[: len(still), : still.shape[1]] = still
        out[len(still) : len(still) + len(more)] = more
        return out

    def whitened(self) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian as rows of unit variance, priors last."""
        return (
            self.white,
            np.concatenate([self.whiten(self.jacobian), self.prior_jacobian]),
        )

    def normal_equations(self, more: FloatArray | None = None) -> NormalEquations:
        """Those of the residual, the Jacobian and more columns (M + m, c), white as they are.

        They hold for any spectrum of the noise.
        """
        r, j = self.whitened()
        columns = [r[:, None], j] if more is None else [r[:, None], j, more]
        return NormalEquations(self.data, self.noise, np.concatenate(columns, axis=1))

    def all_slopes(self) -> FloatArray:
        """Whitened derivative (M, P + 9) of the rows by all parameters, free or not."""
        return self.whiten(self.data.design @ self.slope_at(self.state))

    @property
    def white(self) -> FloatArray:
        """Whitened residual of rows and priors."""
        return np.concatenate([self.whiten(self.residual), self.prior_residual])

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Columns (M, …) of the rows, of unit variance by the spectrum."""
        return self.data.weighted(columns, self.noise.variance(self.data.bins))

    def wrenches(self) -> list[ComplexArray]:
        """Residual wrench (F, 6) of every block."""
        return [item.wrench(self.psi) for item in self.designs]

    @property
    def cost(self) -> float:
        """χ² of rows and priors."""
        return float(self.white @ self.white)


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
    none = (np.empty(0),) * 6
    origin, shift, before = pairs[0][1], state.moving, model or NOTHING
    fit = MovingFit(priors, designs, rows, origin, shift, rests, state, before, *none, 0, False)
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
) -> MovingFit:
    """Maximum-likelihood estimate of state and spectrum from one start.

    A long log is first fitted on a few of its blocks, then linearised there once as a whole.
    """
    state, iterations, converged = start, 0, False
    few = blocks[:: -(-len(blocks) // _FEW)]
    if len(few) < len(blocks):
        first = fit_moving(priors, few, start, model)
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
        settled = _NEAR if len(few) < len(blocks) else _SETTLED
        converged = bool(step < settled * np.sqrt(j.shape[1]))
        if converged or (look > 0 and not solution.converged):
            break
    return replace(fit, iterations=iterations, converged=converged)
