"""Spectral density of a dwell's noise at frequency zero, from the bins of many dwells.

Each run's bin means (each weighted by √samples, so that white noise has ordinates of expectation σ²
whatever the bins hold) are cosine-transformed, which gives independent ordinates of the spectrum.
Orders 0 and 1 are the mean and the drift; the others are averaged from the lowest frequency
upwards, by octaves, as long as a wider band agrees with all narrower ones (Lepski's rule). White
noise uses the whole band, correlated noise only where its spectrum is flat. Of short stops the same
is tried after dividing by the shape of white noise plus a first-order autoregression, fitted to the
first autocovariances, and the wider band wins.

Noise that is slower than a stop has no flat band there. A mean scatters by what lies below the
lowest frequency that a stop shows, so where it fits all the band, a fitted spectrum is carried on
(`slow_noise`): white noise with one relaxation (a first-order autoregression), or with 1/f noise,
each as likely as Whittle's likelihood has it. Means of 1/f noise of spectral density A/f over stops
of length T scatter over a campaign of length C by A ln(C/T); what is slower is the zero's.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from tdfscal.dwells.bins import Bins
from tdfscal.frozen import record
from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import SLOW_NOISE

_SHORTEST_RUN = 6  # bins; shorter pieces of a dwell carry no spectrum
_BASE_ORDINATES = 40  # in the narrowest band
_UNBINNED = 0.125  # cycles per bin up to which means over bins have the spectrum of the noise
_SHOWS_SLOW = 64  # bins; in shorter runs what is left of ringing looks like slow noise
_LEPSKI = 2.8  # standard deviations of disagreement that end the widening
_PER_OCTAVE = 6  # bands in which ordinates are averaged
_RELAXATIONS = 31  # time constants tried
_UNLIKELY = 1e-4
_FEWEST = 40  # ordinates
_RATIOS = np.geomspace(1e-2, 1e5, 43)  # of the slow part to the white one, at the lowest frequency


@record
class Spectrum:
    """Noise of one uninterrupted run of bins, line removed, all streams.

    frequency : (M,), cycles per bin. amplitude : (S, 3, M), cosine transform from order 2 on.
    covariance : (3, S, 3), mean products at lags 0, 1, 2. length : bins.
    """

    frequency: FloatArray
    amplitude: FloatArray
    covariance: FloatArray
    length: int


def spectrum(bins: Bins, rows: slice) -> Spectrum | None:
    """Spectrum of consecutive bins; None where they are too few."""
    length = rows.stop - rows.start
    if length < _SHORTEST_RUN:
        return None
    weight = bins.count[rows].T.astype(np.float64)[:, None]  # (S, 1, M)
    x = np.where(weight > 0, bins.mean[rows].transpose(1, 2, 0), 0.0)
    x -= x.max(axis=2, keepdims=True)  # keeps the digits; empty bins have no weight
    total = weight.sum(axis=2, keepdims=True)
    line = np.linspace(-1.0, 1.0, length)
    line = line - (weight * line).sum(axis=2, keepdims=True) / total
    slope = weight * line
    x -= (weight * x).sum(axis=2, keepdims=True) / total
    x -= line * ((slope * x).sum(axis=2, keepdims=True) / (slope * line).sum(axis=2, keepdims=True))
    x *= np.sqrt(weight)
    lags = [np.einsum("sam,sam->sa", x[..., k:], x[..., : length - k]) for k in range(3)]
    lags = [products / (length - k) for k, products in enumerate(lags)]
    order = np.arange(2, length)
    # The cosine transform as half of a Fourier transform of twice the length (Makhoul 1980).
    turn = np.sqrt(2.0 / length) * np.exp(-0.5j * np.pi * order / length)
    amplitude = (np.fft.rfft(x, 2 * length, axis=2)[..., 2:length] * turn).real
    return Spectrum(order / (2.0 * length), amplitude, np.stack(lags), length)


def _shape(raw: FloatArray, length: float, frequency: FloatArray) -> FloatArray:
    """(S, 3, F), the spectrum that autocovariances (3 lags, S, 3) tell, relative to that at 0.

    raw : of dwells of mean length, bins, without their lines.
    """
    covariance = raw
    for _ in range(3):
        # A fitted line takes two ordinates of the lowest frequencies out of each dwell.
        lost = 2.0 * _rational_spectrum(covariance, np.zeros(1))[..., 0] / length
        covariance = raw + np.minimum(lost, 0.5 * raw[0])
    shape = _rational_spectrum(covariance, np.append(0.0, frequency))
    one = np.ones_like(shape[..., 1:])
    return np.asarray(np.divide(shape[..., 1:], shape[..., :1], out=one, where=shape[..., :1] > 0))


def _rational_spectrum(covariance: FloatArray, frequency: FloatArray) -> FloatArray:
    """(S, 3, F), spectrum of white noise plus a first-order autoregression, from lags 0, 1, 2.

    Also that of an autoregression averaged over bins, which is of the same form (the white part is
    then negative). White where lag 1 says nothing of a pole.
    """
    zero, one, two = covariance[..., None]
    pole = np.divide(two, one, out=np.zeros_like(one), where=(one > 0) & (two > 0))
    pole = np.minimum(pole, 0.98)
    red = np.divide(one, pole, out=np.zeros_like(one), where=pole > 0)
    red = np.minimum(red, 2.0 * zero)
    turn = 1 - 2 * pole * np.cos(2 * np.pi * frequency) + pole**2
    return np.asarray(np.maximum(zero - red + red * (1 - pole**2) / turn, 1e-3 * zero))


@record
class Ordinates:
    """Spectra of several runs together, in the order of frequency.

    frequency : (F,). amplitude : (S, 3, F). shape : (S, 3, F), of short runs the spectrum that
    their autocovariances tell, relative to that at 0; None of longer ones. slow : (S, 3), of
    longer ones the fitted spectrum where the noise is slower than a run.
    """

    frequency: FloatArray
    amplitude: FloatArray
    shape: FloatArray | None
    slow: list[list[SlowNoise | None]]


def together(spectra: Sequence[Spectrum]) -> Ordinates | None:
    """None where there is too little to see a density in."""
    if sum(len(one.frequency) for one in spectra) < _SHORTEST_RUN:
        return None
    frequency = np.concatenate([one.frequency for one in spectra])
    order = np.argsort(frequency, kind="stable")
    frequency = frequency[order]
    amplitude = np.concatenate([one.amplitude for one in spectra], axis=2)[..., order]
    lengths = np.array([one.length for one in spectra])
    covariance = np.average([one.covariance for one in spectra], axis=0, weights=lengths)
    length = float(lengths.mean())
    if length < _SHOWS_SLOW:
        none: list[list[SlowNoise | None]] = [[None] * 3 for _ in amplitude]
        return Ordinates(frequency, amplitude, _shape(covariance, length, frequency), none)
    # Axes of one kind together: positions, then forces.
    low, kinds = int(np.searchsorted(frequency, _UNBINNED)), list[SlowNoise | None]()
    for kind in np.split(amplitude[..., :low] ** 2, 2):
        power = kind.reshape(-1, low)
        slow = slow_noise(frequency[:low], power, length)
        flat = [
            _widest_flat_band(frequency[:low], own / one.spectrum(frequency[:low]))[1] == low
            for own, one in zip(power, slow, strict=True)
            if one is not None
        ]
        # Else vibration, or something else.
        kinds += slow if sum(flat) > len(flat) / 2 else [None] * len(slow)
    each = [kinds[k : k + 3] for k in range(0, len(kinds), 3)]
    return Ordinates(frequency, amplitude, None, each)


def density(
    found: Ordinates | None, stream: int, pooled: FloatArray, length: IntArray, campaign: float
) -> FloatArray:
    """(K, 3, 3), spectral density of a stream per sample as it counts in means of K dwells.

    found : of dwells with common scatter. pooled : (3,), their sample variance, which stands in
    where there is too little. length : (K,), of the dwells, campaign : of the log, bins.
    """
    if found is None:
        return np.broadcast_to(np.diag(pooled), (len(length), 3, 3))
    amplitude = found.amplitude[stream]
    level, width = np.zeros((len(length), 3)), np.zeros(3, dtype=np.int64)
    for axis, slow in enumerate(found.slow[stream]):
        # The level at 0, from as many ordinates as are flat, as they are or less their shape.
        power = amplitude[axis] ** 2
        level[:, axis], width[axis] = _widest_flat_band(found.frequency, power)
        if found.shape is not None:
            flat, wide = _widest_flat_band(found.frequency, power / found.shape[stream, axis])
            if wide > width[axis]:
                level[:, axis], width[axis] = flat, wide
        if slow is not None:
            level[:, axis] = slow.of_mean(length, campaign)
    band = amplitude[:, : int(width.min())]
    product = band @ band.T
    scale = np.sqrt(np.diagonal(product))
    correlation = np.divide(
        product, np.outer(scale, scale), out=np.eye(3), where=np.outer(scale, scale) > 0
    )
    root = np.sqrt(level)
    return np.asarray(correlation * root[:, :, None] * root[:, None, :])


def _widest_flat_band(frequency: FloatArray, power: FloatArray) -> tuple[float, int]:
    """Lepski's rule over bands from 0 to f, f doubling; (mean power, ordinates)."""
    cumulative = np.cumsum(power)
    size = min(_BASE_ORDINATES, len(power))
    sizes, means = [size], [float(cumulative[size - 1] / size)]
    limit = float(frequency[size - 1])
    while sizes[-1] < len(power):
        limit *= 2.0
        size = int(np.searchsorted(frequency, limit, side="right"))
        if size <= sizes[-1]:
            continue
        mean = float(cumulative[size - 1] / size)
        # Difference of nested means: variance of the narrower less that of the wider.
        for narrow, known in zip(sizes, means, strict=True):
            spread = np.sqrt(2.0 / narrow - 2.0 / size) * max(known, mean)
            if abs(mean - known) > _LEPSKI * spread:
                return means[-1], sizes[-1]
        sizes.append(size)
        means.append(mean)
    return means[-1], sizes[-1]


@record
class SlowNoise:
    """Two-sided spectra white + slow · shape(f), f in cycles per bin, per sample, N², G of them.

    relaxation : (G,), bins, of the shape of an autoregression of variance 1; ∞: the shape is 1/f.
    weight : (G,), how likely each is.
    """

    white: FloatArray
    slow: FloatArray
    relaxation: FloatArray
    weight: FloatArray

    def spectrum(self, frequency: FloatArray) -> FloatArray:
        """The likeliest at frequencies (F,), cycles per bin."""
        k = int(np.argmax(self.weight))
        shape = _shapes(tuple(self.relaxation[k : k + 1]), tuple(frequency.tolist()))[0]
        return np.asarray(self.white[k] + self.slow[k] * shape)

    def of_mean(self, length: IntArray, campaign: float) -> FloatArray:
        """Variance to expect of means over so many bins (K,) times that length."""
        T = np.asarray(length, dtype=np.float64)[:, None]
        forever = np.isinf(self.relaxation)
        pole = np.where(forever, 0.0, np.exp(-1.0 / self.relaxation))
        end = 2.0 * pole * (1.0 - pole**T) / (T * (1.0 - pole) ** 2)
        relaxed = (1.0 + pole) / (1.0 - pole) - end
        flicker = 2.0 * T * np.log(np.maximum(campaign / T, 1.0))
        reach = np.where(forever, flicker, relaxed)
        return np.asarray((self.white + self.slow * reach) @ self.weight)


def slow_noise(frequency: FloatArray, power: FloatArray, length: float) -> list[SlowNoise | None]:
    """Fit squared ordinates (A, F) of axes of one kind at ascending frequencies, each axis alone.

    Axes share what is slow, and how it compares with the white noise. None where white noise is
    about as likely. length : of a stop, bins; what relaxes slower looks like this or 1/f noise.
    """
    alive = power.any(axis=1)
    found: list[SlowNoise | None] = [None] * len(power)
    if power.shape[1] < _FEWEST or not alive.any():
        return found
    power = power[alive]
    octave = np.floor(_PER_OCTAVE * np.log2(frequency / frequency[0]))
    first = np.flatnonzero(np.diff(octave, prepend=-1.0))
    count = np.diff(np.append(first, power.shape[1]))
    middle = np.add.reduceat(frequency, first) / count
    mean, share = np.add.reduceat(power, first, axis=1) / count, count / count.sum()
    taus = (np.inf, *np.geomspace(0.5, max(length, 1.0), _RELAXATIONS).tolist())
    slow = _shapes(taus, tuple(middle.tolist()))
    shape = 1.0 + _RATIOS[:, None] * (slow / slow[:, :1])[:, None]  # (M, R, B)
    # −2 ln L = N ln σ² + Σ ln shape, σ² the mean of power / shape.
    white = np.einsum("ab,mrb->mra", mean * share, 1.0 / shape)
    cost = power.shape[1] * (np.log(white) + (np.log(shape) @ share)[..., None])
    plain = float(power.shape[1] * np.log(mean @ share).sum())
    least = float(cost.min(axis=1).sum(axis=1).min())
    if plain - least <= SLOW_NOISE:
        return found
    # 1/f noise, the first model, is as likely before as all relaxations.
    before = 2.0 * np.log(len(cost) - 1.0) * (np.arange(len(cost)) > 0)
    alike = cost.sum(axis=2) + before[:, None]
    weight = np.exp(-0.5 * (alike - alike.min()))
    m, r = np.nonzero(weight > _UNLIKELY * weight.sum())
    likely = weight[m, r]
    for axis, place in enumerate(np.flatnonzero(alive)):
        level = white[m, r, axis]
        found[place] = SlowNoise(
            level, level * _RATIOS[r] / slow[m, 0], np.array(taus)[m], likely / likely.sum()
        )
    return found


@lru_cache(maxsize=8)
def _shapes(relaxation: tuple[float, ...], frequency: tuple[float, ...]) -> FloatArray:
    """Spectra (M, F) of what may be slow: relaxations, or 1/f where it is ∞."""
    f, tau = np.array(frequency), np.array(relaxation)[:, None]
    pole = np.where(np.isinf(tau), 0.0, np.exp(-1.0 / tau))
    relaxed = (1.0 - pole**2) / (1.0 - 2.0 * pole * np.cos(2.0 * np.pi * f) + pole**2)
    return np.asarray(np.where(np.isinf(tau), 1.0 / f, relaxed))
