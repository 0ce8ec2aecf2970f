"""Settling: how much to cut from the ends of a stretch that still rings or already moves."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
from scipy.special import chdtri

from tdfscal.dwells.dwell_means import Extent
from tdfscal.dwells.noise_level import Noise
from tdfscal.frozen import record
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.significance import SETTLING_CUT, SETTLING_DECAY

_SLOWEST = 10.0  # s; a time constant beyond is called drift
_BIAS = 0.5  # largest bias of the mean / its standard error where the stop is long enough
_STEP = 50  # a cut advances by at least this fraction of what is left
_CONSTANTS = 24  # time constants tried
_LENGTHS = 2 ** np.arange(40)


Left = Callable[[IntArray, int], FloatArray]
"""Starts (S,) and end of a mean, in bins → bias that the force axes may have, (S, A), N."""


@record
class Settled:
    """A settled stretch [begin, end), bins; ratio: bias to expect / standard error, worst axis."""

    begin: int
    end: int
    ratio: float = 0.0


@record
class Stretch:
    """A stretch of bins, with what is needed to compare the means of its parts.

    start : its first bin; all bins are numbered over the log. value : (A, B), positions first.
    total : (B + 1, A), prefix sums about a common origin. noise : of A axes. forces : the first
    axis that settles (those before are positions). long_run : (A,), standard deviation of a bin
    as it counts in a long mean: Var(mean of T bins) = long_run² / T. width : s.
    tolerance : (A,), difference of means that resolution and rounding explain.
    """

    start: int
    value: FloatArray
    total: FloatArray
    noise: Noise
    forces: int
    long_run: FloatArray
    width: float
    tolerance: FloatArray

    @classmethod
    def of(
        cls,
        start: int,
        value: FloatArray,
        noise: Noise,
        forces: int,
        long_run: FloatArray,
        width: float,
    ) -> Stretch:
        """With the prefix sums of value."""
        origin = value.mean(axis=1)
        total = np.zeros((value.shape[1] + 1, len(value)))
        total[1:] = np.cumsum(value - origin[:, None], axis=1).T
        scale = np.abs(total).max(axis=0) + np.abs(origin)
        tolerance = 1.001 * noise.quantum + 64 * np.finfo(np.float64).eps * scale
        return cls(start, value, total, noise, forces, long_run, width, tolerance)

    def mean(self, begin: IntArray | int, end: IntArray | int) -> FloatArray:
        """Means about the origin, (..., A)."""
        length = np.asarray(end - begin)[..., None]
        total = self.total[end - self.start] - self.total[begin - self.start]
        return np.asarray(total / length)

    def misfit(self, difference: FloatArray, variance: FloatArray, p: float) -> BoolArray:
        """Does a difference of means (..., A) contradict the noise, with false alarm p?

        Positions and forces apart; the sum of squares sees what all axes share, the largest one
        what a single axis has.
        """
        excess = np.maximum(np.abs(difference) - self.tolerance, 0.0)
        if variance.all():
            z2 = excess**2 / variance
        else:
            z2 = np.divide(excess**2, variance, out=np.zeros_like(excess), where=variance > 0)
            z2[(variance == 0) & (excess > 0)] = np.inf
        found = np.zeros(z2.shape[:-1], dtype=np.bool_)
        for own in (z2[..., : self.forces], z2[..., self.forces :]):
            total, largest = _limits(own.shape[-1], p)
            found |= (own.sum(axis=-1) > total) | (own.max(axis=-1) > largest)
        return found


@cache
def _limits(axes: int, p: float) -> tuple[float, float]:
    """χ² of so many axes that is improbable, and the largest of their squares that is."""
    return float(chdtri(axes, p)), float(chdtri(1, p / axes))


def settled_part(
    stretch: Stretch,
    begin: int,
    end: int,
    origin: int,
    shortest: int,
    *,
    left: Left | None,
    rough: bool,
) -> Settled | None:
    """Cut both ends of [begin, end) until they fit the rest; None where nothing is left.

    Then further until what remains of a decay shifts no mean by more than a fraction of its se: a
    tail too small to see in itself still shifts a long mean, so the decay is measured where it is
    visible, y = c + a e^{−t/τ} with one τ for all axes, and extrapolated.

    origin : bin where the NCPs came to rest. shortest : bins. left : bias that ringing may leave.
    rough : leave it at what is seen, without extrapolating a decay.
    """
    at_begin = True
    while end - begin >= shortest:
        head, tail = _misfits(stretch, begin, end)
        at_begin = at_begin and head > 0  # once it fits, only the end is cut
        if at_begin:
            begin += max(1, head // 2, (end - begin) // _STEP)
        elif tail:
            end -= max(1, tail // 2, (end - begin) // _STEP)
        else:
            break
    if end - begin < shortest:
        return None
    visible = begin - (begin - origin) // 2
    decay = None if rough else _fit_decay(stretch, visible, end)
    if decay is None and left is None:
        return Settled(begin, end)
    long_run = stretch.long_run[stretch.forces :]
    start = np.arange(begin, max(end - shortest, begin) + 1)
    length = end - start
    square = np.zeros(len(start))
    if decay is not None:
        tau, size = decay
        worst = np.divide(size, long_run, out=np.zeros_like(size), where=long_run > 0).max()
        # Σ e^{−t/τ} over [start, end), over the standard error of a sum of as many bins.
        total = np.exp(-(start - visible) / tau) * -np.expm1(-length / tau) / -np.expm1(-1.0 / tau)
        square += (worst * total) ** 2 / length
    if left is not None:
        bias = left(start, end)
        relative = np.divide(bias, long_run, out=np.zeros_like(bias), where=long_run > 0)
        square += relative.max(axis=1) ** 2 * length
    ratio = np.sqrt(square)
    # Least mean square error of the mean, (1 + ratio²) / length, among the starts that will do.
    error = np.where(ratio <= max(_BIAS, ratio.min()), (1.0 + square) / length, np.inf)
    best = int(np.argmin(error))
    return Settled(int(start[best]), end, float(ratio[best]))


def one_level(stretch: Stretch, a: Settled | Extent, b: Settled | Extent, p: float) -> bool:
    """Are the means of two stretches one level?"""
    difference = stretch.mean(b.begin, b.end) - stretch.mean(a.begin, a.end)
    variance = stretch.noise.of_mean(a.end - a.begin) ** 2
    variance = variance + stretch.noise.of_mean(b.end - b.begin) ** 2
    return not bool(stretch.misfit(difference, variance, p))


def _misfits(stretch: Stretch, begin: int, end: int) -> tuple[int, int]:
    """Shortest windows at the begin and at the end that do not fit the other half; 0 if all do."""
    middle = (begin + end) // 2
    lengths = _LENGTHS[: max(((end - begin) // 4).bit_length(), 1)]
    many = len(lengths)
    at = np.concatenate([begin + lengths, end - lengths, (begin, middle, end)]) - stretch.start
    total = stretch.total[at]
    first, half, last = total[2 * many :]
    windows = np.empty((2, many, len(first)))
    windows[0] = (total[:many] - first) / lengths[:, None] - (last - half) / (end - middle)
    windows[1] = (last - total[many : 2 * many]) / lengths[:, None]
    windows[1] -= (half - first) / (middle - begin)
    variance = stretch.noise.of_part(lengths, middle - begin)
    misfit = stretch.misfit(windows, variance, SETTLING_CUT)
    head, tail = np.where(misfit.any(axis=1), lengths[misfit.argmax(axis=1)], 0).tolist()
    return head, tail


def _fit_decay(stretch: Stretch, begin: int, end: int) -> tuple[float, FloatArray] | None:
    """Time constant, bins, and sizes (A,) at `begin`, N, of the forces' decay in [begin, end).

    None where there is none that the noise does not explain.
    """
    value = stretch.value[stretch.forces :, begin - stretch.start : end - stretch.start]
    long_run = stretch.long_run[stretch.forces :]
    noisy = long_run > 0
    length = value.shape[1]
    if length < 8 or not noisy.any():
        return None
    scaled = (value[noisy] - value[noisy].mean(axis=1, keepdims=True)) / long_run[noisy, None]
    longest = min(_SLOWEST / stretch.width, 2.0 * length)
    tau, shapes, size = _decays(1.0, longest, length)
    least = chdtri(int(noisy.sum()), SETTLING_DECAY)
    gain = ((scaled @ shapes.T) ** 2).sum(axis=0)
    best = int(np.argmax(gain))
    if gain[best] < 0.8 * least:  # no refinement gains more
        return None
    shorter, longer = tau[max(best - 1, 0)], tau[min(best + 1, _CONSTANTS - 1)]
    tau, shapes, size = _decays(float(shorter), float(longer), length)
    gain = ((scaled @ shapes.T) ** 2).sum(axis=0)
    best = int(np.argmax(gain))
    # Vibration leaves more in a window of this length than in a long one.
    window = max(int(tau[best]), 1)
    sigma = stretch.noise.of_mean(window)[stretch.forces :][noisy] * np.sqrt(window)
    excess = max(float(np.median(sigma / long_run[noisy])), 1.0)
    if gain[best] < excess**2 * least:
        return None
    centred = value - value.mean(axis=1, keepdims=True)
    return float(tau[best]), np.abs(centred @ shapes[best] / size[best])


@lru_cache(maxsize=16)  # stops are of few lengths
def _decays(shortest: float, longest: float, length: int) -> tuple[FloatArray, ...]:
    """Time constants (τ,) in steps of one factor, e^{−t/τ} less its mean over `length` bins and
    divided by its size, (τ, length), and that size, (τ,).
    """
    tau = shortest * (longest / shortest) ** np.linspace(0.0, 1.0, _CONSTANTS)
    shape = np.exp(-np.arange(length) / tau[:, None])
    shape -= shape.mean(axis=1, keepdims=True)
    size = np.sqrt((shape**2).sum(axis=1))
    return tau, shape / size[:, None], size
