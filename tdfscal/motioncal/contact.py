"""What touches the terminal while it moves: a score test of a free wrench in sliding windows.

A window's shape times each of the six components of a wrench is a column that the model does not
have. Its score in the weighted residuals, less what the fit would take up of it, is χ²₆ where
nothing touches (Rao, Proc. Camb. Phil. Soc. 44, 1948).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.motioncal.blocks import Block
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.significance import CONTACT_IN_MOTION

#: Length of a window and the way from one to the next, s.
WINDOW, _STRIDE = 2.0, 0.5
#: A window under the taper's ramp shows nothing: least share of its weight.
_LEAST = 0.2


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
    scores = [_scores(fit, index) for index in range(len(fit.designs))]
    tests = max(1, sum(len(s.middle) for s in scores))
    limit = float(chi2_quantile(1 - level / tests, 6))
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


def _scores(fit: MovingFit, index: int) -> _Scores:
    """Score statistics of all windows of one block."""
    item, place = fit.designs[index], fit.rows.place[index]
    block, mixing = item.block, fit.rows.mixing[index]
    shape, middle = _windows(block)
    d = block.transform(shape.T).T  # (W, F)
    bins = fit.rows.bins
    weight = (bins.count / fit.noise.variance(bins))[place].reshape(-1, 6)
    r = fit.residual[place].reshape(-1, 6) * weight
    J = fit.jacobian[place].reshape(*weight.shape, -1) * weight[..., None]
    _, whole = fit.whitened()
    root = spectrum(whole).root
    # In the components that are independent: u = Σ d* r / s, G = Σ |d|² / s, L = Σ d* J / s.
    u = (d.conj() @ r).real
    G = np.abs(d) ** 2 @ weight
    L = (d.conj() @ J.reshape(len(weight), -1)).real.reshape(len(d), 6, -1) @ root
    info = -(L @ np.swapaxes(L, 1, 2))
    info[:, np.arange(6), np.arange(6)] += G
    # What the fit takes up whole leaves no information; a trace of it keeps the matrix regular.
    info[:, np.arange(6), np.arange(6)] += 1e-6 * G
    amplitude = -np.linalg.solve(info, u[..., None])[..., 0]
    statistic = -np.sum(u * amplitude, axis=1)
    # e = … + wrench of the contact: what acts is minus what the balance lacks.
    wrench = -np.linalg.solve(mixing, amplitude[..., None])[..., 0]
    return _Scores(middle, statistic, wrench)


def _windows(block: Block) -> tuple[FloatArray, FloatArray]:
    """Shapes (W, N), smooth and of height 1, and their middles (W,) in s."""
    N, step = block.taper.shape[1], block.step
    time = step * np.arange(N)
    middle = np.arange(WINDOW / 2, time[-1] - WINDOW / 2 + 1e-9, _STRIDE)
    u = (time - middle[:, None]) / (WINDOW / 2)
    shape = np.where(np.abs(u) < 1, np.cos(np.pi * u / 2) ** 2, 0.0)
    seen = shape @ block.taper[0] >= _LEAST * shape.sum(axis=1)
    return shape[seen], block.begin + middle[seen]


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
