"""Spectral density of a dwell's noise at frequency zero, from the bins of many dwells.

Each run's bin means (each weighted by √samples, so that white noise has ordinates of expectation σ²
whatever the bins hold) are cosine-transformed, which gives independent ordinates of the spectrum.
Orders 0 and 1 are the mean and the drift; the others are averaged from the lowest frequency
upwards, by octaves, as long as a wider band agrees with all narrower ones (Lepski's rule). White
noise uses the whole band, correlated noise only where its spectrum is flat. The same is tried after
dividing by the shape of white noise plus a first-order autoregression, fitted to the first
autocovariances, and the wider band wins.

Noise that is slower than a stop has no flat band there; where its fitted spectrum is flat over all
the band (`slow_noise`), that is carried on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.dwells.bins import Bins
from tdfscal.dwells.slow_noise import SlowNoise, slow_noise
from tdfscal.records import FloatArray, IntArray

_SHORTEST_RUN = 6  # bins; shorter pieces of a dwell carry no spectrum
_BASE_ORDINATES = 40  # in the narrowest band
_UNBINNED = 0.125  # cycles per bin up to which means over bins have the spectrum of the noise
_CREST = 64  # bins; in shorter runs what is left of ringing looks like slow noise
_LEPSKI = 2.8  # standard deviations of disagreement that end the widening


@dataclass(frozen=True, slots=True)
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


def _autocovariance(raw: FloatArray, length: float) -> FloatArray:
    """Autocovariances (3 lags, 3) of the noise from those of detrended dwells of mean length."""
    covariance = raw
    for _ in range(3):
        # A fitted line takes two ordinates of the lowest frequencies out of each dwell.
        lost = 2.0 * _rational_spectrum(covariance, np.zeros(1))[0] / length
        covariance = raw + np.minimum(lost, 0.5 * raw[0])
    return covariance


def _rational_spectrum(covariance: FloatArray, frequency: FloatArray) -> FloatArray:
    """(F, 3), spectrum of white noise plus a first-order autoregression, from lags 0, 1, 2.

    Also that of an autoregression averaged over bins, which is of the same form (the white part is
    then negative). White where lag 1 says nothing of a pole.
    """
    zero, one, two = covariance
    pole = np.divide(two, one, out=np.zeros(3), where=(one > 0) & (two > 0))
    pole = np.minimum(pole, 0.98)
    red = np.divide(one, pole, out=np.zeros(3), where=pole > 0)
    red = np.minimum(red, 2.0 * zero)
    turn = 1 - 2 * pole * np.cos(2 * np.pi * frequency[:, None]) + pole**2
    spectrum = zero - red + red * (1 - pole**2) / turn
    return np.asarray(np.maximum(spectrum, 1e-3 * zero))


@dataclass(frozen=True, slots=True)
class Ordinates:
    """Spectra of several runs together, in the order of frequency.

    frequency : (F,). amplitude : (S, 3, F). covariance : (3, S, 3), weighted by the runs' lengths.
    length : mean of those, bins. slow : (S, 3), where the noise is slower than a run.
    """

    frequency: FloatArray
    amplitude: FloatArray
    covariance: FloatArray
    length: float
    slow: list[list[SlowNoise | None]]


def together(spectra: Sequence[Spectrum]) -> Ordinates | None:
    """None where there is too little to see a density in."""
    if sum(len(one.frequency) for one in spectra) < _SHORTEST_RUN:
        return None
    frequency = np.concatenate([one.frequency for one in spectra])
    order = np.argsort(frequency, kind="stable")
    amplitude = np.concatenate([one.amplitude for one in spectra], axis=2)[..., order]
    length = np.array([one.length for one in spectra])
    covariance = np.average([one.covariance for one in spectra], axis=0, weights=length)
    whole = Ordinates(frequency[order], amplitude, covariance, float(length.mean()), [])
    half = len(amplitude) // 2  # positions, then forces
    return replace(whole, slow=[*_slow(whole, 0, half), *_slow(whole, half, len(amplitude))])


def _slow(found: Ordinates, begin: int, end: int) -> list[list[SlowNoise | None]]:
    """Noise slower than a run, of each axis of streams of one kind, (S, 3)."""
    if found.length < _CREST:
        return [[None] * 3 for _ in range(begin, end)]
    low = slice(int(np.searchsorted(found.frequency, _UNBINNED)))
    frequency = found.frequency[low]
    power = (found.amplitude[begin:end, :, low] ** 2).reshape(3 * (end - begin), -1)
    rival = np.concatenate([_shape(found, stream)[low].T for stream in range(begin, end)])
    slow = slow_noise(frequency, power, rival, found.length)
    flat = [
        _widest_flat_band(frequency, own / one.spectrum(frequency))[1] == len(frequency)
        for own, one in zip(power, slow, strict=True)
        if one is not None
    ]
    if sum(flat) <= len(flat) / 2:  # vibration, or something else
        slow = [None] * len(slow)
    return [slow[k : k + 3] for k in range(0, len(slow), 3)]


def density(
    found: Ordinates | None, stream: int, pooled: FloatArray, length: IntArray, campaign: float
) -> FloatArray:
    """(K, 3, 3), spectral density of a stream per sample as it counts in means of K dwells.

    found : of dwells with common scatter. pooled : (3,), their sample variance, which stands in
    where there is too little. length : (K,), of the dwells, campaign : of the log, bins.
    """
    if found is None:
        return np.broadcast_to(np.diag(pooled), (len(length), 3, 3))
    amplitude, shape = found.amplitude[stream], _shape(found, stream)
    level, width = np.zeros((len(length), 3)), np.zeros(3, dtype=np.int64)
    for axis, slow in enumerate(found.slow[stream]):
        power = amplitude[axis] ** 2
        level[:, axis], width[axis] = _zero_frequency(found.frequency, power, shape[:, axis])
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


def _shape(found: Ordinates, stream: int) -> FloatArray:
    """(F, 3), the spectrum that a stream's autocovariances tell, relative to its value at 0."""
    covariance = _autocovariance(found.covariance[:, stream], found.length)
    shape = _rational_spectrum(covariance, np.concatenate([[0.0], found.frequency]))
    one = np.ones_like(shape[1:])
    return np.asarray(np.divide(shape[1:], shape[0], out=one, where=shape[0] > 0))


def _zero_frequency(
    frequency: FloatArray, power: FloatArray, shape: FloatArray
) -> tuple[float, int]:
    """Level of the spectrum at 0 and the number of ordinates behind it.

    shape : the fitted spectrum relative to its value at frequency 0.
    """
    plain = _widest_flat_band(frequency, power)
    whitened = _widest_flat_band(frequency, power / shape)
    return whitened if whitened[1] > plain[1] else plain


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
