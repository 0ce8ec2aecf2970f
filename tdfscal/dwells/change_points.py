"""Changes of level in noisy signals: where a difference of neighbouring window means exceeds noise.

A signal at rest has differences that its noise alone explains; the rest is found from the quietest
windows of the log, alternating with the noise that is measured on it.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from tdfscal.dwells.noise_level import (
    SCALES,
    Noise,
    Signals,
    blocks,
    clean,
    difference_noise,
    differences,
    runs,
    travels,
    without_creep,
)
from tdfscal.numerics.threads import in_threads
from tdfscal.records import BoolArray, FloatArray
from tdfscal.significance import LEVEL_CHANGES_PER_LOG

_ROUNDS = 4
_SPAN = 2**14  # bins whose differences are taken at once; they stay in the cache
_SEED_QUANTILE = 0.02  # at least this share of a log is rest
_SEED_WINDOW = 0.2  # s


def mark_changes(
    signal: Signals,
    noise: Noise,
    marked: BoolArray,
    noisier: FloatArray | None = None,
) -> BoolArray:
    """Bins that are marked already, or where the level of any axis changes.

    noisier : see `noisier_stops`.
    Small windows first: they place a change best, and larger windows then keep clear of it.
    """
    marked = marked.copy()
    limit = threshold(signal, noise)
    for scale, excess in enumerate(_excesses(signal, limit, noisier)):
        width = 2**scale
        free = clean(marked, 2 * width)
        for first, last in zip(*runs((excess > 0) & free), strict=True):
            peak = first + int(np.argmax(excess[first:last]))
            # A step at a bin raises the differences ±W about it, most at the step itself. A peak
            # at the border of what is marked already is the end of a gradual change beyond it.
            begin = min(peak + width - 1, first + width + width // 2)
            end = max(peak + width + 1, last - 1 + width - width // 2)
            if peak == first and (first == 0 or not free[first - 1]):
                begin = first
            if peak == last - 1 and (last == len(free) or not free[last]):
                end = last - 1 + 2 * width
            marked[begin:end] = True
    return marked


def _excesses(signal: Signals, limit: FloatArray, noisier: FloatArray | None) -> list[FloatArray]:
    """By how much the differences of each scale exceed their limit, the largest of all axes."""
    axes, bins = signal.value.shape
    reach = 2**SCALES - 1  # bins that the widest difference takes beyond its first
    levels = [np.full(max(bins - 2 ** (scale + 1) + 1, 0), -np.inf) for scale in range(SCALES)]

    def exceeded(begin: int) -> None:
        for axis in range(axes):
            row = signal.value[axis, begin : begin + _SPAN + reach]
            factor = None if noisier is None else noisier[axis, begin : begin + _SPAN]
            for scale, (_, difference) in enumerate(differences(row, SCALES)):
                excess = np.abs(difference[:_SPAN], out=difference[:_SPAN])
                here = slice(begin, begin + len(excess))
                excess -= limit[scale, axis] * (1.0 if factor is None else factor[: len(excess)])
                np.maximum(levels[scale][here], excess, out=levels[scale][here])

    in_threads(exceeded, range(0, bins, _SPAN))
    return levels


def threshold(signal: Signals, noise: Noise) -> FloatArray:
    """Difference that noise and resolution do not explain, (scales, A)."""
    tests = max(signal.value.size, 1) * SCALES
    quantile = float(-ndtri(0.5 * LEVEL_CHANGES_PER_LOG / tests))
    rounding = 8.0 * np.finfo(np.float64).eps * np.abs(signal.value).max(axis=1, initial=0.0)
    difference = np.sqrt(2.0) * noise.of_mean(2 ** np.arange(SCALES))
    return np.asarray(quantile * difference + 1.001 * noise.quantum + rounding)


def quiet_seed(signal: Signals, base: BoolArray, width: float) -> BoolArray:
    """Bins that may be in motion (or are in base), for a first estimate of the noise on the rest.

    The seed of rest are the windows with the smallest range; a range of zero (encoders
    without noise, a servo that is off) counts as quiet, yet does not set the scale.
    """
    size = max(5, round(_SEED_WINDOW / width))
    reach = np.zeros(signal.value.shape[1])
    for row in signal.value:
        np.maximum(reach, _ranges(row, size), out=reach)
    tiny = 8.0 * np.finfo(np.float64).eps * np.abs(signal.value).max(initial=0.0)
    alive = reach[(reach > tiny) & ~base]
    if not len(alive):
        return base
    return np.asarray((reach > 2.0 * np.quantile(alive, _SEED_QUANTILE)) | base)


def _ranges(row: FloatArray, size: int) -> FloatArray:
    """Range of the values in a window about each of them (N,), mirrored at the ends."""
    high = low = np.pad(row, (size // 2, size - 1 - size // 2), mode="symmetric")
    seen = 1
    while seen < size:
        more = min(seen, size - seen)
        high = np.maximum(high[:-more], high[more:])
        low = np.minimum(low[:-more], low[more:])
        seen += more
    return np.asarray(high - low)


def segment(
    signal: Signals,
    base: BoolArray,
    width: float,
    noisier: FloatArray | None = None,
) -> tuple[BoolArray, Noise]:
    """Alternate noise and marks until they agree; base: bins that are out in any case.

    width : of a bin, s. noisier : see `noisier_stops`. Blocks over the whole log are
    enough for the noise of a long one.
    """
    sample, out = blocks(signal, base)
    marked = quiet_seed(sample, out, width)
    for _ in range(_ROUNDS):
        noise = difference_noise(sample, marked, SCALES)
        if travels(noise):
            return np.ones_like(base), noise
        noise = without_creep(noise)
        previous, marked = marked, mark_changes(sample, noise, out)
        if np.array_equal(previous, marked):
            break
    return mark_changes(signal, noise, base, noisier), noise
