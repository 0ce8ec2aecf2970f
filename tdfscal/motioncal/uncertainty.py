"""From a fit in motion to the covariance of its rotations, by source and trials, and its evidence.

A trial (JCGM 101) draws all parameters together from their covariance, and takes the estimate to
where the balance, which is bent in rotations, zeros and load, leads it: one step of Gauss and
Newton on the statistic from the linear answer, whose error is of the third order. The evidence is
whether the result holds on stretches held out, and what is left over time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.estimation.fit import information
from tdfscal.estimation.uncertainty import (
    UNDECLARED,
    Estimate,
    Prospect,
    Quality,
    calibrated,
    linear_rpy_std,
    of_shares,
    parameter_std,
    prior_shares,
    quality,
    simulate_angles,
)
from tdfscal.frozen import record
from tdfscal.model import dynamics, statics
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import State, gravity, retract, sensing
from tdfscal.model.postures import forces
from tdfscal.model.statics import features, features_jacobian
from tdfscal.motioncal.blocks import SHORTEST, Block, blocks
from tdfscal.motioncal.design import inertia_wrench, rms
from tdfscal.motioncal.estimator import MovingFit, MovingState, at_state, moved_to
from tdfscal.motioncal.streams import shifted
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo
from tdfscal.numerics.least_squares import (
    Spectrum,
    block_diagonal,
    free_values,
    spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray
from tdfscal.wrench.samples_in_motion import rotations

#: Names in the budget of what only motion has.
SPECTRUM = "noise spectrum"
#: Length over which the positioners' errors change, m: of leads of screws, of joints of guides.
FIELD = 0.015
#: Places of a block at most between which they are compared.
_PLACES = 1000
#: Trials at most unless asked otherwise.
MOST_TRIALS = 30_000
#: Trials worked on together.
_CHUNK = 2_000
#: How many times as long a motion is easily made.
_LONGER = 2.0


@record
class MovingEstimate(Estimate[MovingFit]):
    """A fit in motion and what is known of it.

    posterior : (p, p), covariance of all free parameters; drawn : what it has where the spectrum
    is certain.
    """

    posterior: FloatArray
    drawn: FloatArray

    @property
    def moving_std(self) -> FloatArray:
        """Standard uncertainty (9,) of I_O, τ, d, ρ."""
        return parameter_std(self.fit.active, self.posterior, self.parts)[-dynamics.PARAMETERS :]

    @property
    def calibrated(self) -> Calibrated:
        """All parameters of the rig with their joint covariance, for those who use them."""
        return calibrated(self.fit, self.posterior, self.uncertainty.covariance)

    def prospects(self, seconds: float) -> tuple[Prospect, ...]:
        """What a longer motion would bring; seconds : of what there is.

        What is published changes as the linear covariance at the spectrum does.
        """
        fit, data = self.fit, triangular(self.fit.whiten(self.fit.jacobian))
        now, then = (
            linear_rpy_std(fit.still.rotation, data, fit.prior_jacobian, count)
            for count in (1.0, _LONGER)
        )
        longer = self.uncertainty.rpy_std * then / now
        return (Prospect("seconds", _LONGER * seconds, longer),)


def posterior(fit: MovingFit, parts: Spectrum) -> tuple[FloatArray, FloatArray]:
    """Covariance (p, p) of the active parameters at the spectrum, and what its error adds."""
    C, equations = parts.root @ parts.root.T, fit.normal_equations()

    def at(log_density: FloatArray) -> tuple[FloatArray, FloatArray]:
        step, root = equations.solved(log_density)
        return step, root @ root.T

    added = by_spectrum(fit, C, at)
    # The second difference may dip below zero by rounding and by curvature: it never helps.
    values, axes = np.linalg.eigh(added)
    return C, (axes * np.maximum(values, 0.0)) @ axes.T


def by_spectrum(
    fit: MovingFit,
    here: FloatArray,
    at: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """What the spectrum's own uncertainty adds to a covariance (g, g).

    here : that at the estimated spectrum. at : estimate (g,) and covariance at another one.

    By the law of total covariance over the spectrum's parameters θ, E[C(θ)] + Cov[x̂(θ)], to the
    second order along the principal axes of their covariance.
    """
    added = np.zeros_like(here)
    values, axes = np.linalg.eigh(fit.noise.covariance)
    for value, axis in zip(values, axes.T, strict=True):
        step = np.sqrt(value) * axis
        (a, up), (b, down) = (at(fit.noise.log_density + s * step) for s in (1.0, -1.0))
        added += (up + down) / 2 - here + np.outer(a - b, a - b) / 4
    return added


def estimate(fit: MovingFit) -> MovingEstimate:
    """Posterior covariance, budget and coverage factors of a fit."""
    parts = information(fit)
    C, added = posterior(fit, parts)
    p = int(fit.active.sum())
    return _summed(fit, parts, quality(fit, parts), _shares(fit, C[:p]), added[:p, :p])


def beside(of: MovingEstimate, undeclared: FloatArray) -> MovingEstimate:
    """The same with a covariance (p, p) of the free parameters by what the rig file may lack."""
    C = of.parts.root @ of.parts.root.T
    shares = _shares(of.fit, C[: len(of.drawn)]) | {UNDECLARED: undeclared}
    return _summed(of.fit, of.parts, of.quality, shares, of.posterior - of.drawn)


def _summed(
    fit: MovingFit,
    parts: Spectrum,
    stats: Quality,
    shares: dict[str, FloatArray],
    by_spectrum: FloatArray,
) -> MovingEstimate:
    """All shares together, and what the spectrum's own uncertainty adds."""
    drawn = np.sum(list(shares.values()), axis=0)
    total = drawn + by_spectrum
    std = parameter_std(fit.active, total, parts)[: -dynamics.PARAMETERS]
    R = fit.still.rotation
    known = of_shares(R, shares | {SPECTRUM: by_spectrum}, faked_information(fit), parts, std)
    return MovingEstimate(fit, parts, stats, known, total, drawn)


def _shares(fit: MovingFit, C: FloatArray) -> dict[str, FloatArray]:
    """Covariance (p, p) of the active parameters by source; C (p, p + rests) : at the spectrum."""
    bins = fit.data.bins
    force = fit.noise.parts(bins)[0]
    white = fit.jacobian * (np.sqrt(bins.count * force) / fit.noise.variance(bins))[:, None]
    half = C @ white.T
    return {"noise": half @ half.T, "positioner": of_poses(fit, C), **prior_shares(fit, C)}


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
        turned = np.swapaxes(item.turned, 1, 2) * block.taper[0][:, None, None]
        # Score by a unit wrench at every instant, Re Σ_f gain e^{iωt}: of a real transform all
        # coefficients but the mean count twice.
        gain = (item.mix.T * item.weight(fit.noise)[:, None]) @ item.mix @ item.wrench(fit.slope)
        gain[1:] /= 2
        answer = turned @ (block.scale * N * np.fft.irfft(gain, N, axis=0))
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


def faked_information(fit: MovingFit) -> FloatArray:
    """Information (3n, 3n) about the rotations that noise in the readings fakes.

    As of postures: reading noise of density S_F turned by [u]×, through B, weighted by S⁻¹.
    """
    M = sensing(fit.state.still)
    noise = M @ (fit.rig.axes[:, :, None] * np.swapaxes(M, 1, 2))
    felt = [(item.lever, item.reading_gain(fit.noise)) for item in fit.designs]
    C = np.sum([np.einsum("nrasb,rs->nab", lever, gain) for lever, gain in felt], axis=0)
    return block_diagonal(*so3.information_of_crossing(C, noise))


def simulate(
    of: MovingEstimate, rng: np.random.Generator, max_trials: int, known: BoolArray
) -> MonteCarlo:
    """Draw until the averages are stable or the trials run out.

    known : (n,), sensors whose angles the data determine; those of the others are not followed.
    """
    fit, still, g = of.fit, of.fit.still, of.fit.rig.gravity
    start, slope = features(still, fit.origin, g), features_jacobian(still, fit.origin, g)
    values, axes = np.linalg.eigh(of.calibrated.covariance)
    root = axes * np.sqrt(np.maximum(values, 0.0))
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

    return simulate_angles(draw, still.rotation, of.uncertainty, known, max_trials, chunk=_CHUNK)


#: Length of the stretches that are held out in turn, s, and how many at most.
_FOLD, _MOST = 15.0, 8
#: Blocks from which a log's own are held out.
_MANY = 4
#: Length of the means that are kept, s, and how many of them at most in a long log.
_MEAN, _MEANS = 1.0, 600


@record
class HeldOut:
    """Residual wrench in the band of K stretches held out in turn, quadratic means over time.

    before, after : (K, 2), N and N·m, with the nominal mounting and stated values, and with the
    calibration from the other stretches.
    """

    before: FloatArray
    after: FloatArray


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
    """Residual wrench of two states over a fit's blocks, both with its motion's parameters."""
    times, lengths = [], []
    mean = max(_MEAN, sum(block.seconds for block in fit.blocks) / _MEANS)
    for block in fit.blocks:
        position = shifted(fit.slow, block.index, fit.state.moving)
        both = [_wrench(fit, block, position, state) for state in (before, after)]
        count = max(1, round(block.seconds / mean))
        first = np.linspace(0, len(position), count, endpoint=False).astype(int)
        size = np.diff(first, append=len(position))
        times.append(np.add.reduceat(fit.slow.time[block.index], first) / size)
        means = np.add.reduceat(np.stack(both, axis=1), first, axis=0) / size[:, None, None]
        lengths.append(np.linalg.norm(means.reshape(count, 2, 2, 3), axis=3))
    length = np.concatenate(lengths)
    return ResidualWrench(np.concatenate(times), length[:, 0], length[:, 1])


def _wrench(fit: MovingFit, block: Block, position: FloatArray, state: State) -> FloatArray:
    """Return e (N, 6), N and N·m about the barycentre, BCS (theory, section 8).

    position : (N, n, 3), m, of the servos where the forces were felt.
    Forces that nobody measures are those that leave least of it.
    """
    rig, position = fit.rig, position - state.datum
    R = rotations(state.hinge, position)
    arm = np.einsum("kab,nb->kna", R, state.hinge - state.barycentre)
    F = forces(state, fit.slow.force[block.index])
    e = inertia_wrench(R, position, block.step, state, fit.state.moving)
    e[:, :3] += F.sum(axis=1) + state.mass * gravity(state, rig.gravity)
    e[:, 3:] += np.cross(arm, F).sum(axis=1)
    if rig.axes.all():
        return e
    B = statics.wrench(arm)
    cov = np.einsum("knra,knsa->krs", B, B)
    columns = statics.free(B @ sensing(state), rig.axes)
    free, _ = free_values(cov, columns, e)
    return np.asarray(e + (columns @ free[..., None])[..., 0])
