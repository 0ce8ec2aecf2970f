"""What touches the terminal while it moves: a score test of a free wrench in sliding windows.

A window's shape times each of the six components of a wrench is a column that the model does not
have. Its score in the weighted residuals, less what the fit would take up of it, is χ² of as many
unknowns as are seen where nothing touches (Rao, Proc. Camb. Phil. Soc. 44, 1948).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.motioncal.blocks import Block, ComplexArray
from tdfscal.motioncal.design import BlockDesign
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.rows import bins_of, independent
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.significance import CONTACT_IN_MOTION

#: Length of a window and the way from one to the next, s.
WINDOW, _STRIDE = 2.0, 0.5
#: A window under the taper's ramp shows nothing: least share of its weight.
_LEAST = 0.2
#: Blocks above which no fit takes up half of what a window shows.
_MANY, _HALF = 4, 0.5


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of time, s, that is left out, and why."""

    begin: float
    end: float
    reason: str


@dataclass(frozen=True, slots=True)
class _Scores:
    """Windows of one block: their middle (W,) in s, statistic (W,) and wrench (W, 6)."""

    middle: FloatArray
    statistic: FloatArray
    wrench: FloatArray


def touched(fit: MovingFit, level: float = CONTACT_IN_MOTION) -> tuple[Stretch, ...]:
    """Name the stretches in which a wrench acts that the model does not know.

    level : probability that a log without any contact has one named.
    """
    shapes = _Shapes()
    tests = max(1, sum(len(shapes.of(block)[1]) for block in fit.blocks))
    seen = len(fit.designs[0].seen)
    limit = float(chi2_quantile(1 - level / tests, seen))
    root = fit.information().root
    floor = _HALF * limit if len(fit.designs) > _MANY else 0.0
    scores = [
        _scores(fit, item, e, *shapes.of(item.block), root, floor)
        for item, e in zip(fit.designs, fit.wrenches(), strict=True)
    ]
    out: list[Stretch] = []
    for score in scores:
        hit: IntArray = np.flatnonzero(score.statistic > limit)
        runs = np.split(hit, np.flatnonzero(np.diff(hit) > 1) + 1)
        out += [_stretch(score, run) for run in runs if run.size]
    return tuple(out)


def _stretch(score: _Scores, rows: IntArray) -> Stretch:
    """Join neighbouring windows: a window tells of what lies in its middle half."""
    force, moment = (
        float(np.linalg.norm(score.wrench[rows][:, part], axis=1).max()) for part in np.s_[:3, 3:]
    )
    return Stretch(
        begin=float(score.middle[rows[0]] - WINDOW / 4),
        end=float(score.middle[rows[-1]] + WINDOW / 4),
        reason=f"a wrench of {force:.2g} N and {moment:.2g} N·m that the model does not know: "
        "contact, or a motion too fast for it",
    )


class _Shapes:
    """Windows of blocks, worked out once for all that are alike."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[ComplexArray, FloatArray]] = {}

    def of(self, block: Block) -> tuple[ComplexArray, FloatArray]:
        """Coefficients (W, F) of the windows' shapes, and their middles (W,), s from the begin."""
        N = block.taper.shape[1]
        if N not in self._known:
            shape, middle = _windows(block)
            self._known[N] = block.transform(shape.T).T, middle
        return self._known[N]


def _scores(
    fit: MovingFit,
    item: BlockDesign,
    e: ComplexArray,
    d: ComplexArray,
    middle: FloatArray,
    root: FloatArray,
    floor: float,
) -> _Scores:
    """Score statistics of all windows of one block.

    e : (F, 6), residual. d : (W, F), shapes. root : (p, r), of the parameters' covariance. Where
    the fit can take up half of a statistic at most, one below the floor is not worked out.
    """
    mixing, ratio = independent(item)
    bins = bins_of(item, ratio)
    weight = (bins.count / fit.noise.variance(bins)).reshape(-1, len(ratio))
    # In the components that are independent: u = Σ d* r / s, G = Σ |d|² / s, L = Σ d* J / s.
    u = (d.conj() @ (e @ mixing.T * weight)).real
    G = np.abs(d) ** 2 @ weight
    statistic = np.asarray(np.sum(u**2 / G, axis=1))
    amplitude = -u / G
    some = statistic >= floor
    if some.any():
        J = (mixing @ item.wrench(fit.slope)) * weight[..., None]
        L = d[some].conj() @ J.reshape(len(weight), -1)
        each = np.arange(len(ratio))
        taken = L.real.reshape(len(L), len(each), -1) @ root
        info = -(taken @ np.swapaxes(taken, 1, 2))
        info[:, each, each] += G[some]
        # What the fit takes up whole leaves no information; a trace of it keeps the matrix regular.
        info[:, each, each] += 1e-6 * G[some]
        amplitude[some] = -np.linalg.solve(info, u[some, :, None])[..., 0]
        statistic[some] = -np.sum(u[some] * amplitude[some], axis=1)
    # e = … + wrench of the contact: what acts is minus what the balance lacks.
    wrench = -amplitude @ np.linalg.pinv(mixing).T
    return _Scores(np.asarray(item.block.begin + middle), statistic, np.asarray(wrench))


def _windows(block: Block) -> tuple[FloatArray, FloatArray]:
    """Shapes (W, N), smooth and of height 1, and their middles (W,), s from the block's begin."""
    N, step = block.taper.shape[1], block.step
    time = step * np.arange(N)
    middle = np.arange(WINDOW / 2, time[-1] - WINDOW / 2 + 1e-9, _STRIDE)
    u = (time - middle[:, None]) / (WINDOW / 2)
    shape = np.where(np.abs(u) < 1, np.cos(np.pi * u / 2) ** 2, 0.0)
    seen = shape @ block.taper[0] >= _LEAST * shape.sum(axis=1)
    return shape[seen], middle[seen]


def merged(stretches: Sequence[Stretch], apart: float) -> tuple[Stretch, ...]:
    """Join stretches closer than `apart` (s): what lies between is no log to calibrate from."""
    out: list[Stretch] = []
    for stretch in sorted(stretches, key=lambda s: s.begin):
        if out and stretch.begin - out[-1].end < apart:
            last = out.pop()
            stretch = Stretch(last.begin, max(last.end, stretch.end), last.reason)
        out.append(stretch)
    return tuple(out)


def outside(time: FloatArray, stretches: Sequence[Stretch]) -> BoolArray:
    """Which instants (N,) lie in none of the stretches."""
    keep = np.ones(len(time), dtype=np.bool_)
    for stretch in stretches:
        keep &= (time < stretch.begin) | (time > stretch.end)
    return keep
