"""Spectral density of a dwell's noise at frequency zero, from the bins of many dwells.

Each run's bin means (each weighted by √samples, so that white noise has ordinates of expectation σ²
whatever the bins hold) are cosine-transformed, which gives independent ordinates of the spectrum.
Orders 0 and 1 are the mean and the drift; the others are averaged from the lowest frequency
upwards, by octaves, as long as a wider band agrees with all narrower ones (Lepski's rule). White
noise uses the whole band, correlated noise only where its spectrum is flat. Of short stops the same
is tried after dividing by the shape of white noise plus a first-order autoregression, fitted to the
first autocovariances, and the wider band wins.

Noise that is slower than a stop has no flat band there; where its fitted spectrum fits all the band
(`slow_noise`), that is carried on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.dwells.bins import Bins
from tdfscal.dwells.slow_noise import SlowNoise, slow_noise
from tdfscal.records import FloatArray, IntArray

_SHORTEST_RUN = 6  # bins; shorter pieces of a dwell carry no spectrum
_BASE_ORDINATES = 40  # in the narrowest band
_UNBINNED = 0.125  # cycles per bin up to which means over bins have the spectrum of the noise
_SHOWS_SLOW = 64  # bins; in shorter runs what is left of ringing looks like slow noise
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


@dataclass(frozen=True, slots=True)
class Ordinates:
    """Spectra of several runs together, in the order of frequency.

    frequency : (F,). amplitude : (S, 3, F). shape : (S, 3, F), of short runs the spectrum that
    their autocovariances tell, relative to that at 0. slow : (S, 3), of longer ones the fitted
    spectrum where the noise is slower than a run.
    """

    frequency: FloatArray
    amplitude: FloatArray
    shape: FloatArray
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
    half = len(amplitude) // 2  # positions, then forces
    slow = [
        *_slow(frequency, amplitude[:half], length),
        *_slow(frequency, amplitude[half:], length),
    ]
    return Ordinates(frequency, amplitude, np.ones_like(amplitude), slow)


def _slow(
    frequency: FloatArray, amplitude: FloatArray, length: float
) -> list[list[SlowNoise | None]]:
    """Noise slower than a run, of each axis of streams of one kind, (S, 3)."""
    low = int(np.searchsorted(frequency, _UNBINNED))
    frequency, power = frequency[:low], (amplitude[..., :low] ** 2).reshape(-1, low)
    slow = slow_noise(frequency, power, length)
    flat = [
        _widest_flat_band(frequency, own / one.spectrum(frequency))[1] == low
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
    amplitude = found.amplitude[stream]
    level, width = np.zeros((len(length), 3)), np.zeros(3, dtype=np.int64)
    for axis, slow in enumerate(found.slow[stream]):
        # The level at 0, from as many ordinates as are flat, as they are or less their shape.
        power = amplitude[axis] ** 2
        plain = _widest_flat_band(found.frequency, power)
        whitened = _widest_flat_band(found.frequency, power / found.shape[stream, axis])
        level[:, axis], width[axis] = whitened if whitened[1] > plain[1] else plain
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
