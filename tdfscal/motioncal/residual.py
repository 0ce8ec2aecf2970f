"""The residual wrench over time: what the balance lacks at every instant of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model import statics
from tdfscal.model.parameters import State, sensing
from tdfscal.motioncal.blocks import Block
from tdfscal.motioncal.design import inertia_wrench, shifted, static_wrench
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.numerics.least_squares import free_values
from tdfscal.records import FloatArray
from tdfscal.wrench.kinematics import rotations

#: Length of the means that are kept, s, and how many of them at most in a long log.
_MEAN, _MOST = 1.0, 600


@dataclass(frozen=True, slots=True)
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
    mean = max(_MEAN, sum(block.seconds for block in fit.blocks) / _MOST)
    for block in fit.blocks:
        both = [_wrench(fit, block, state) for state in (before, after)]
        count = max(1, round(block.seconds / mean))
        parts = np.array_split(np.arange(len(both[0])), count)
        times += [float(fit.slow.time[block.index][part].mean()) for part in parts]
        means = [[e[part].mean(axis=0).reshape(2, 3) for e in both] for part in parts]
        lengths.append(np.linalg.norm(np.array(means), axis=3))
    length = np.concatenate(lengths)
    return ResidualWrench(np.array(times), length[:, 0], length[:, 1])


def _wrench(fit: MovingFit, block: Block, state: State) -> FloatArray:
    """Return e (N, 6), N and N·m about the barycentre, BCS (theory, section 8).

    Forces that nobody measures are those that leave least of it.
    """
    rig, slow, moving = fit.rig, fit.slow, fit.state.moving
    position = shifted(slow, block.index, moving) - state.datum
    R = rotations(state.hinge, position)
    e = inertia_wrench(position, block.step, state, moving)
    e += static_wrench(state, rig.gravity, R, slow.force[block.index])
    if rig.axes.all():
        return e
    B = statics.wrench(np.einsum("kab,nb->kna", R, state.hinge - state.barycentre))
    cov = np.einsum("knra,knsa->krs", B, B)
    columns = statics.free(B @ sensing(state), rig.axes)
    free, _ = free_values(cov, columns, e)
    return np.asarray(e + (columns @ free[..., None])[..., 0])
