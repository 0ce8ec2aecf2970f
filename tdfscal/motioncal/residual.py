"""The residual wrench over time: what the balance lacks at every instant of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model import statics
from tdfscal.model.dynamics import Moving
from tdfscal.model.free_forces import least_squares
from tdfscal.model.parameters import State, sensing
from tdfscal.motioncal.blocks import Block
from tdfscal.motioncal.design import inertia_wrench, shifted, static_wrench
from tdfscal.motioncal.streams import Slow
from tdfscal.records import FloatArray, Rig
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


def residual_wrench(
    rig: Rig,
    slow: Slow,
    blocks: tuple[Block, ...],
    before: State,
    after: State,
    moving: Moving,
) -> ResidualWrench:
    """Residual wrench of two states over the blocks, both with the same motion's parameters."""
    times, lengths = [], []
    mean = max(_MEAN, sum(block.seconds for block in blocks) / _MOST)
    for block in blocks:
        both = [_wrench(rig, slow, block, state, moving) for state in (before, after)]
        count = max(1, round(len(both[0]) * slow.step / mean))
        parts = np.array_split(np.arange(len(both[0])), count)
        times += [float(slow.time[block.index][part].mean()) for part in parts]
        means = [[e[part].mean(axis=0).reshape(2, 3) for e in both] for part in parts]
        lengths.append(np.linalg.norm(np.array(means), axis=3))
    length = np.concatenate(lengths)
    return ResidualWrench(np.array(times), length[:, 0], length[:, 1])


def _wrench(rig: Rig, slow: Slow, block: Block, state: State, moving: Moving) -> FloatArray:
    """Return e (N, 6), N and N·m about the barycentre, BCS (theory, section 8).

    Forces that nobody measures are those that leave least of it.
    """
    position = shifted(slow, block.index, moving.delay) - state.datum
    R = rotations(state.hinge, position)
    e = inertia_wrench(position, block.step, state, moving)
    e += static_wrench(state, rig.gravity, R, slow.force[block.index])
    if rig.axes.all():
        return e
    B = statics.wrench(np.einsum("kab,nb->kna", R, state.hinge - state.barycentre))
    cov = np.einsum("knra,knsa->krs", B, B)
    columns = statics.free(B @ sensing(state), rig.axes)
    free, _ = least_squares(cov, columns, e)
    return np.asarray(e + (columns @ free[..., None])[..., 0])
