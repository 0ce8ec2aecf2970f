"""A fit in motion: its parameters, what is stated of them, its rows and their noise.

The rows are Fourier coefficients, white by the spectrum of the residual, which is estimated with
the fit: it takes the place of what is stated at rest, and its own uncertainty is a source.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tdfscal.estimation.fit import Fitted, Priors
from tdfscal.estimation.observability import noise_pull
from tdfscal.frozen import record, replace
from tdfscal.model import dynamics
from tdfscal.model.dynamics import Moving
from tdfscal.model.parameters import State, retract, sensing, with_motions
from tdfscal.model.statics import Balance, balance, features, features_jacobian
from tdfscal.motioncal.blocks import Block, ComplexArray
from tdfscal.motioncal.design import BlockDesign, drifting, instants, rms, unknowns_at_rest
from tdfscal.motioncal.rows import NoiseModel, NormalEquations, Rows
from tdfscal.motioncal.streams import Slow, shifted
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import block_diagonal, covariance_root
from tdfscal.records import BoolArray, FloatArray, Rig, UncertainValue

#: Name in the budget of what only motion has.
SPECTRUM = "noise spectrum"
#: Length over which the positioners' errors change, m: of leads of screws, of joints of guides.
FIELD = 0.015
#: Places of a block at most between which they are compared.
_PLACES = 1000
#: One of so many instants of a block shows how its columns are made of readings.
_EVERY = 20


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


@record(kw_only=True)
class MovingFit(Fitted):
    """An estimate from a motion.

    rests : number of turns at rests, unknowns after the p active parameters. psi : (q + 13 + s +
    rests,), features. slope : (…, p + rests), their slopes by all that is unknown.
    residual (M,), jacobian (M, p + rests) : of the rows at the estimate, not whitened.
    origin : what the features count from.
    shift : whose delay and rate the poses of the designs are shifted by.
    """

    moving = True
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

    @property
    def slow(self) -> Slow:
        """The log's streams."""
        return self.priors.slow

    @property
    def still(self) -> State:
        """The parameters of statics."""
        return self.state.still

    @property
    def stated(self) -> Priors:
        """What is stated of the parameters of statics."""
        return self.priors.still

    @property
    def forces_at_rests(self) -> BoolArray:
        """Which of the unknowns (p + rests,) are of forces at rests, of unit variance before."""
        count, own = unknowns_at_rest(self.rig), np.arange(self.rests)
        return np.concatenate([np.zeros(int(self.active.sum()), dtype=np.bool_), own % count >= 3])

    @property
    def rows(self) -> int:
        """Number of independent values that the rows stand for."""
        return round(float(self.data.bins.count.sum()))

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

    def normal_equations(self) -> NormalEquations:
        """Those of the residual and the Jacobian, for any spectrum of the noise."""
        r, j = self.whitened()
        return NormalEquations(self.data, self.noise, np.concatenate([r[:, None], j], axis=1))

    def all_slopes(self) -> FloatArray:
        """Whitened derivative (M, P + 9) of the rows by all parameters, free or not."""
        return self.whiten(self.data.design @ self.slope_at(self.state))

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Columns (M, …) of the rows, of unit variance by the spectrum."""
        return self.data.weighted(columns, self.noise.variance(self.data.bins))

    def wrenches(self) -> list[ComplexArray]:
        """Residual wrench (F, 6) of every block."""
        return [item.wrench(self.psi) for item in self.designs]

    @cached_property
    def noise_pull(self) -> FloatArray:
        """Expected scores (P + 9,) of all parameters by the noise of the readings alone.

        As of postures, noise of density S_F weighted by S⁻¹ over all frequencies, and instants by
        the taper's weight.
        """
        slope = self.slope_at(self.state)
        each = (pull_of_readings(self, item) for item in self.designs)
        return np.asarray(np.sum([along @ slope[: len(along)] for along in each], axis=0))

    def noise_scale(self, birge: float, dof: int) -> tuple[float, float]:
        """The spectrum is as large as the residuals are, and of very many degrees."""
        return 1.0, np.inf

    def noise_shares(self, posterior: FloatArray) -> dict[str, FloatArray]:
        """Covariance (p, p) by readings, positions, and what the spectrum leaves open."""
        p = int(self.active.sum())
        bins, C = self.data.bins, posterior[:p]
        force = self.noise.parts(bins)[0]
        white = self.jacobian * (np.sqrt(bins.count * force) / self.noise.variance(bins))[:, None]
        half = np.hstack([C @ white.T, C[:, self.forces_at_rests]])
        return {
            "noise": half @ half.T,
            "positioner": of_poses(self, C),
            SPECTRUM: spectrum_share(self, posterior)[:p, :p],
        }

    def faked_information(self) -> FloatArray:
        """Information (3n, 3n) about the rotations that noise in the readings fakes.

        As of postures: reading noise of density S_F turned by [u]×, through B, weighted by S⁻¹.
        """
        M = sensing(self.state.still)
        noise = M @ (self.rig.axes[:, :, None] * np.swapaxes(M, 1, 2))
        felt = [(item.lever, item.reading_gain(self.noise)) for item in self.designs]
        C = np.sum([np.einsum("nrasb,rs->nab", lever, gain) for lever, gain in felt], axis=0)
        return block_diagonal(*so3.information_of_crossing(C, noise))


def spectrum_share(fit: MovingFit, posterior: FloatArray) -> FloatArray:
    """What the spectrum's own uncertainty adds to a covariance (p, p) of all unknowns.

    posterior : that at the estimated spectrum. By the law of total covariance over the spectrum's
    parameters θ, E[C(θ)] + Cov[x̂(θ)], to the second order along the principal axes of their
    covariance.
    """
    equations, added = fit.normal_equations(), np.zeros_like(posterior)
    for step in covariance_root(fit.noise.covariance).T:
        (a, up), (b, down) = (
            equations.solved(fit.noise.log_density + s * step) for s in (1.0, -1.0)
        )
        added += (up @ up.T + down @ down.T) / 2 - posterior + np.outer(a - b, a - b) / 4
    # The second difference may dip below zero by rounding and by curvature: it never helps.
    root = covariance_root(added)
    return np.asarray(root @ root.T)


def of_poses(fit: MovingFit, C: FloatArray) -> FloatArray:
    """Covariance (p, p) of the active parameters by the positioners' errors.

    The weights take these for noise of the time. They are a field of the place, whose turns count
    by the loads of the instant and stand still at rest: σ² Σ h(t)ᵀ h(t′) / (1 + d² / 2ℓ²), with h
    the estimate's answer to a turn at t, d the way between the places at t and t′, and σ² the
    power of the poses' part of the spectrum. The correlation is that of smooth fields of all
    lengths about ℓ (Rasmussen and Williams, Gaussian Processes, 2006, eq. 4.19).
    """
    size = C.shape[1]
    out = np.zeros((size, size))
    for item in fit.designs:
        block, N, frequency = item.block, len(item.turned), item.block.frequency
        gain = item.back_in_time(item.wrench(fit.slope), fit.noise)
        answer = np.swapaxes(item.turned, 1, 2) @ gain
        few = np.linspace(0, N, min(N, _PLACES), endpoint=False).astype(int)
        answer = np.add.reduceat(answer, few, axis=0)
        place = fit.slow.position[block.index][few].reshape(len(few), -1)
        place = (place - place.mean(axis=0)) / np.sqrt(fit.rig.n)
        square = np.sum(place**2, axis=1)
        way = square[:, None] + square - 2 * place @ place.T
        alike = 1 / (1 + way / (2 * FIELD**2))
        power = 2 * float(np.trapezoid(fit.noise.density(frequency)[1], frequency))
        flat = answer.reshape(len(few), -1)
        out += power * answer.reshape(-1, size).T @ (alike @ flat).reshape(-1, size)
    return C @ out @ C.T


def pull_of_readings(fit: MovingFit, item: BlockDesign) -> FloatArray:
    """Score (q,) of the static features that noise of the readings makes, by one block."""
    rig, index = fit.rig, item.block.index
    weight = item.block.taper[0, ::_EVERY] ** 2
    place = shifted(fit.slow, index, fit.shift)[::_EVERY]
    seen = instants(rig, fit.slow, place, slice(index.start, index.stop, _EVERY))
    at = balance(seen, fit.still, fit.origin.centre, rig.gravity)
    at = replace(at, turn_cov=np.zeros_like(at.turn_cov))
    counts = item.reading_gain(fit.noise) * (weight / weight.sum())[:, None, None]
    return noise_pull(at, fit.still, counts)
