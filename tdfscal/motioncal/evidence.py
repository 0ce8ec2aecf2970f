"""What speaks for a result: does it hold on stretches held out, and what is left over time."""

from __future__ import annotations

import numpy as np

from tdfscal.frozen import record
from tdfscal.model import statics
from tdfscal.model.parameters import State, gravity, sensing
from tdfscal.model.postures import forces
from tdfscal.motioncal.blocks import SHORTEST, Block, blocks
from tdfscal.motioncal.design import inertia_wrench, rms
from tdfscal.motioncal.estimator import MovingFit, MovingState, at_state, moved_to
from tdfscal.motioncal.streams import shifted
from tdfscal.numerics.least_squares import free_values, spectrum, triangular
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.wrench.samples_in_motion import rotations

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
    factors = [_factor(at, fold) for fold in folds]
    before, after = [], []
    for k, fold in enumerate(folds):
        others = [(at.prior_residual, at.prior_jacobian), *factors[:k], *factors[k + 1 :]]
        r, j = (np.concatenate(part) for part in zip(*others, strict=True))
        after.append(rms([at.designs[i] for i in fold], at.psi + at.slope @ spectrum(j).solve(r)))
        before.append(rms([at.designs[i] for i in fold], nominal))
    return HeldOut(np.array(before), np.array(after))


def _factor(fit: MovingFit, which: IntArray) -> tuple[FloatArray, FloatArray]:
    """Residual and Jacobian of some blocks, white, as one triangular factor."""
    both = np.concatenate([fit.psi[:, None], fit.slope], axis=1)
    items = [fit.designs[k] for k in which]
    rows = [item.white(item.wrench(both), fit.noise) for item in items]
    factor = triangular(np.concatenate(rows))
    return factor[:, 0], factor[:, 1:]


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
