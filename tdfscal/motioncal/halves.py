"""Checks on data apart: do the halves of a log agree, and does it hold on stretches held out?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model import dynamics
from tdfscal.motioncal.blocks import SHORTEST, Block, ComplexArray, blocks
from tdfscal.motioncal.estimator import (
    MovingFit,
    MovingPriors,
    MovingState,
    at_state,
    stacked,
    weights,
)
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import BoolArray, FloatArray, UncertainValue

#: Length of the stretches that are held out in turn, s, and how many at least and at most.
_FOLD, _FEWEST, _MOST = 15.0, 2, 8


@dataclass(frozen=True, slots=True)
class Halves:
    """Do the two halves of a log give the same rotations?

    turn, std : (n, 3), rad, from the first half to the second, BCS. p_value : that chance alone
    gives more; 1 where a half is too short to tell. delay, delay_std : s, change of the delay
    between forces and positions.
    """

    turn: FloatArray
    std: FloatArray
    p_value: float
    delay: float = 0.0
    delay_std: float = np.inf


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Residual wrench in the band of stretches held out in turn, quadratic means over time.

    stretches : how many. before, after : (2,), N and N·m, with the nominal mounting and stated
    values, and with the calibration from the other stretches. before_max, after_max : (2,), of
    the worst stretch.
    """

    stretches: int
    before: FloatArray
    after: FloatArray
    before_max: FloatArray
    after_max: FloatArray


def _cut(fit: MovingFit, keep: BoolArray, parts: int) -> list[tuple[Block, ...]]:
    """Blocks of `parts` equal spans of time."""
    time = fit.slow.time
    edges = np.linspace(time[0], time[-1] + fit.slow.step, parts + 1)
    return [
        blocks(fit.slow, keep & (time >= edges[k]) & (time < edges[k + 1])) for k in range(parts)
    ]


def compare_halves(fit: MovingFit, keep: BoolArray, delay: UncertainValue) -> Halves:
    """Estimate the turn of every sensor between the halves, all else common to both."""
    n = fit.rig.n
    none = Halves(np.zeros((n, 3)), np.full((n, 3), np.inf), 1.0)
    first, second = _cut(fit, keep, 2)
    if not first or not second:
        return none
    priors = MovingPriors(fit.rig, fit.slow, delay)
    both = at_state(fit.rig, fit.slow, first + second, fit.state, priors, fit.noise)
    later = np.zeros((len(both.residual), 1))
    later[both.rows.place[len(first)].start :] = 1.0
    timed = both.jacobian[:, -1:] if priors.free[dynamics.DELAY] else later[:, :0]
    turned = np.concatenate([timed, both.jacobian[:, : 3 * n]], axis=1) * later
    weight = weights(both.rows.bins, both.noise.variance(both.rows.bins))
    _, extra = stacked(np.concatenate([both.residual[:, None], turned], axis=1), weight)
    r, j = both.whitened()
    j = np.concatenate([j, np.pad(extra, ((0, len(j) - len(extra)), (0, 0)))], axis=1)
    parts = spectrum(j)
    change = parts.solve(r)[-3 * n :]
    cov = (parts.root @ parts.root.T)[-3 * n :, -3 * n :]
    if np.abs(parts.null[:, -3 * n :]).max(initial=0.0) > 1e-6:
        return none
    column = -3 * n - 1
    p = float(chi2_sf(change @ np.linalg.solve(cov, change), 3 * n))
    turns = Halves(change.reshape(n, 3), np.sqrt(np.diag(cov)).reshape(n, 3), p)
    if not timed.shape[1] or np.abs(parts.null[:, column]).max(initial=0.0) > 1e-6:
        return turns
    spread = float(np.sqrt(parts.root[column] @ parts.root[column]))
    return replace(turns, delay=float(parts.solve(r)[column]), delay_std=spread)


def hold_out(
    fit: MovingFit, keep: BoolArray, delay: UncertainValue, start: MovingState
) -> HeldOut | None:
    """Predict stretches of the log from all the others; start : the nominal state."""
    seconds = float(keep.sum()) * fit.slow.step
    count = int(np.clip(seconds / max(_FOLD, 2 * SHORTEST), _FEWEST, _MOST))
    folds = [cut for cut in _cut(fit, keep, count) if cut]
    if len(folds) < _FEWEST:
        return None
    priors = MovingPriors(fit.rig, fit.slow, delay)
    cut = tuple(block for fold in folds for block in fold)
    at = at_state(fit.rig, fit.slow, cut, fit.state, priors, fit.noise)
    nominal = at_state(fit.rig, fit.slow, cut, start, priors, fit.noise)
    r, j = at.whitened()
    rows = len(at.residual)
    before, after = [], []
    index = 0
    for fold in folds:
        mine = range(index, index + len(fold))
        index += len(fold)
        span = slice(at.rows.place[mine[0]].start, at.rows.place[mine[-1]].stop)
        others = np.ones(len(r), dtype=np.bool_)
        others[span] = others[span.start + rows : span.stop + rows] = False
        step = spectrum(j[others]).solve(r[others])
        predicted = at.residual + at.jacobian @ step
        after.append(_rms(at, predicted, mine))
        before.append(_rms(nominal, nominal.residual, mine))
    b, a = np.array(before), np.array(after)
    return HeldOut(
        len(folds),
        np.sqrt(np.mean(b**2, axis=0)),
        np.sqrt(np.mean(a**2, axis=0)),
        b.max(axis=0),
        a.max(axis=0),
    )


def _rms(fit: MovingFit, residual: ComplexArray, which: range) -> FloatArray:
    """Quadratic means (2,) over time, N and N·m about the barycentre, of some blocks."""
    power, total = np.zeros(2), 0.0
    for k in which:
        block = fit.designs[k].block
        e = np.linalg.solve(fit.rows.mixing[k], residual[fit.rows.place[k]].reshape(-1, 6).T).T
        both = np.where(np.arange(len(e)) > 0, 2.0, 1.0)[:, None]
        sums = np.sum(both * np.abs(e) ** 2, axis=0)
        power += [sums[:3].sum(), sums[3:].sum()]
        total += block.taper.shape[1] * block.step
    return np.sqrt(power / total)
