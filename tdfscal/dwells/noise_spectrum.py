"""Spectral density of a dwell's noise at frequency zero, from the bins of many dwells.

Each run's bin means (each weighted by √samples, so that white noise has ordinates of expectation σ²
whatever the bins hold) are cosine-transformed, which gives independent ordinates of the spectrum.
Orders 0 and 1 are the mean and the drift; the others are averaged from the lowest frequency
upwards, by octaves, as long as a wider band agrees with all narrower ones (Lepski's rule). White
noise uses the whole band, correlated noise only where its spectrum is flat. The same is tried after
dividing by the shape of white noise plus a first-order autoregression, fitted to the first
autocovariances, and the wider band wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.dwells.bins import Bins
from tdfscal.records import FloatArray

_SHORTEST_RUN = 6  # bins; shorter pieces of a dwell carry no spectrum
_BASE_ORDINATES = 40  # in the narrowest band
_FASTEST, _TRIED = 0.05, 13  # corner, cycles per bin, and values tried, of what axes share
_BAND = 0.1  # of the frequency's logarithm, within which ordinates are one
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
    length : mean of those, bins.
    """

    frequency: FloatArray
    amplitude: FloatArray
    covariance: FloatArray
    length: float


def together(spectra: Sequence[Spectrum]) -> Ordinates | None:
    """None where there is too little to see a density in."""
    if sum(len(one.frequency) for one in spectra) < _SHORTEST_RUN:
        return None
    frequency = np.concatenate([one.frequency for one in spectra])
    order = np.argsort(frequency, kind="stable")
    amplitude = np.concatenate([one.amplitude for one in spectra], axis=2)[..., order]
    length = np.array([one.length for one in spectra])
    covariance = np.average([one.covariance for one in spectra], axis=0, weights=length)
    return Ordinates(frequency[order], amplitude, covariance, float(length.mean()))


def density(found: Ordinates | None, stream: int, pooled: FloatArray) -> FloatArray:
    """(3, 3), spectral density of a stream at frequency zero per sample.

    found : of dwells with common scatter. pooled : (3,), their sample variance, which stands in
    where there is too little.
    """
    if found is None:
        return np.diag(pooled)
    frequency, amplitude = found.frequency, found.amplitude[stream]
    covariance = _autocovariance(found.covariance[:, stream], found.length)
    level, width = np.zeros(3), np.zeros(3, dtype=np.int64)
    shape, common = _shape(covariance, frequency), _common_shape(found, stream)
    for axis in range(3):
        level[axis], width[axis] = _zero_frequency(
            frequency, amplitude[axis] ** 2, shape[:, axis], common
        )
    band = amplitude[:, : int(width.min())]
    product = band @ band.T
    scale = np.sqrt(np.diagonal(product))
    correlation = np.divide(
        product, np.outer(scale, scale), out=np.eye(3), where=np.outer(scale, scale) > 0
    )
    root = np.sqrt(level)
    return np.asarray(correlation * np.outer(root, root))


def _shape(covariance: FloatArray, frequency: FloatArray) -> FloatArray:
    """(F, 3), the fitted spectrum relative to its value at frequency 0."""
    shape = _rational_spectrum(covariance, np.concatenate([[0.0], frequency]))
    one = np.ones_like(shape[1:])
    return np.asarray(np.divide(shape[1:], shape[0], out=one, where=shape[0] > 0))


def _common_shape(found: Ordinates, stream: int) -> FloatArray | None:
    """(F,), spectrum of all streams of one kind relative to what a mean sees; None where white.

    Noise as slow as a dwell shows in a few ordinates, by which an axis alone is taken for white or
    for red as chance has it; all axes together, each at unit power, know better.
    """
    half = found.amplitude.shape[0] // 2  # positions, then forces
    alike = slice(0, half) if stream < half else slice(half, None)
    power = (found.amplitude[alike] ** 2).reshape(-1, len(found.frequency))
    mean = power.mean(axis=1)
    seen = mean > 0
    if seen.sum() < 2:
        return None
    together = np.asarray((power[seen] / mean[seen, None]).mean(axis=0))
    if _widest_flat_band(found.frequency, together, int(seen.sum()))[1] == len(together):
        return None
    return _expected(found.frequency, together, int(seen.sum()), found.length)


def _expected(frequency: FloatArray, power: FloatArray, streams: int, length: float) -> FloatArray:
    """(F,), spectrum of white noise and a first-order autoregression relative to what a mean sees.

    Expected over corner and share by their likelihood (Whittle), since what lies below the lowest
    ordinate is extrapolated. power : (F,), mean of streams. length : of a mean, bins.
    """
    corner, share = np.meshgrid(
        np.geomspace(1 / (2 * np.pi * length), _FASTEST, _TRIED), np.geomspace(0.1, 1e3, _TRIED)
    )
    corner, share = corner.reshape(-1, 1), share.reshape(-1, 1)
    low = np.linspace(0, 3 / length, 61)
    passed = np.sinc(low * length) ** 2
    into_mean = 1 + share * (1 / (1 + (low / corner) ** 2) @ passed / passed.sum())[:, None]
    _, band = np.unique(np.floor(np.log(frequency) / _BAND), return_inverse=True)
    count = np.bincount(band)
    f, p = (np.bincount(band, values) / count for values in (frequency, power))
    tried = 1 + share / (1 + (f / corner) ** 2)
    cost = np.log(tried) @ count + count.sum() * np.log((p / tried) @ count)
    likely = np.exp(-0.5 * streams * (cost - cost.min()))
    ratio = likely @ (into_mean / tried) / likely.sum()
    return np.asarray(1 / ratio[band])


def _zero_frequency(
    frequency: FloatArray, power: FloatArray, shape: FloatArray, common: FloatArray | None
) -> tuple[float, int]:
    """Level of the spectrum at 0 and the number of ordinates behind it.

    shape : the fitted spectrum relative to its value at frequency 0; common : that of all streams.
    """
    plain = _widest_flat_band(frequency, power)
    whitened = _widest_flat_band(frequency, power / shape)
    best = whitened if whitened[1] > plain[1] else plain
    if common is not None:
        with_all = _widest_flat_band(frequency, power / common)
        best = with_all if with_all[1] >= best[1] else best
    return best


def _widest_flat_band(
    frequency: FloatArray, power: FloatArray, streams: int = 1
) -> tuple[float, int]:
    """Lepski's rule over bands from 0 to f, f doubling; (mean power, ordinates).

    streams : whose mean the power is.
    """
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
            spread = np.sqrt((2.0 / narrow - 2.0 / size) / streams) * max(known, mean)
            if abs(mean - known) > _LEPSKI * spread:
                return means[-1], sizes[-1]
        sizes.append(size)
        means.append(mean)
    return means[-1], sizes[-1]
