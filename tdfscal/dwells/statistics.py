"""Mean of each dwell and the covariance of that mean, from bins.

Var(mean) = L / N, with N samples and L the spectral density of the noise at frequency zero, in
units of a sample's variance: L = σ² for white noise, σ² (1+φ)/(1−φ) for a first-order
autoregression. L belongs to the noise process, so it is estimated once per axis from all dwells
together; a short dwell alone says next to nothing about it.

The estimate: the cosine transform of a dwell's bin means (each weighted by √samples, so that white
noise has ordinates of expectation σ² whatever the bins hold) gives independent ordinates of the
spectrum. Orders 0 and 1 are the mean and the drift; the others are averaged from the lowest
frequency upwards, by octaves, as long as a wider band agrees with all narrower ones (Lepski's
rule). White noise uses the whole band, correlated noise only where its spectrum is flat. The same
is tried after dividing by the shape of white noise plus a first-order autoregression, fitted to
the first autocovariances, and the wider band wins.

Readings coarser than their own noise hide an error that no scatter shows; its variance,
q²/12 · exp(−4π²s²/q²) with resolution q and noise s (the first harmonic of the rounding error),
is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct

from tdfscal.dwells.bins import Bins
from tdfscal.dwells.changes import runs
from tdfscal.records import BoolArray, FloatArray, IntArray

_SHORTEST_RUN = 6  # bins; shorter pieces of a dwell carry no spectrum
_BASE_ORDINATES = 40  # in the narrowest band
_LEPSKI = 2.8  # standard deviations of disagreement that end the widening
_LARGER = 4.0  # standard deviations of log-variance beyond which a dwell keeps its own scatter


@dataclass(frozen=True, slots=True)
class Extent:
    """One dwell: bins [begin, end) of which `used` (end − begin,) are averaged."""

    begin: int
    end: int
    used: BoolArray

    @property
    def rows(self) -> IntArray:
        """Indices of the bins averaged."""
        return self.begin + np.flatnonzero(self.used)


@dataclass(frozen=True, slots=True)
class Moments:
    """Per dwell and stream: mean (K, S, 3), cov of the mean (K, S, 3, 3), count and effective
    (K, S); drift (K, S, 3), change over the dwell by the fitted line, with drift_std;
    bow (K, S, 3), the quadratic term in standard deviations; density (K, S, 3), variance of a
    sample as it counts in a long mean.
    """

    mean: FloatArray
    cov: FloatArray
    count: IntArray
    effective: FloatArray
    drift: FloatArray
    drift_std: FloatArray
    bow: FloatArray
    density: FloatArray


@dataclass(frozen=True, slots=True)
class _Spectrum:
    """Noise of one uninterrupted run of bins, line removed, all streams.

    frequency : (M,), cycles per bin. amplitude : (M, S, 3), cosine transform from order 2 on.
    covariance : (3, S, 3), mean products at lags 0, 1, 2. length : bins.
    """

    frequency: FloatArray
    amplitude: FloatArray
    covariance: FloatArray
    length: int


@dataclass(frozen=True, slots=True)
class _Own:
    """What one dwell shows by itself, (S, 3) each: see `Moments`; scatter : sample variance."""

    mean: FloatArray
    scatter: FloatArray
    count: IntArray
    drift: FloatArray
    drift_scale: FloatArray
    bow: FloatArray
    spectra: tuple[_Spectrum, ...]


def dwell_moments(bins: Bins, extents: Sequence[Extent]) -> Moments:
    """Statistics of K dwells. Each stream's axes in the unit of the stream."""
    shape = (len(extents), bins.count.shape[1], 3)
    own = [_own(bins, extent) for extent in extents]
    mean = _stacked([o.mean for o in own], shape)
    scatter = _stacked([o.scatter for o in own], shape)
    count = np.stack([o.count for o in own]) if own else np.zeros(shape[:2], np.int64)
    ratio = np.ones(shape)
    density = np.zeros((*shape, 3))
    pooled = np.zeros(shape)
    for stream in range(shape[1]):
        if not extents:
            break
        ratio[:, stream] = _excess_scatter(scatter[:, stream], count[:, stream])
        level = _pooled(scatter[:, stream], count[:, stream])
        pooled[:, stream] = level * ratio[:, stream]
        common = _density([o.spectra for o in own], stream, level, ratio[:, stream])
        root = np.sqrt(ratio[:, stream])
        density[:, stream] = common * root[:, :, None] * root[:, None, :]
    n = np.maximum(count, 1)
    # All dwells together: one dwell that sits amid a step shows no scatter, whatever the noise.
    typical = scatter.mean(axis=0) if extents else np.zeros(shape[1:])
    rounding = _rounding(typical, bins.quantum)
    variance = np.asarray(np.diagonal(density, axis1=2, axis2=3))
    total = variance.sum(axis=2)
    share = np.divide(pooled.sum(axis=2), total, out=np.ones(shape[:2]), where=total > 0)
    bow = _stacked([o.bow for o in own], shape)
    sd = np.sqrt(variance)
    return Moments(
        mean=mean,
        cov=density / n[:, :, None, None] + rounding[..., None] * np.eye(3),
        count=count,
        effective=np.clip(n * share, 1.0, n),
        drift=_stacked([o.drift for o in own], shape),
        drift_std=sd * _stacked([o.drift_scale for o in own], shape),
        bow=np.divide(bow, sd, out=np.zeros(shape), where=sd > 0),
        density=variance,
    )


def _stacked(rows: list[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    return np.stack(rows) if rows else np.zeros(shape)


def _own(bins: Bins, extent: Extent) -> _Own:
    rows = extent.rows
    weight = bins.count[rows].astype(np.float64)[:, :, None]
    present = weight > 0
    reference = np.nanmin(bins.mean[rows], axis=0)
    value = np.where(present, bins.mean[rows] - reference, 0.0)
    total = weight.sum(axis=0)
    mean = (weight * value).sum(axis=0) / total
    value = np.where(present, value - mean, 0.0)
    square = (weight * value**2).sum(axis=0) + bins.scatter[rows].sum(axis=0)
    time = (bins.start[rows] - bins.start[rows[0]]) / bins.width / (rows[-1] - rows[0] + 1)
    line = time[:, None, None] - (weight * time[:, None, None]).sum(axis=0) / total
    length = np.sqrt((weight * line**2).sum(axis=0))
    drift = (weight * line * value).sum(axis=0) / length**2
    curve = line**2 - (weight * line**2).sum(axis=0) / total
    curve -= line * (weight * line * curve).sum(axis=0) / length**2
    flat = value - line * drift
    bow = (weight * curve * flat).sum(axis=0) / np.sqrt((weight * curve**2).sum(axis=0))
    return _Own(
        mean=mean + reference,
        scatter=square / np.maximum(total - 1.0, 1.0),
        count=total[:, 0].astype(np.int64),
        drift=drift,
        drift_scale=np.broadcast_to(1.0 / length, mean.shape),
        bow=bow,
        spectra=_spectra(extent.used, np.sqrt(weight), value),
    )


def _spectra(used: BoolArray, root: FloatArray, value: FloatArray) -> tuple[_Spectrum, ...]:
    """One spectrum per uninterrupted run of a dwell; value (R, S, 3), weight root²."""
    first, last = runs(used)
    end = np.cumsum(last - first)
    spectra = []
    for begin, stop in zip(end - (last - first), end, strict=True):
        if stop - begin < _SHORTEST_RUN:
            continue
        w, x = root[begin:stop], value[begin:stop]
        line = np.linspace(-1.0, 1.0, stop - begin)[:, None, None]
        total = (w**2).sum(axis=0)
        line = line - (w**2 * line).sum(axis=0) / total
        x = x - (w**2 * x).sum(axis=0) / total
        x = w * (x - line * (w**2 * line * x).sum(axis=0) / (w**2 * line**2).sum(axis=0))
        lags = np.stack([(x[k:] * x[: len(x) - k]).mean(axis=0) for k in range(3)])
        order = np.arange(2, len(x))
        spectra.append(
            _Spectrum(order / (2.0 * len(x)), dct(x, axis=0, norm="ortho")[2:], lags, len(x))
        )
    return tuple(spectra)


def _rounding(scatter: FloatArray, quantum: FloatArray) -> FloatArray:
    """(S, 3), variance of the mean that rounding to multiples of quantum adds."""
    step = quantum**2
    noise = np.maximum(scatter - step / 12.0, 0.0)
    relative = np.divide(noise, step, out=np.full(scatter.shape, np.inf), where=step > 0)
    return np.asarray(step / 12.0 * np.exp(-4.0 * np.pi**2 * relative))


def _pooled(scatter: FloatArray, count: IntArray) -> FloatArray:
    """(3,), the sample variance that most dwells have: weighted mean of the compatible ones."""
    middle = np.median(scatter, axis=0)
    weight = count[:, None] * (_log_ratio(scatter, middle, count) <= _LARGER)
    total = np.maximum(weight.sum(axis=0), 1)
    return np.asarray(np.where(weight.any(axis=0), (weight * scatter).sum(axis=0) / total, middle))


def _log_ratio(scatter: FloatArray, middle: FloatArray, count: IntArray) -> FloatArray:
    """log(variance / middle) in standard deviations, as spread among the dwells or as sampled."""
    tiny = np.finfo(np.float64).tiny
    log = np.log(np.maximum(scatter, tiny)) - np.log(np.maximum(middle, tiny))
    sampled = np.sqrt(2.0 / np.maximum(count - 1, 1))[:, None]
    spread = 1.4826 * np.median(np.abs(log), axis=0)
    return np.asarray(log / np.maximum(sampled, spread))


def _excess_scatter(scatter: FloatArray, count: IntArray) -> FloatArray:
    """(K, 3), variance relative to the pooled one: 1 where compatible or smaller, else its own."""
    pooled = _pooled(scatter, count)
    larger = (_log_ratio(scatter, pooled, count) > _LARGER) & (pooled > 0)
    return np.divide(scatter, pooled, out=np.ones_like(scatter), where=larger)


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


def _density(
    spectra: Sequence[tuple[_Spectrum, ...]], stream: int, pooled: FloatArray, ratio: FloatArray
) -> FloatArray:
    """(3, 3), spectral density at frequency zero per sample, of dwells with common scatter."""
    usable = [one for k, many in enumerate(spectra) if (ratio[k] == 1.0).all() for one in many]
    if sum(len(one.frequency) for one in usable) < _SHORTEST_RUN:
        return np.diag(pooled)
    frequency = np.concatenate([one.frequency for one in usable])
    order = np.argsort(frequency, kind="stable")
    frequency = frequency[order]
    amplitude = np.concatenate([one.amplitude[:, stream] for one in usable])[order]
    length = np.array([one.length for one in usable])
    lags = np.array([one.covariance[:, stream] for one in usable])
    covariance = _autocovariance(np.average(lags, axis=0, weights=length), float(length.mean()))
    level, width = np.zeros(3), np.zeros(3, dtype=np.int64)
    shape = _rational_spectrum(covariance, np.concatenate([[0.0], frequency]))
    shape = np.divide(shape[1:], shape[0], out=np.ones_like(shape[1:]), where=shape[0] > 0)
    for axis in range(3):
        level[axis], width[axis] = _zero_frequency(
            frequency, amplitude[:, axis] ** 2, shape[:, axis]
        )
    band = amplitude[: int(width.min())]
    product = band.T @ band
    scale = np.sqrt(np.diagonal(product))
    correlation = np.divide(
        product, np.outer(scale, scale), out=np.eye(3), where=np.outer(scale, scale) > 0
    )
    root = np.sqrt(level)
    return np.asarray(correlation * np.outer(root, root))


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
