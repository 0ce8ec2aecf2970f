"""Trials of a fit in motion, and its evidence.

A trial (JCGM 101) draws all parameters together from their covariance, and takes the estimate to
where the balance, which is bent in rotations, zeros and load, leads it: one step of Gauss and
Newton on the statistic from the linear answer, whose error is of the third order. The evidence is
whether the result holds on stretches held out, and what is left over time.
"""

from __future__ import annotations

import numpy as np

from tdfscal.estimation.judged import HeldOut
from tdfscal.estimation.uncertainty import (
    Estimate,
    simulate_angles,
)
from tdfscal.frozen import record
from tdfscal.model import statics
from tdfscal.model.parameters import State, gravity, retract, sensing
from tdfscal.model.postures import forces
from tdfscal.model.samples_in_motion import rotations
from tdfscal.model.statics import features, features_jacobian
from tdfscal.motioncal.blocks import SHORTEST, Block, blocks
from tdfscal.motioncal.design import inertia_wrench, rms
from tdfscal.motioncal.estimator import at_state, moved_to
from tdfscal.motioncal.fit import MovingFit, MovingState
from tdfscal.motioncal.streams import shifted
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo
from tdfscal.numerics.least_squares import (
    free_values,
    spectrum,
    triangular,
)
from tdfscal.records import BoolArray, FloatArray

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
