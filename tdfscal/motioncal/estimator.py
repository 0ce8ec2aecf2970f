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
from tdfscal.motioncal.noise import Bins, NoiseModel
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.least_squares import Solution, gauss_newton, spectrum
from tdfscal.records import BoolArray, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import Priors

#: Looks from a new linearisation at most, and the change, in standard deviations, that ends them.
_LOOKS, _SETTLED = 12, 0.01
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
class Rows:
    """All blocks' Fourier coefficients in their independent components, M rows.

    design : (M, q + 12), complex. bins : their frequencies and weights. mixing : per block, the
    (6, 6) matrix that brings e to the independent components. place : per block, its rows.
    """

    design: ComplexArray
    bins: Bins
    mixing: tuple[FloatArray, ...]
    place: tuple[slice, ...]


@dataclass(frozen=True, slots=True)
class MovingFit:
    """An estimate with all that its uncertainty needs.

    residual : (M,), jacobian : (M, p), complex, of the rows at the estimate, not whitened.
    prior_residual (m,), prior_jacobian (m, p) : whitened. origin : what the features count from.
    """

    rig: Rig
    slow: Slow
    designs: tuple[BlockDesign, ...]
    rows: Rows
    origin: Balance
    state: MovingState
    active: BoolArray
    noise: NoiseModel
    residual: ComplexArray
    jacobian: ComplexArray
    prior_residual: FloatArray
    prior_jacobian: FloatArray
    iterations: int
    converged: bool

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The stretches that were used."""
        return tuple(design.block for design in self.designs)

    def whitened(self, log_density: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian as real rows of unit variance, priors last."""
        r, j = stacked(
            np.concatenate([self.residual[:, None], self.jacobian], axis=1),
            weights(self.rows.bins, self.noise.variance(self.rows.bins, log_density)),
        )
        return (
            np.concatenate([r, self.prior_residual]),
            np.concatenate([j, self.prior_jacobian]),
        )

    @property
    def cost(self) -> float:
        """χ² of rows and priors."""
        r, _ = self.whitened()
        return float(r @ r)


def force_power(fit: MovingFit) -> FloatArray:
    """Density (M / 6,) of the residual force, N²/Hz, of every coefficient of every block."""
    parts = []
    for mixing, place in zip(fit.rows.mixing, fit.rows.place, strict=True):
        e = np.linalg.solve(mixing, fit.residual[place].reshape(-1, 6).T)
        parts.append(np.sum(np.abs(e[:3]) ** 2, axis=0))
    return np.concatenate(parts)


def weights(bins: Bins, variance: FloatArray) -> FloatArray:
    """Factor (M,) that whitens each row's real and imaginary part."""
    return np.sqrt(bins.count / variance)


def stacked(rows: ComplexArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First column, and the others, of complex rows (M, c) as real ones (2M, c), weighted."""
    both = rows * weight[:, None]
    real = np.concatenate([both.real, both.imag])
    return real[:, 0], real[:, 1:]


def gather(designs: tuple[BlockDesign, ...]) -> Rows:
    """Diagonalise the two parts of each block's noise and stack the blocks."""
    rows, frequency, ratio, count, mixing, place = [], [], [], [], [], []
    start = 0
    for item in designs:
        block = item.block
        inverse = np.linalg.inv(np.linalg.cholesky(item.unit_force))
        ratios, axes = np.linalg.eigh(inverse @ item.unit_turn @ inverse.T)
        mix = axes.T @ inverse
        f = block.frequency.copy()
        f[0] = 0.5 * f[1]  # what the mean sees
        rows.append((mix @ item.design).reshape(-1, item.design.shape[2]))
        frequency.append(np.repeat(f, 6))
        ratio.append(np.tile(np.maximum(ratios, 0.0), len(f)))
        # A complex coefficient holds two values; the mean, which is real, one.
        both = np.where(np.arange(len(f)) > 0, 2.0, 1.0) * block.share
        count.append(np.repeat(both, 6))
        mixing.append(mix)
        place.append(slice(start, start + 6 * len(f)))
        start += 6 * len(f)
    bins = Bins(np.concatenate(frequency), np.concatenate(ratio), np.concatenate(count))
    return Rows(np.concatenate(rows), bins, tuple(mixing), tuple(place))


def _features(rig: Rig, state: MovingState, origin: Balance, delay: float) -> FloatArray:
    still = features(state.still, origin, rig.gravity)
    more = dynamics.features(state.still, state.moving, origin.centre, delay)
    return np.concatenate([still, more])


def slope_of(rig: Rig, state: MovingState, origin: Balance) -> FloatArray:
    """∂ features / ∂ all parameters, (q + 12, P + 8)."""
    still = features_jacobian(state.still, origin, rig.gravity)
    more = dynamics.features_jacobian(state.still, origin.centre)
    out = np.zeros((len(still) + len(more), more.shape[1]))
    out[: len(still), : still.shape[1]] = still
    out[len(still) :] = more
    return out


def _solve(
    rig: Rig,
    rows: Rows,
    variance: FloatArray,
    origin: Balance,
    delay: float,
    start: MovingState,
    priors: MovingPriors,
) -> Solution[MovingState]:
    """Gauss–Newton on the statistic of all rows, and the priors."""
    _, real = stacked(
        np.concatenate([rows.design[:, :1], rows.design], axis=1), weights(rows.bins, variance)
    )
    compressed = np.linalg.qr(real, mode="r")
    active = priors.active

    def model(state: MovingState) -> tuple[FloatArray, FloatArray]:
        prior_r, prior_j = priors(state)
        r = compressed @ _features(rig, state, origin, delay)
        j = compressed @ slope_of(rig, state, origin)[:, active]
        return np.concatenate([r, prior_r]), np.concatenate([j, prior_j])

    def move(state: MovingState, step: FloatArray) -> MovingState:
        full = np.zeros(len(active))
        full[active] = step
        return state.moved(full)

    return gauss_newton(model, move, start)


def at_state(
    rig: Rig,
    slow: Slow,
    blocks: tuple[Block, ...],
    state: MovingState,
    priors: MovingPriors,
    model: NoiseModel | None,
) -> MovingFit:
    """Linearise at a state; without a noise model, with one that is flat."""
    pairs = [block_design(rig, slow, b, state.still, state.moving) for b in blocks]
    designs = tuple(design for design, _ in pairs)
    origin, rows = pairs[0][1], gather(designs)
    psi = _features(rig, state, origin, state.moving.delay)
    slope = slope_of(rig, state, origin)[:, priors.active]
    residual, jacobian = rows.design @ psi, rows.design @ slope
    if model is None:
        longest = max(b.step * b.taper.shape[1] for b in blocks)
        power = np.abs(residual) ** 2
        model = noise.initial(rows.bins, power, rig.declared.positioner, longest)
    prior_r, prior_j = priors(state)
    return MovingFit(
        rig=rig,
        slow=slow,
        designs=designs,
        rows=rows,
        origin=origin,
        state=state,
        active=priors.active,
        noise=model,
        residual=residual,
        jacobian=jacobian,
        prior_residual=prior_r,
        prior_jacobian=prior_j,
        iterations=0,
        converged=False,
    )


def estimate_noise(fit: MovingFit) -> MovingFit:
    """Bring spectrum and linearised fit into agreement; the state stays."""
    model = fit.noise
    for _ in range(_SCORES):
        r, j = fit.whitened(model.log_density)
        parts = spectrum(j)
        step = parts.solve(r)
        variance = model.variance(fit.rows.bins)
        left = fit.residual + fit.jacobian @ step
        fitted = np.sum(np.abs(fit.jacobian @ parts.root) ** 2, axis=1)
        power = np.abs(left) ** 2 + fitted
        # A row stands for `count` values and is fitted as one: its share of them is used up.
        model, change = noise.improve(model, fit.rows.bins, power, fitted / variance)
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
    """Maximum-likelihood estimate of state and spectrum from one start."""
    priors = MovingPriors(rig, slow, delay)
    state, iterations, converged = start, 0, False
    for look in range(_LOOKS):
        fit = at_state(rig, slow, blocks, state, priors, model)
        fit = estimate_noise(fit)
        model = fit.noise
        solution = _solve(
            rig,
            fit.rows,
            model.variance(fit.rows.bins),
            fit.origin,
            state.moving.delay,
            state,
            priors,
        )
        iterations += solution.iterations
        _, j = fit.whitened()
        step = spectrum(j).solve(fit.whitened()[0])
        state = solution.state
        converged = bool(np.linalg.norm(j @ step) < _SETTLED * np.sqrt(j.shape[1]))
        if look > 0 and (converged or not solution.converged):
            break
    fit = estimate_noise(at_state(rig, slow, blocks, state, priors, model))
    return replace(fit, iterations=iterations, converged=converged)
