"""What data two estimates share: by the files they come from, and by the readings themselves.

Noise does not repeat itself: the mean readings of two recordings, even of the same postures, differ
as their standard errors say or farther. Means that agree better, over many dwells, are of the same
samples, whatever became of file, clock and digits, and though the dwells' edges moved when a part
was cut out. A motion has no dwells: its readings are taken where they change least for a moment,
which they tell themselves, by whatever clock.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import gammainc, gammaln

from tdfscal.frozen import record
from tdfscal.motioncal.streams import Slow
from tdfscal.records import BoolArray, Dwells, FloatArray, Rig
from tdfscal.significance import GROSS_NOISE_FACTOR, REPEATED_BY_CHANCE

#: first, second: the recordings of this one all went into the other too, which has more.
Relation = Literal["apart", "first", "second", "same", "overlapping"]


#: Share of the shorter of two parts that both may hold where one was cut after the other.
_ABUTTING = 0.01


@record
class Recorded:
    """A recording that went into an estimate.

    sha256 : of its bytes. span : begin and end of the part that was used, s in the recording's
    time; None for all of it, or where that is not known.
    """

    sha256: str
    span: tuple[float, float] | None = None

    def meets(self, other: Recorded) -> bool:
        """Whether some of the same samples are in both."""
        if self.sha256 != other.sha256:
            return False
        if self.span is None or other.span is None:
            return True
        shared = min(self.span[1], other.span[1]) - max(self.span[0], other.span[0])
        shorter = min(end - begin for begin, end in (self.span, other.span))
        return shared > _ABUTTING * shorter

    def meets_any(self, others: Collection[Recorded]) -> bool:
        """Whether some of the same samples are in one of the others."""
        return any(self.meets(other) for other in others)

    def lies_in(self, other: Recorded) -> bool:
        """Whether all of its samples are in the other too."""
        if not self.meets(other):
            return False
        if self.span is None or other.span is None:
            return other.span is None or self.span == other.span
        return other.span[0] <= self.span[0] and self.span[1] <= other.span[1]


def relation(first: Collection[Recorded], second: Collection[Recorded]) -> Relation:
    """What two estimates have in common.

    Two parts of one recording, one within the other, count as the same: which of their samples
    were averaged alike is not known.
    """
    if not any(a.meets_any(second) for a in first):
        return "apart"
    if {a.sha256 for a in first} == {b.sha256 for b in second}:
        return "same"
    if all(any(a.lies_in(b) for b in second) for a in first):
        return "first"
    if all(any(b.lies_in(a) for a in first) for b in second):
        return "second"
    return "overlapping"


#: Factor within which standard errors are known from the scatter of samples.
_NOISE_KNOWN = 1.2
#: Share of its variance by which the same mean may have moved in digits and edges, at least.
_MOVED = 1e-6
#: Chance of a dwell that agrees as well as those of a recording that is known again.
_ALONE = 0.01
#: Dwells that a cut at either end may have left as others.
_CUT = 2
#: s, half length of a mean in motion; how many a recording has at most; gain of fourth differences
#: on noise behind the kernel of the slow streams, for noise of the same density.
_MEAN, _MOMENTS, _FOURTH = 1.0, 200, 17.3**0.5


@record
class Readings:
    """Mean readings of K dwells, or moments of a motion, by which their recording is known again.

    force : (K, n, 3), N, sensor frames. noise : (n, 3), N, typical standard error of a mean, by the
    samples' noise alone; 0 where that is not known, or where there is none.
    """

    force: FloatArray
    noise: FloatArray


def readings(rig: Rig, dwells: Dwells) -> Readings:
    """Return the mean readings of dwells.

    What rounding to coarse steps adds to a standard error is no noise: it is the same again. So
    the extremes bound it, as those of normal samples. Of averaged postures only the rig file states
    a noise, by a guess; far below it they differ too.
    """
    variance = np.diagonal(dwells.force_cov, axis1=-2, axis2=-1)
    far = np.sqrt(2 * np.log(np.maximum(dwells.count, 3)))  # of the extremes (Gumbel's law)
    far -= (np.log(far**2 / 2) + np.log(4 * np.pi)) / (2 * far)
    scatter = (dwells.force_max - dwells.force_min) / (2 * far[..., None])
    variance = np.minimum(variance, scatter**2 / np.maximum(dwells.effective, 1)[..., None])
    noise = np.zeros(rig.axes.shape)
    if len(dwells):  # what does not move within a dwell may be the same again
        noise = np.where(variance.all(axis=0), np.sqrt(np.median(variance, axis=0)), 0.0)
    if not dwells.force_cov.any():
        noise = np.full(rig.axes.shape, rig.declared.force_noise / GROSS_NOISE_FACTOR)
    return Readings(np.where(rig.axes, dwells.force, 0.0), np.where(rig.axes, noise, 0.0))


def repeated(known: Readings, seen: Readings) -> BoolArray:
    """Which of K dwells (K,) hold samples of the known ones, beyond chance.

    Of the j dwells that agree best with a known one the squares sum up to less than χ² does by
    chance, for all choices of j of K, and of the known ones within reach. Then any more are among
    them that agree so well by themselves.
    """
    from scipy.spatial import cKDTree  # slow to import, seldom needed

    K, variance = len(seen.force), known.noise**2 + seen.noise**2
    told = variance > 0
    dof = np.count_nonzero(told)
    if not dof or not K or not len(known.force):
        return np.zeros(K, dtype=np.bool_)
    std = np.sqrt(variance[told])
    tree, own = cKDTree(known.force[:, told] / std), seen.force[:, told] / std
    square = tree.query(own)[0] ** 2 + dof * _MOVED
    within = np.maximum(tree.query_ball_point(own, np.sqrt(dof), return_length=True), 1)
    order, j = np.argsort(square, kind="stable"), np.arange(1, K + 1)
    half, total = dof * j / 2, np.cumsum(square[order]) * _NOISE_KNOWN**2 / 2
    choices = gammaln(K + 1) - gammaln(j + 1) - gammaln(K - j + 1)
    choices += np.cumsum(np.log(within[order])) + np.log(K)
    # The lower tail of χ² is below its first term times a geometric series.
    total = np.minimum(total, half)
    rest = np.log1p(-total / (half + 1))
    chance = half * np.log(total) - total - gammaln(half + 1) - rest + choices
    best = int(np.argmin(chance))
    if chance[best] >= np.log(REPEATED_BY_CHANCE):
        return np.zeros(K, dtype=np.bool_)
    alone = np.asarray(gammainc(dof / 2, square * _NOISE_KNOWN**2 / 2) * within < _ALONE)
    alone[order[: best + 1]] = True
    return alone


def readings_in_motion(rig: Rig, slow: Slow) -> Readings:
    """Return the mean readings at the moments of a motion at which they change least."""
    from scipy.interpolate import CubicSpline  # slow to import, seldom needed

    half = max(1, round(_MEAN / slow.step))
    window = np.sin(np.pi * np.arange(1, 2 * half) / (2 * half)) ** 2
    window /= window.sum()
    force = np.where(rig.axes, slow.force, 0.0)
    speed, found = [np.empty(0)], [np.empty((0, *rig.axes.shape))]
    gaps = np.flatnonzero(np.diff(slow.time) > 1.5 * slow.step) + 1
    for whole in np.split(force, gaps):
        if len(whole) < len(window) + 4:
            continue
        step = np.arange(len(whole) - len(window) + 1.0)
        mean = CubicSpline(step, sliding_window_view(whole, len(window), axis=0) @ window)
        change = CubicSpline(step, np.sum(mean(step, 1) ** 2, axis=(1, 2)))
        still = change.derivative().roots(extrapolate=False)
        still = still[change(still, 2) > 0]
        found.append(mean(still))
        speed.append(change(still))
    least = np.sort(np.argsort(np.concatenate(speed), kind="stable")[:_MOMENTS])
    noise = np.zeros(rig.axes.shape)
    if len(least):
        rough = np.median(np.abs(np.diff(force, 4, axis=0)), axis=0) / (0.6745 * _FOURTH)
        noise = rough * np.sqrt(window @ window)
    return Readings(np.concatenate(found)[least], noise)


def relation_of_readings(first: Sequence[Readings], second: Sequence[Readings]) -> Relation:
    """What two estimates have in common by the readings of each one's recordings.

    One whose readings all lie in the other, which has no further recording, counts as the same, as
    parts of one file do.
    """
    met = np.array([[_meet(own, other) for other in second] for own in first])
    if not met.any():
        return "apart"
    alone = not met.any(axis=1).all(), not met.any(axis=0).all()  # a recording of the one or other
    inside = (
        not alone[0] and all(_lies_in(one, second) for one in first),
        not alone[1] and all(_lies_in(one, first) for one in second),
    )
    if inside[0] and alone[1]:
        return "first"
    if inside[1] and alone[0]:
        return "second"
    return "same" if any(inside) else "overlapping"


def repeated_in(known: Sequence[Readings], seen: Readings) -> BoolArray:
    """Which of K dwells (K,) hold samples of any of the known recordings."""
    return np.asarray(np.any([repeated(one, seen) for one in known], axis=0))


def _meet(one: Readings, other: Readings) -> bool:
    return bool(repeated(one, other).any() or repeated(other, one).any())


def _lies_in(one: Readings, others: Sequence[Readings]) -> bool:
    return int(np.sum(~repeated_in(others, one))) <= _CUT
