"""What data two estimates share: by the files they come from, and by the readings themselves.

Noise does not repeat itself: the mean readings of two recordings, even of the same postures, differ
as their standard errors say or farther. Means that agree better, over many dwells, are of the same
samples, whatever became of file, clock and digits, and though the dwells' edges moved when a part
was cut out. All sensors together are asked, and each sensor by itself: its three readings a dwell
tell as surely, though a channel of another one was edited.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, TypeVar

import numpy as np
from scipy.special import gammainc, gammaln

from tdfscal.frozen import record
from tdfscal.records import BoolArray, Dwells, FloatArray, Rig
from tdfscal.significance import REPEATED_BY_CHANCE

#: What is stated of a noise is a guess within this factor.
_GUESS = 10.0
#: first, second: the recordings of this one all went into the other too, which has more.
Relation = Literal["apart", "first", "second", "same", "overlapping"]
#: Share of the shorter of two parts that both may hold where one was cut after the other.
_ABUTTING = 0.01
#: Factor within which standard errors are known from the scatter of samples.
_NOISE_KNOWN = 1.2
#: Share of its variance by which the same mean may have moved in digits and edges, at least.
_MOVED = 1e-6
#: Chance of a dwell that agrees as well as those of a recording that is known again.
_ALONE = 0.01
#: Dwells that a cut at either end may have left as others.
_CUT = 2


@record
class Recorded:
    """A file of a recording that went into an estimate, known by its bytes.

    sha256 : of these. span : begin and end of the part that was used, s in the recording's
    time; None for all of it, or where that is not known.
    """

    path: str
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

    def lies_in(self, others: Collection[Recorded]) -> bool:
        """Whether all of its samples are in one of the others too."""
        whole = (-np.inf, np.inf)
        begin, end = self.span or whole
        spans = (other.span or whole for other in others if self.meets(other))
        return any(first <= begin and end <= last for first, last in spans)


@record
class Readings:
    """Mean readings of K dwells, by which their recording is known again.

    force : (K, n, 3), N, sensor frames. noise : (n, 3), N, typical standard error of a mean, by the
    samples' noise alone; 0 where that is not known, or where there is none.
    """

    force: FloatArray
    noise: FloatArray

    def meets(self, other: Readings) -> bool:
        """Whether some of the same samples are in both."""
        return bool(repeated(self, other).any() or repeated(other, self).any())

    def lies_in(self, others: Collection[Readings]) -> bool:
        """Whether all of its samples are in the others too, but for what a cut leaves."""
        return int(np.sum(~repeated_in(others, self))) <= _CUT


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
        noise = np.full(rig.axes.shape, rig.declared.force_noise / _GUESS)
    return Readings(np.where(rig.axes, dwells.force, 0.0), np.where(rig.axes, noise, 0.0))


def repeated(known: Readings, seen: Readings) -> BoolArray:
    """Which of K dwells (K,) hold samples of the known ones, beyond chance.

    By all sensors together, or by any one of them.
    """
    found, std = np.zeros(len(seen.force), dtype=np.bool_), np.hypot(known.noise, seen.noise)
    if not len(found) or not len(known.force):
        return found
    chance = REPEATED_BY_CHANCE / (1 + len(std))
    for which in (slice(None), *range(len(std))):
        told = std[which] > 0
        if told.any():
            one, other = (
                each.force[:, which][:, told] / std[which][told] for each in (known, seen)
            )
            found |= _agreeing(one, other, chance)
    return found


def _agreeing(known: FloatArray, seen: FloatArray, limit: float) -> BoolArray:
    """Which of K dwells seen (K, c) agree with known ones (L, c), in standard errors, too well.

    Of the j dwells that agree best with a known one the squares sum up to less than χ² does by
    chance, for all choices of j of K, and of the known ones within reach. Then any more are among
    them that agree so well by themselves.
    """
    from scipy.spatial import cKDTree  # slow to import, seldom needed

    K, dof = seen.shape
    tree = cKDTree(known)
    square = tree.query(seen)[0] ** 2 + dof * _MOVED
    within = np.maximum(tree.query_ball_point(seen, np.sqrt(dof), return_length=True), 1)
    order, j = np.argsort(square, kind="stable"), np.arange(1, K + 1)
    half, total = dof * j / 2, np.cumsum(square[order]) * _NOISE_KNOWN**2 / 2
    choices = gammaln(K + 1) - gammaln(j + 1) - gammaln(K - j + 1)
    choices += np.cumsum(np.log(within[order])) + np.log(K)
    # The lower tail of χ² is below its first term times a geometric series.
    total = np.minimum(total, half)
    rest = np.log1p(-total / (half + 1))
    chance = half * np.log(total) - total - gammaln(half + 1) - rest + choices
    best = int(np.argmin(chance))
    if chance[best] >= np.log(limit):
        return np.zeros(K, dtype=np.bool_)
    alone = np.asarray(gammainc(dof / 2, square * _NOISE_KNOWN**2 / 2) * within < _ALONE)
    alone[order[: best + 1]] = True
    return alone


def repeated_in(known: Collection[Readings], seen: Readings) -> BoolArray:
    """Which of K dwells (K,) hold samples of any of the known recordings."""
    return np.asarray(np.any([repeated(one, seen) for one in known], axis=0))


Known = TypeVar("Known", Recorded, Readings)


def relation(first: Collection[Known], second: Collection[Known]) -> Relation:
    """What two estimates have in common, by what each one's recordings are known by.

    One whose recordings all lie in the other's, which has no further one, counts as the same: which
    of their samples were averaged alike is not known.
    """
    met = np.array([[own.meets(other) for other in second] for own in first], dtype=np.bool_)
    if not met.any():
        return "apart"
    more = not met.any(axis=1).all(), not met.any(axis=0).all()  # a recording of the one or other
    inside = (
        not more[0] and all(one.lies_in(second) for one in first),
        not more[1] and all(one.lies_in(first) for one in second),
    )
    if inside[0] and more[1]:
        return "first"
    if inside[1] and more[0]:
        return "second"
    return "same" if any(inside) else "overlapping"
