"""Rests within a motion: there the positioners' errors stand still and average to nothing.

An error of the servo positions is one of the place, not of the time. While the terminal moves it
is a noise with a spectrum; during a rest it is one unknown constant, and no length of the rest
tells more about it. So every rest has a turn of its registered pose as an unknown of its own,
with the positioners' stated uncertainty as its prior.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.model.statics import Balance
from tdfscal.motioncal.blocks import Block, runs
from tdfscal.motioncal.noise import UNSTATED
from tdfscal.motioncal.streams import Slow
from tdfscal.records import FloatArray, Rig

#: Speed of the NCPs below which the terminal rests, m/s, the time over which it is seen, and the
#: shortest rest, s.
_SLOW, _SEEN, _SHORTEST = 2.0e-4, 0.5, 1.5
#: Way over which the positioners' errors are still those of the place, m.
_LEAD = 0.01
#: Rests at most that have unknowns of their own, the longest first.
MOST = 60


def rests(slow: Slow, blocks: Sequence[Block]) -> tuple[tuple[slice, ...], ...]:
    """Rests of every block, as rows of it, in their order."""
    found = [(k, run) for k, block in enumerate(blocks) for run in _resting(slow, block)]
    longest = sorted(found, key=lambda item: item[1].start - item[1].stop)[:MOST]
    return tuple(
        tuple(sorted((run for b, run in longest if b == k), key=lambda run: run.start))
        for k in range(len(blocks))
    )


def _resting(slow: Slow, block: Block) -> list[slice]:
    place = slow.position[block.index].reshape(len(block), -1)
    lag = max(1, round(_SEEN / slow.step))
    if len(place) <= lag:
        return []
    way = np.abs(place[lag:] - place[:-lag]).max(axis=1)
    still = [slice(run.start, run.stop + lag) for run in runs(way < _SLOW * lag * slow.step)]
    least = max(2, round(_SHORTEST / slow.step))
    return [run for run in still if run.stop - run.start >= least]


def nearness(slow: Slow, block: Block, resting: Sequence[slice]) -> FloatArray:
    """Share (N, R) of the positioners' error at every rest that each instant has in common."""
    place = slow.position[block.index]
    out = np.zeros((len(place), len(resting)))
    for k, run in enumerate(resting):
        way = np.linalg.norm(place - place[run].mean(axis=0), axis=2).max(axis=1)
        near = np.exp(-0.5 * (way / _LEAD) ** 2)
        # A place that is come back to counts as another rest.
        far = np.flatnonzero(way > 3 * _LEAD)
        near[: max(far[far < run.start], default=0)] = 0.0
        near[min(far[far >= run.stop], default=len(near)) :] = 0.0
        out[:, k] = near
    return out


def columns(rig: Rig, at: Balance, near: FloatArray, resting: Sequence[slice]) -> FloatArray:
    """Wrench (N, 6, 3 R) of a unit turn at every rest, in its prior's standard uncertainties.

    at : the balance of the block's instants, with positions of unit covariance.
    """
    std = max(rig.declared.positioner, UNSTATED)
    out = np.zeros((len(near), 6, 3 * len(resting)))
    for k, run in enumerate(resting):
        middle = (run.start + run.stop) // 2
        turn = at.noise_turn @ np.linalg.cholesky(at.turn_cov[middle])
        out[:, :, 3 * k : 3 * k + 3] = std * near[:, k, None, None] * turn
    return out
