"""Changes of level in noisy signals: noise of differences, and where a difference exceeds it.

A signal at rest has differences of neighbouring window means that the noise alone explains. The
noise is measured on the log itself, at window lengths 1, 2, 4 … bins, so that vibration and
correlated noise count as what they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.special import ndtri

from tdfscal.dwells.bins import Bins
from tdfscal.records import BoolArray, FloatArray, IntArray

_SCALES = 6  # windows of 1 … 32 bins; what is slower is settling or drift, tested per dwell
_FALSE_ALARMS = 1e-3  # expected per log
_ROUNDS = 4
_BLOCKS, _BLOCK = 16, 2048  # bins
_ENOUGH = 8_000  # differences that show the noise
_MAD = 1.482602218505602  # standard deviation / median absolute deviation, Gaussian
_SMOOTH = 2.0 * np.sqrt(2.0 ** (_SCALES - 1))
_SOME_BENDS = 100
_BENDS = 10  # second differences that show how loud a rest is
_CREEP = 1.25  # growth from the second longest windows to the longest; settling doubles
_SEED_QUANTILE = 0.02  # at least this share of a log is rest
_SEED_WINDOW = 0.2  # s


@dataclass(frozen=True, slots=True)
class Signals:
    """Signals on a common grid: value (A, B), one row per axis, gaps filled with the last value.

    gap : (B,), no sample there for too long. quantum : (A,), resolution of the readings.
    """

    value: FloatArray
    gap: BoolArray
    quantum: FloatArray


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviation of the difference of neighbouring window means, (scales, A)."""

    difference: FloatArray
    quantum: FloatArray

    def times(self, factor: FloatArray) -> Noise:
        """The noise of each axis (A,) times a factor."""
        return Noise(self.difference * factor, self.quantum)

    def of_mean(self, length: IntArray | int) -> FloatArray:
        """Standard deviation of a window's mean, length(s) in bins → (..., A).

        Beyond the largest measured scale the noise is taken as uncorrelated.
        """
        n = np.maximum(np.asarray(length, dtype=np.float64), 1.0)
        scales = len(self.difference)
        level = np.clip(np.floor(np.log2(n)).astype(np.int64), 0, scales - 1)
        ratio = np.sqrt(2.0**level / n)
        return np.asarray(self.difference[level] * ratio[..., None] / np.sqrt(2.0))


def signals(bins: Bins, streams: slice) -> Signals:
    """The bin means of some streams as (A, B) rows; a row of gap is put where time jumps."""
    mean = bins.mean[:, streams].reshape(len(bins), -1)
    count = np.repeat(bins.count[:, streams], 3, axis=1)
    value = np.empty((mean.shape[1], len(bins)))
    index = np.arange(len(bins))
    gap = np.zeros(len(bins), dtype=np.bool_)
    for axis in range(mean.shape[1]):
        known = np.maximum.accumulate(np.where(count[:, axis] > 0, index, -1))
        column = mean[np.maximum(known, 0), axis]
        value[axis] = np.where(np.isfinite(column), column, 0.0)
        if axis % 3 == 0:
            age = np.where(known >= 0, bins.start - bins.start[known], np.inf)
            period = bins.period[streams][axis // 3]
            silent = age > max(10.0 * period, 3.0 * bins.width)
            gap |= _back_to_last_sample(silent, count[:, axis] > 0)
    return Signals(value, gap, bins.quantum[streams].ravel())


def _back_to_last_sample(silent: BoolArray, present: BoolArray) -> BoolArray:
    """Extend each silence back over the empty bins before it was noticed."""
    group = np.cumsum(present)
    hit = np.zeros(group[-1] + 1 if len(group) else 0, dtype=np.bool_)
    hit[group[silent]] = True
    return np.asarray(~present & hit[group])


def _differences(row: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """(W, D) with D[i] = mean(row[i+W : i+2W]) − mean(row[i : i+W]); exact for constant rows."""
    mean, width = row, 1
    for _ in range(_SCALES):
        if len(mean) <= width:
            return
        yield width, mean[width:] - mean[:-width]
        mean = 0.5 * (mean[width:] + mean[:-width])
        width *= 2


def _clean(marked: BoolArray, length: int) -> BoolArray:
    """[i] : no marked bin in [i, i + length)."""
    total = np.concatenate([[0], np.cumsum(marked)])
    return np.asarray(total[length:] == total[:-length])


def difference_noise(found: Signals, marked: BoolArray) -> Noise:
    """Robust noise of the differences over the bins that are not marked."""
    found, marked = _blocks(found, marked)
    axes = len(found.value)
    result = np.full((_SCALES, axes), np.nan)
    clean = {}
    for axis, row in enumerate(found.value):
        for scale, (width, difference) in enumerate(_differences(row)):
            if width not in clean:
                index = np.flatnonzero(_clean(marked, 2 * width))
                clean[width] = index[:: max(len(index) // _ENOUGH, 1)]
            if len(clean[width]) >= 8:
                result[scale, axis] = _MAD * np.median(np.abs(difference[clean[width]]))
    for scale in range(_SCALES):
        missing = np.isnan(result[scale])
        white = result[scale - 1] / np.sqrt(2.0) if scale else np.zeros(axes)
        result[scale, missing] = white[missing]
    return Noise(result, found.quantum)


def mark_changes(
    found: Signals,
    noise: Noise,
    marked: BoolArray,
    override: float | None,
    louder: FloatArray | None = None,
) -> BoolArray:
    """Bins that are marked already, or where the level of any axis changes.

    override : a threshold of one's own for all axes and windows. louder : (A, B), factor by which
    the noise there exceeds the log's.
    Small windows first: they place a change best, and larger windows then keep clear of it.
    """
    marked = marked.copy()
    limit = threshold(found, noise)
    if override is not None:
        limit = np.full_like(limit, override)
    levels: list[tuple[int, FloatArray]] = []
    for axis, row in enumerate(found.value):
        for scale, (width, difference) in enumerate(_differences(row)):
            excess = np.abs(difference)
            factor = 1.0 if louder is None else louder[axis, : len(excess)]
            excess -= limit[scale, axis] * factor
            if scale == len(levels):
                levels.append((width, excess))
            else:
                np.maximum(levels[scale][1], excess, out=levels[scale][1])
    for width, excess in levels:
        clean = _clean(marked, 2 * width)
        for first, last in zip(*runs((excess > 0) & clean), strict=True):
            peak = first + int(np.argmax(excess[first:last]))
            # A step at a bin raises the differences ±W about it, most at the step itself. A peak
            # at the border of what is marked already is the end of a gradual change beyond it.
            begin = min(peak + width - 1, first + width + width // 2)
            end = max(peak + width + 1, last - 1 + width - width // 2)
            if peak == first and (first == 0 or not clean[first - 1]):
                begin = first
            if peak == last - 1 and (last == len(clean) or not clean[last]):
                end = last - 1 + 2 * width
            marked[begin:end] = True
    return marked


def threshold(found: Signals, noise: Noise) -> FloatArray:
    """Difference that noise and resolution do not explain, (scales, A)."""
    tests = max(found.value.size, 1) * _SCALES
    quantile = float(-ndtri(0.5 * _FALSE_ALARMS / tests))
    rounding = 8.0 * np.finfo(np.float64).eps * np.abs(found.value).max(axis=1, initial=0.0)
    return np.asarray(quantile * noise.difference + 1.001 * noise.quantum + rounding)


def runs(flag: BoolArray) -> tuple[IntArray, IntArray]:
    """First and one-past-last indices of the runs of True."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], flag.astype(np.int8), [0]])))
    return change[::2], change[1::2]


def quiet_seed(found: Signals, base: BoolArray, width: float) -> BoolArray:
    """Bins that may be in motion (or are in base), for a first estimate of the noise on the rest.

    The seed of rest are the windows with the smallest range; a range of zero (encoders
    without noise, a servo that is off) counts as quiet, yet does not set the scale.
    """
    size = max(5, round(_SEED_WINDOW / width))
    reach = np.zeros(found.value.shape[1])
    for row in found.value:
        span = maximum_filter1d(row, size) - minimum_filter1d(row, size)
        np.maximum(reach, span, out=reach)
    tiny = 8.0 * np.finfo(np.float64).eps * np.abs(found.value).max(initial=0.0)
    alive = reach[(reach > tiny) & ~base]
    if not len(alive):
        return base
    return np.asarray((reach > 2.0 * np.quantile(alive, _SEED_QUANTILE)) | base)


def segment(
    found: Signals,
    base: BoolArray,
    width: float,
    override: float | None,
    louder: FloatArray | None = None,
) -> tuple[BoolArray, Noise]:
    """Alternate noise and marks until they agree; base: bins that are out in any case.

    width : of a bin, s. override, louder : see `mark_changes`. Blocks over the whole log are
    enough for the noise of a long one.
    """
    sample, out = _blocks(found, base)
    marked = quiet_seed(sample, out, width)
    for _ in range(_ROUNDS):
        noise = difference_noise(sample, marked)
        if _travels(noise):
            return np.ones_like(base), noise
        noise = without_creep(noise)
        previous, marked = marked, mark_changes(sample, noise, out, override)
        if np.array_equal(previous, marked):
            break
    return mark_changes(found, noise, base, override, louder), noise


def _blocks(found: Signals, base: BoolArray) -> tuple[Signals, BoolArray]:
    """Evenly spread blocks of a long log, each parted from the next by a bin that is out."""
    count = len(base)
    if count <= _BLOCKS * _BLOCK:
        return found, base
    begin = np.linspace(0, count - _BLOCK, _BLOCKS).round().astype(np.int64)
    rows = (begin[:, None] + np.arange(_BLOCK)).ravel()
    out = base[rows]
    out[::_BLOCK] = True
    return Signals(found.value[:, rows], found.gap[rows], found.quantum), out


def louder_rests(found: Signals, moving: BoolArray) -> FloatArray:
    """Factor (A, B) by which the noise of each stretch of rest exceeds that of most; 1 elsewhere.

    By the lower quartile of the second differences: settling is too smooth to show in it, or too
    brief.
    """
    bend = np.abs(found.value[:, 2:] - 2 * found.value[:, 1:-1] + found.value[:, :-2])
    factor = np.ones(found.value.shape)
    first, last = runs(~moving)
    long = last - first >= _BENDS + 2
    first, last = first[long], last[long]
    if not len(first):
        return factor
    own = np.stack([_lower_quartile(bend[:, a : b - 2]) for a, b in zip(first, last, strict=True)])
    most = np.median(own, axis=0)
    ratio = np.divide(own, most, out=np.ones_like(own), where=most > 0)
    # A quartile of n bends is known to about 1.6/√n.
    known = 1.0 + 8.0 / np.sqrt(np.minimum(last - first, _SOME_BENDS))
    for a, b, r, k in zip(first, last, ratio, known, strict=True):
        factor[:, a:b] = np.where(r > k, r, 1.0)[:, None]
    return factor


def _lower_quartile(bend: FloatArray) -> FloatArray:
    """(A,) of (A, N), from a share of them where there are many."""
    some = np.sort(bend[:, :: max(bend.shape[1] // _SOME_BENDS, 1)], axis=1)
    return np.asarray(some[:, some.shape[1] // 4])


def without_creep(noise: Noise) -> Noise:
    """The noise with what still grows at the longest windows replaced by uncorrelated noise.

    Vibration and correlated noise average out in long windows. Differences that grow to the end
    are settling that fills the stops, and would hide itself if it counted as noise.
    """
    difference = noise.difference.copy()
    scales = len(difference)
    growing = difference[-1] > _CREEP * difference[-2]
    lowest = np.full(difference.shape[1], scales - 1)
    for scale in range(scales - 1, 0, -1):
        growing &= difference[scale] > difference[scale - 1]
        lowest[growing] = scale - 1
    for axis in np.flatnonzero(lowest < scales - 1):
        beyond = np.arange(lowest[axis] + 1, scales)
        difference[beyond, axis] = difference[lowest[axis], axis] * 2.0 ** (
            -0.5 * (beyond - lowest[axis])
        )
    return Noise(difference, noise.quantum)


def _travels(noise: Noise) -> bool:
    """Is even the quietest part of the log a smooth motion?

    Differences of windows grow like W in a motion, like √W at most in noise.
    """
    short = np.maximum(noise.difference[0], noise.quantum)
    return bool(np.any(noise.difference[-1] > _SMOOTH * short + 1e-300))


def together(first: Noise, second: Noise) -> Noise:
    """The noise of the axes of both."""
    return Noise(
        np.concatenate([first.difference, second.difference], axis=1),
        np.concatenate([first.quantum, second.quantum]),
    )
