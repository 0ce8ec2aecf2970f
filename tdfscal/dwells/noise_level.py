"""Noise of signals at rest, measured on the log itself: differences of neighbouring window means.

At window lengths of 1, 2, 4 … bins, so that vibration and correlated noise count as what they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from tdfscal.dwells.bins import Bins
from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, FloatArray, IntArray

SCALES = 6  # windows of 1 … 32 bins show changes; what is slower is settling or drift, or noise
LONGEST = 9  # scales at which noise is measured, where stops are long enough
_BLOCKS, _BLOCK = 8, 2048  # bins
_ENOUGH = 8_000  # differences that show the noise
_ENOUGH_LONG = 4  # windows one after the other that show it at long scales
_APART = 16  # differences apart from each other that show how large they are, and how they follow
_MAD = 1.482602218505602  # standard deviation / median absolute deviation, Gaussian
_P90 = 1.6448536269514722  # 90 % quantile of a size / standard deviation, Gaussian
_SOME_BENDS = 100
_BENDS = 10  # second differences that show how noisy a rest is
_CREEP = 1.25  # growth from the second longest windows to the longest; settling doubles


def runs(flag: BoolArray) -> tuple[IntArray, IntArray]:
    """First and one-past-last indices of the runs of True."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], flag.astype(np.int8), [0]])))
    return change[::2], change[1::2]


@record
class Signals:
    """Signals on a common grid: value (A, B), one row per axis, gaps filled with the last value.

    gap : (B,), no sample there for too long. quantum : (A,), resolution of the readings.
    """

    value: FloatArray
    gap: BoolArray
    quantum: FloatArray


@record
class Noise:
    """Standard deviation of the difference of neighbouring window means, (scales, A).

    smooth : (A,), the longest differences follow each other alike, as those of settling do, rather
    than at random.
    """

    difference: FloatArray
    quantum: FloatArray
    smooth: BoolArray

    def of_mean(self, length: IntArray | int) -> FloatArray:
        """Standard deviation of a window's mean, length(s) in bins → (..., A).

        Beyond the largest measured scale the noise is taken as uncorrelated.
        """
        n = np.maximum(length, 1.0)
        level = np.minimum(np.log2(n).astype(np.int64), len(self.difference) - 1)
        ratio = np.sqrt(2.0**level / (2.0 * n))
        return np.asarray(self.difference[level] * ratio[..., None])

    @cached_property
    def _apart(self) -> FloatArray:
        """V of windows of 1, 2, 4 … bins less what the longest have in common, (scales + 1, A)."""
        square = 0.25 * self.difference**2
        return np.cumsum(np.concatenate([square, square[-1:]])[::-1], axis=0)[::-1]

    def of_part(self, length: IntArray, whole: int) -> FloatArray:
        """Variance by which means of windows depart from that of a neighbour (..., A), in bins.

        length : of a window within a stretch, whole : of that and of the neighbour, no shorter.
        With D² the variance of a difference of neighbours and V that of a mean, V(W) − V(2W) =
        D²(W) / 4 whatever the autocorrelation; added is D² of the stretch and its neighbour.
        V goes with 1/W between the lengths that were measured.
        """
        size = np.maximum([*length, whole], 1.0)
        level = np.minimum(np.log2(size).astype(np.int64), len(self.difference) - 1)
        share = (2.0 ** (level + 1) / size - 1.0)[:, None]
        short, long = self._apart[level], self._apart[level + 1]
        own = np.where(share < 0.0, long * (1.0 + share), long + share * (short - long))
        return np.asarray(own[:-1] - own[-1] + 2.0 * self.of_mean(whole) ** 2)


def signals(bins: Bins) -> Signals:
    """The bin means of all streams as (6n, B) rows, positions first."""
    streams = bins.count.shape[1]
    value = bins.mean.transpose(1, 2, 0).reshape(3 * streams, -1)
    gap = np.zeros(len(bins), dtype=np.bool_)
    empty = np.flatnonzero((bins.count == 0).any(axis=0))
    if len(empty):
        value = value.copy()  # it was a view of the bins
    for stream in empty:
        present = bins.count[:, stream] > 0
        known = np.maximum.accumulate(np.where(present, np.arange(len(bins)), -1))
        rows = value[3 * stream : 3 * stream + 3]
        held = rows[:, np.maximum(known, 0)]
        rows[:] = np.where(np.isfinite(held), held, 0.0)
        age = np.where(known >= 0, bins.start - bins.start[known], np.inf)
        silent = age > max(10.0 * bins.period[stream], 3.0 * bins.width)
        gap |= _back_to_last_sample(silent, present)
    return Signals(value, gap, bins.quantum.ravel())


def _back_to_last_sample(silent: BoolArray, present: BoolArray) -> BoolArray:
    """Extend each silence back over the empty bins before it was noticed."""
    group = np.cumsum(present)
    hit = np.zeros(group[-1] + 1 if len(group) else 0, dtype=np.bool_)
    hit[group[silent]] = True
    return np.asarray(~present & hit[group])


def differences(value: FloatArray, scales: int) -> Iterator[tuple[int, FloatArray]]:
    """(W, D) with D[…, i] = mean(value[…, i+W : i+2W]) − mean(value[…, i : i+W]) of (A, N).

    Exact for constant rows. D is good until the next is taken; it may be changed in place.
    """
    mean, width = value, 1
    difference, *spare = (np.empty(value.shape) for _ in range(3))
    for scale in range(scales):
        size = mean.shape[1] - width
        if size <= 0:
            return
        yield width, np.subtract(mean[:, width:], mean[:, :size], out=difference[:, :size])
        mean = np.add(mean[:, width:], mean[:, :size], out=spare[scale % 2][:, :size])
        mean *= 0.5
        width *= 2


def clean(marked: BoolArray, length: int) -> BoolArray:
    """[i] : no marked bin in [i, i + length)."""
    total = np.concatenate([[0], np.cumsum(marked)])
    return np.asarray(total[length:] == total[:-length])


def difference_noise(signal: Signals, marked: BoolArray, scales: int) -> Noise:
    """Robust noise of the differences over the bins that are not marked.

    scales : as far as there are windows enough. Too few of them may be alike by chance, as if
    there were no noise: these count for no less than what white noise leaves of shorter ones.
    """
    signal, marked = blocks(signal, marked)
    axes = len(signal.value)
    some, few = [], []
    follow: tuple[int, IntArray] | None = None
    for scale in range(scales):
        index = np.flatnonzero(clean(marked, 2 ** (scale + 1)))
        if scale and len(index) < (8 if scale < SCALES else _ENOUGH_LONG * 2**scale):
            break
        some.append(index[:: max(len(index) // _ENOUGH, 1)])
        few.append(0 < scale < SCALES and _apart(index, 2 ** (scale + 1)) < _APART)
        index = np.flatnonzero(clean(marked, 3 * 2**scale))
        if _apart(index, 2**scale) >= _APART:
            follow = scale, index[:: max(len(index) // _ENOUGH, 1)]
    smooth = np.ones(axes, dtype=np.bool_)
    result = np.zeros((len(some), axes))
    for scale, (width, difference) in enumerate(differences(signal.value, len(some))):
        if len(some[scale]) >= 8:
            # Most differences of readings that are coarser than their noise are zero, or one step,
            # whatever the noise: then the larger ones tell.
            size = np.abs(difference[:, some[scale]])
            half, most = size.shape[1] // 2, 9 * size.shape[1] // 10
            ranked = np.partition(size, (half, most), axis=1)
            middle, wide = _MAD * ranked[:, half], ranked[:, most] / _P90
            fine = middle >= signal.quantum
            result[scale] = np.where(fine, middle, np.maximum(middle, wide))
        if few[scale]:
            result[scale] = np.maximum(result[scale], result[scale - 1] / np.sqrt(2.0))
        if follow is not None and follow[0] == scale:
            first, second = difference[:, follow[1]], difference[:, follow[1] + width]
            # Mean products, not medians: a stop shows one or two of the longest windows.
            smooth = np.sum(first * second - 0.25 * (first**2 + second**2), axis=1) > 0
    return Noise(result, signal.quantum, smooth)


def _apart(index: IntArray, length: int) -> float:
    """How many windows of some length do not overlap, of those that begin at each index."""
    if not len(index):
        return 0.0
    runs_of = 1 + np.count_nonzero(np.diff(index) > 1)
    return float(runs_of + (len(index) - runs_of) / length)


def blocks(signal: Signals, base: BoolArray) -> tuple[Signals, BoolArray]:
    """Evenly spread blocks of a long log, each parted from the next by a bin that is out."""
    count = len(base)
    if count <= _BLOCKS * _BLOCK:
        return signal, base
    begin = np.linspace(0, count - _BLOCK, _BLOCKS).round().astype(np.int64)
    rows = (begin[:, None] + np.arange(_BLOCK)).ravel()
    out = base[rows]
    out[::_BLOCK] = True
    return Signals(signal.value[:, rows], signal.gap[rows], signal.quantum), out


def evened(forces: Signals, moving: BoolArray) -> Signals:
    """The signals with rests that are noisier than most brought to their noise, about their level.

    By the lower quartile of the second differences: settling is too smooth to show in it, or too
    brief.
    """
    first, last = runs(~moving)
    rests = [slice(a, b) for a, b in zip(first, last, strict=True) if b - a >= _BENDS + 2]
    if not rests:
        return forces
    own = np.empty((len(rests), len(forces.value)))
    for level, rest in zip(own, rests, strict=True):
        inside = forces.value[:, rest]
        step = max((inside.shape[1] - 2) // _SOME_BENDS, 1)
        bend = np.abs(inside[:, 2::step] - 2 * inside[:, 1:-1:step] + inside[:, :-2:step])
        level[:] = np.sort(bend, axis=1)[:, bend.shape[1] // 4]
    most = np.median(own, axis=0)
    value = forces.value
    for rest, noise in zip(rests, own, strict=True):
        # A quartile of n bends is known to about 1.6/√n.
        bends = min(rest.stop - rest.start, _SOME_BENDS)
        louder = (noise > (1.0 + 8.0 / np.sqrt(bends)) * most) & (most > 0)
        if louder.any():
            value = value.copy() if value is forces.value else value
            level = np.median(value[louder, rest], axis=1, keepdims=True)
            share = (most[louder] / noise[louder])[:, None]
            value[louder, rest] = level + share * (value[louder, rest] - level)
    return replace(forces, value=value)


def without_creep(noise: Noise) -> Noise:
    """The noise with what still grows at the longest windows replaced by uncorrelated noise.

    Vibration and correlated noise average out in long windows. Differences that grow to the end
    are settling that fills the stops, and would hide itself if it counted as noise.
    """
    difference = noise.difference.copy()
    scales = len(difference)
    if scales < 2:
        return noise
    growing = noise.smooth & (difference[-1] > _CREEP * difference[-2])
    lowest = np.full(difference.shape[1], scales - 1)
    for scale in range(scales - 1, 0, -1):
        growing &= difference[scale] > difference[scale - 1]
        lowest[growing] = scale - 1
    for axis in np.flatnonzero(lowest < scales - 1):
        beyond = np.arange(lowest[axis] + 1, scales)
        difference[beyond, axis] = difference[lowest[axis], axis] * 2.0 ** (
            -0.5 * (beyond - lowest[axis])
        )
    return replace(noise, difference=difference)
