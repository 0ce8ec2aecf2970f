"""Settling: how much to cut from the ends of a stretch that still rings or already moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from tdfscal.dwells.changes import Noise
from tdfscal.records import BoolArray, FloatArray, IntArray

_P_MISFIT = 3e-3  # false cut per test
_P_DECAY = 1e-4  # false decay per stretch
_SLOWEST = 10.0  # s; a time constant beyond is called drift
_BIAS = 0.5  # largest bias of the mean / its standard error where the stop is long enough
_WANDER = 5.0  # standard deviations
_STEP = 50  # a cut advances by at least this fraction of what is left
_CONSTANTS = 24  # time constants tried


@dataclass(frozen=True, slots=True)
class Decay:
    """amplitude · e^{−(t − begin)/τ}: begin, tau in bins, amplitude (A,) of the force axes in N."""

    begin: int
    tau: float
    amplitude: FloatArray


@dataclass(frozen=True, slots=True)
class Settled:
    """A settled stretch [begin, end) in bins; ratio: bias to expect / standard error, worst axis.

    decay : what settled before it, where that was seen.
    """

    begin: int
    end: int
    ratio: float = 0.0
    decay: Decay | None = None


@dataclass(frozen=True, slots=True)
class Stretch:
    """All axes over the bins, with what is needed to compare the means of stretches.

    value : (A, B). total : (B + 1, A), prefix sums about `origin`. noise : of A axes.
    force : the axes that settle (the others are positions). long_run : (A,), standard deviation
    of a bin as it counts in a long mean: Var(mean of T bins) = long_run² / T. width : s.
    tolerance : (A,), difference of means that resolution and rounding explain.
    """

    value: FloatArray
    origin: FloatArray
    total: FloatArray
    noise: Noise
    force: slice
    long_run: FloatArray
    width: float
    tolerance: FloatArray

    @classmethod
    def of(
        cls, value: FloatArray, noise: Noise, force: slice, long_run: FloatArray, width: float
    ) -> Stretch:
        """With the prefix sums of value."""
        origin = np.median(value, axis=1)
        total = np.zeros((len(value), value.shape[1] + 1))
        np.cumsum(value - origin[:, None], axis=1, out=total[:, 1:])
        total = total.T
        scale = np.abs(total).max(axis=0, initial=0.0) + np.abs(origin)
        tolerance = 1.001 * noise.quantum + 64 * np.finfo(np.float64).eps * scale
        return cls(value, origin, total, noise, force, long_run, width, tolerance)

    def mean(self, begin: IntArray | int, end: IntArray | int) -> FloatArray:
        """Means about `origin`, (..., A)."""
        length = np.asarray(end) - np.asarray(begin)
        return np.asarray((self.total[end] - self.total[begin]) / length[..., None])

    def louder(self, factor: FloatArray) -> Stretch:
        """With the noise of each axis (A,) times a factor."""
        if np.all(factor == 1.0):
            return self
        return replace(self, noise=self.noise.times(factor), long_run=self.long_run * factor)

    def misfit(self, difference: FloatArray, variance: FloatArray, p: float) -> BoolArray:
        """Does a difference of means (..., A) contradict the noise, with false alarm p?

        Positions and forces apart; the sum of squares sees what all axes share, the largest one
        what a single axis has.
        """
        excess = np.maximum(np.abs(difference) - self.tolerance, 0.0)
        z2 = np.divide(excess**2, variance, out=np.zeros_like(excess), where=variance > 0)
        z2[(variance == 0) & (excess > 0)] = np.inf
        still = np.ones(z2.shape[-1], dtype=np.bool_)
        still[self.force] = False
        return np.logical_or(_too_large(z2[..., still], p), _too_large(z2[..., ~still], p))


def _too_large(z2: FloatArray, p: float) -> BoolArray:
    """Squares of standard normal axes (..., A) whose sum or largest one is improbable."""
    axes = z2.shape[-1]
    return np.asarray((z2.sum(axis=-1) > chdtri(axes, p)) | (z2.max(axis=-1) > chdtri(1, p / axes)))


def settled_part(
    stretch: Stretch, begin: int, end: int, origin: int, shortest: int, *, rough: bool
) -> Settled | None:
    """Cut both ends of [begin, end) until they fit the rest; None where nothing is left.

    origin : bin where the NCPs came to rest. shortest : bins. rough : leave it at what is seen,
    without extrapolating a decay.
    """
    while end - begin >= shortest and (cut := _misfit(stretch, begin, end, tail=False)):
        begin += max(1, cut // 2, (end - begin) // _STEP)
    while end - begin >= shortest and (cut := _misfit(stretch, begin, end, tail=True)):
        end -= max(1, cut // 2, (end - begin) // _STEP)
    if end - begin < shortest:
        return None
    if rough:
        return Settled(begin, end)
    return _without_decay(stretch, begin, end, begin - (begin - origin) // 2, shortest)


def one_level(stretch: Stretch, a: Settled, b: Settled, p: float) -> bool:
    """Are the means of two stretches one level?"""
    difference = stretch.mean(b.begin, b.end) - stretch.mean(a.begin, a.end)
    variance = stretch.noise.of_mean(a.end - a.begin) ** 2
    variance = variance + stretch.noise.of_mean(b.end - b.begin) ** 2
    return not bool(stretch.misfit(difference, variance, p))


def restless(stretch: Stretch, part: Settled) -> bool:
    """Does the level wander more than the noise: an oscillation below the threshold of a change?"""
    for scale in range(len(stretch.noise.difference)):
        width = 2**scale
        start = np.arange(part.begin, part.end - 2 * width + 1, max(width // 2, 1))
        if len(start) < 2:
            break
        difference = stretch.mean(start + width, start + 2 * width)
        difference = difference - stretch.mean(start, start + width)
        excess = np.maximum(np.abs(difference) - stretch.tolerance, 0.0)[:, stretch.force]
        variance = 2.0 * stretch.noise.of_mean(width)[stretch.force] ** 2
        z2 = np.divide(excess**2, variance, out=np.zeros_like(excess), where=variance > 0)
        independent = max((part.end - part.begin) / (2.0 * width), 1.0) * z2.shape[1]
        if z2.mean() > 1.0 + _WANDER * np.sqrt(2.0 / independent):
            return True
    return False


def _misfit(stretch: Stretch, begin: int, end: int, *, tail: bool) -> int:
    """Shortest window at the begin (tail: at the end) that does not fit the other half; or 0."""
    middle = (begin + end) // 2
    lengths = 2 ** np.arange(max(int(np.log2(max((end - begin) // 4, 1))) + 1, 1))
    if tail:
        reference, held = stretch.mean(begin, middle), middle - begin
        window = stretch.mean(end - lengths, np.full_like(lengths, end))
    else:
        reference, held = stretch.mean(middle, end), end - middle
        window = stretch.mean(np.full_like(lengths, begin), begin + lengths)
    variance = stretch.noise.of_mean(lengths) ** 2 + stretch.noise.of_mean(held) ** 2
    misfit = stretch.misfit(window - reference, variance, _P_MISFIT)
    return int(lengths[np.argmax(misfit)]) if misfit.any() else 0


def _without_decay(stretch: Stretch, begin: int, end: int, visible: int, shortest: int) -> Settled:
    """Cut further until what remains of a decay shifts no mean by more than a fraction of its se.

    A tail too small to see in itself still shifts a long mean, so the decay is measured where it
    is visible: y = c + a e^{−t/τ} from bin `visible` on, one τ for all axes, and extrapolated.
    """
    long_run = stretch.long_run[stretch.force]
    fitted = _fit_decay(stretch, visible, end)
    if fitted is None:
        return Settled(begin, end)
    tau = fitted.tau
    size = np.abs(fitted.amplitude)
    worst = np.divide(size, long_run, out=np.zeros_like(size), where=long_run > 0).max()
    start = np.arange(begin, max(end - shortest, begin) + 1)
    length = end - start
    # Σ e^{−t/τ} over [start, end), over the standard error of a sum of as many bins.
    decay = np.exp(-(start - visible) / tau) * -np.expm1(-length / tau) / -np.expm1(-1.0 / tau)
    ratio = worst * decay / np.sqrt(length)
    # Least mean square error of the mean, (1 + ratio²) / length, among the starts that will do.
    error = np.where(ratio <= max(_BIAS, ratio.min()), (1.0 + ratio**2) / length, np.inf)
    best = int(np.argmin(error))
    return Settled(int(start[best]), end, float(ratio[best]), fitted)


def one_decay(stretch: Stretch, earlier: Settled, later: Settled) -> bool:
    """Is the earlier level what the decay that ends in the later one had then?

    A decay slow enough looks like a level for a while.
    """
    if later.decay is None:
        return False
    seen = stretch.mean(earlier.begin, earlier.end) - stretch.mean(later.begin, later.end)
    middle = 0.5 * (earlier.begin + earlier.end)
    expected = np.exp((later.decay.begin - middle) / later.decay.tau) * later.decay.amplitude
    scale = stretch.long_run[stretch.force]
    seen, expected = (
        np.divide(x, scale, out=np.zeros_like(x), where=scale > 0)
        for x in (seen[stretch.force], expected)
    )
    across, share = seen @ expected, expected @ expected
    return bool(across > 0.9 * np.sqrt((seen @ seen) * share) and 0.5 < across / share < 2.0)


def _fit_decay(stretch: Stretch, begin: int, end: int) -> Decay | None:
    """The decay in bins [begin, end); None where there is none that the noise does not explain."""
    value = stretch.value[stretch.force, begin:end]
    long_run = stretch.long_run[stretch.force]
    noisy = long_run > 0
    length = value.shape[1]
    if length < 8 or not noisy.any():
        return None
    scaled = (value[noisy] - value[noisy].mean(axis=1, keepdims=True)) / long_run[noisy, None]
    tau = np.geomspace(1.0, min(_SLOWEST / stretch.width, 2.0 * length), _CONSTANTS)
    least = chdtri(int(noisy.sum()), _P_DECAY)
    gain = _gain(scaled, tau)
    best = int(np.argmax(gain))
    if gain[best] < 0.8 * least:  # no refinement gains more
        return None
    tau = np.geomspace(tau[max(best - 1, 0)], tau[min(best + 1, _CONSTANTS - 1)], _CONSTANTS)
    gain = _gain(scaled, tau)
    best = int(np.argmax(gain))
    # Vibration leaves more in a window of this length than in a long one.
    window = max(int(tau[best]), 1)
    sigma = stretch.noise.of_mean(window)[stretch.force][noisy] * np.sqrt(window)
    excess = max(float(np.median(sigma / long_run[noisy])), 1.0)
    if gain[best] < excess**2 * least:
        return None
    shape = _shapes(tau[best : best + 1], length)[0]
    amplitude = (value - value.mean(axis=1, keepdims=True)) @ shape / (shape @ shape)
    return Decay(begin, float(tau[best]), np.asarray(amplitude))


def _shapes(tau: FloatArray, length: int) -> FloatArray:
    """e^{−t/τ} less its mean, (τ, length)."""
    shape = np.exp(-np.arange(length) / tau[:, None])
    return np.asarray(shape - shape.mean(axis=1, keepdims=True))


def _gain(scaled: FloatArray, tau: FloatArray) -> FloatArray:
    """Sum of squares (τ,) of noise of variance 1 that each time constant explains."""
    shape = _shapes(tau, scaled.shape[1])
    return np.asarray(((scaled @ shape.T) ** 2).sum(axis=0) / (shape**2).sum(axis=1))
