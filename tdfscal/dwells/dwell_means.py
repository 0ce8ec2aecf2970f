"""Mean of each dwell and the covariance of that mean, from bins.

Var(mean) = L / N, with N samples and L the spectral density of the noise at frequency zero, in
units of a sample's variance: L = σ² for white noise, σ² (1+φ)/(1−φ) for a first-order
autoregression. L belongs to the noise process, so it is estimated once per axis from all dwells
together (`spectrum`); a short dwell alone says next to nothing about it. A dwell whose scatter is
clearly larger than that of most keeps its own: its L is scaled by the ratio of the variances.

Readings coarser than their own noise hide an error that no scatter shows; its variance,
q²/12 · exp(−4π²s²/q²) with resolution q and noise s (the first harmonic of the rounding error),
is added.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from tdfscal.dwells.bins import Bins
from tdfscal.dwells.noise_level import runs
from tdfscal.dwells.noise_spectrum import Ordinates, density, spectrum, together
from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.records import BoolArray, FloatArray, IntArray, Log

_LARGER = 4.0  # standard deviations of log-variance beyond which a dwell keeps its own scatter
_SPECTRA = 50  # dwells, evenly over the log, that the spectrum is taken from


@record
class Extent:
    """One dwell: bins [begin, end) of which `used` (end − begin,) are averaged."""

    begin: int
    end: int
    used: BoolArray

    @property
    def rows(self) -> IntArray:
        """Indices of the bins averaged."""
        return self.begin + np.flatnonzero(self.used)

    @property
    def ends(self) -> tuple[Extent, Extent]:
        """The first and the last uninterrupted run of bins averaged."""
        first, last = runs(self.used)
        whole = [
            Extent(self.begin + int(a), self.begin + int(b), self.used[a:b])
            for a, b in ((first[0], last[0]), (first[-1], last[-1]))
        ]
        return whole[0], whole[1]

    def followed_by(self, later: Extent, *, between: bool) -> Extent:
        """One dwell of both, with or without what lies between."""
        pause = np.full(later.begin - self.end, between)
        return Extent(self.begin, later.end, np.concatenate([self.used, pause, later.used]))


@record
class Moments:
    """Per dwell and stream: mean (K, S, 3), cov of the mean (K, S, 3, 3), count and effective
    (K, S); drift (K, S, 3), change over the dwell by the fitted line, with drift_std;
    density (K, S, 3), variance of a sample as it counts in a long mean; low, high (K, n, 3),
    extremes of the forces' samples.
    """

    mean: FloatArray
    cov: FloatArray
    count: IntArray
    effective: FloatArray
    drift: FloatArray
    drift_std: FloatArray
    density: FloatArray
    low: FloatArray
    high: FloatArray


@record
class _Own:
    """What dwells show by themselves, (K, S, 3): see `Moments`.

    scatter : sample variance. length : 1 / standard deviation of the drift for noise of variance 1.
    low, high : (K, n, 3), extremes of the forces' samples.
    """

    mean: FloatArray
    scatter: FloatArray
    count: IntArray  # (K, S)
    drift: FloatArray
    length: FloatArray
    low: FloatArray
    high: FloatArray


def dwell_moments(bins: Bins, extents: Sequence[Extent]) -> Moments:
    """Statistics of K dwells. Each stream's axes in the unit of the stream."""
    shape = (len(extents), bins.count.shape[1], 3)
    own = _own(bins, extents)
    zero = np.zeros((*shape, 3))
    level = _pooled(own.scatter, own.count) if extents else np.zeros(shape[1:])
    larger = _log_ratio(own.scatter, level, own.count) > _LARGER if extents else np.zeros(shape)
    # Variance relative to the pooled one: 1 where compatible or smaller, else its own.
    ratio = np.divide(own.scatter, level, out=np.ones(shape), where=larger * level > 0)
    looked = evenly(len(extents), _SPECTRA)
    spectra = [  # of uninterrupted runs of some dwells
        (int(k), one)
        for k in looked
        for begin, end in (extents[k].begin + np.stack(runs(extents[k].used), axis=1)).tolist()
        if (one := spectrum(bins, slice(begin, end))) is not None
    ]
    # The spectrum tells how a mean scatters beside a sample; how samples do all dwells tell.
    few = _pooled(own.scatter[looked], own.count[looked]) if extents else level
    beside = np.sqrt(np.divide(level, few, out=np.ones_like(level), where=few > 0))
    ordinates: dict[tuple[int, ...], Ordinates | None] = {}
    length = np.array([extent.used.sum() for extent in extents])
    campaign = float(bins.start[-1] - bins.start[0]) / bins.width
    for stream in range(shape[1] if extents else 0):
        alike = (ratio[:, stream] == 1.0).all(axis=1)
        usable = tuple(i for i, (k, _) in enumerate(spectra) if alike[k])
        if usable not in ordinates:  # one for all streams, as a rule
            ordinates[usable] = together([spectra[i][1] for i in usable])
        root = np.sqrt(ratio[:, stream]) * beside[stream]
        common = density(ordinates[usable], stream, level[stream], length, campaign)
        zero[:, stream] = common * root[:, :, None] * root[:, None, :]
    n = np.maximum(own.count, 1)
    # All dwells together: one dwell that sits amid a step shows no scatter, whatever the noise.
    typical = own.scatter.mean(axis=0) if extents else np.zeros(shape[1:])
    # Of the mean, (S, 3), by rounding to multiples of the quantum.
    step = bins.quantum**2
    noise = np.maximum(typical - step / 12.0, 0.0)
    relative = np.divide(noise, step, out=np.full(noise.shape, np.inf), where=step > 0)
    rounding = step / 12.0 * np.exp(-4.0 * np.pi**2 * relative)
    variance = np.asarray(np.diagonal(zero, axis1=2, axis2=3))
    total = variance.sum(axis=2)
    share = np.divide((level * ratio).sum(axis=2), total, out=np.ones(shape[:2]), where=total > 0)
    sd = np.sqrt(variance)
    return Moments(
        mean=own.mean,
        cov=zero / n[:, :, None, None] + rounding[..., None] * np.eye(3),
        count=own.count,
        effective=np.clip(n * share, 1.0, n),
        drift=own.drift,
        drift_std=sd / own.length,
        density=variance,
        low=own.low,
        high=own.high,
    )


def still_since(bins: Bins) -> FloatArray:
    """Since when each force stays the same to the end of the log, (n, 3), s; NaN where it does not.

    NaN too where it stood there earlier as at an end of its range: it may have been cut off.
    """
    n = bins.low.shape[1]
    since = np.full((n, 3), np.nan)
    for i, j in np.ndindex(n, 3):
        seen = np.flatnonzero(bins.count[:, n + i] > 0)
        mean, low, high = bins.mean[seen, n + i, j], bins.low[seen, i, j], bins.high[seen, i, j]
        if not len(seen) or low[-1] != high[-1]:
            continue
        same = (low == high) & np.isclose(mean, mean[-1], rtol=1e-12, atol=0.0)
        changed = np.flatnonzero(~same)
        if not len(changed) or changed[-1] + 1 == len(seen):
            continue
        last = changed[-1]
        before = (mean + low)[:last].min(initial=np.inf), (mean + high)[:last].max(initial=-np.inf)
        if not np.isclose(before, mean[-1], rtol=1e-6, atol=0.0).any():
            since[i, j] = bins.start[seen[last + 1]]
    return since


def evenly(count: int, most: int) -> IntArray:
    """At most so many of 0 … count − 1, evenly spread."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).round().astype(np.int64)


def _own(bins: Bins, extents: Sequence[Extent]) -> _Own:
    n, shape = len(bins.supports), (len(extents), bins.count.shape[1], 3)
    mean, scatter, drift, length = (np.zeros(shape) for _ in range(4))
    low, high = (np.zeros((shape[0], n, 3)) for _ in range(2))
    count = np.zeros(shape[:2], dtype=np.int64)
    axes, spread, lowest, highest = (  # as they lie in memory
        moments.transpose(1, 2, 0) for moments in (bins.mean, bins.scatter, bins.low, bins.high)
    )
    for k, extent in enumerate(extents):
        rows = extent.rows
        whole = rows[-1] - rows[0] + 1
        some = slice(rows[0], rows[-1] + 1) if len(rows) == whole else rows
        w = bins.count.T[:, None, some].astype(np.float64)  # (S, 1, R)
        x = np.where(w > 0, axes[..., some], 0.0)  # (S, 3, R)
        reference = x.max(axis=2, keepdims=True)
        x -= reference
        size = w.sum(axis=2, keepdims=True)
        offset = (w * x).sum(axis=2, keepdims=True) / size
        x -= offset
        weighted = w * x
        own = spread[..., some].sum(axis=2, dtype=np.float64)
        # The line: the time as a fraction of the dwell, about its weighted mean.
        t = (rows - rows[0]) / whole
        line = t - (w * t).sum(axis=2, keepdims=True) / size
        line2 = (w * line**2).sum(axis=2)
        count[k], mean[k] = size[:, 0, 0], (reference + offset)[..., 0]
        scatter[k] = ((weighted * x).sum(axis=2) + own) / np.maximum(size[..., 0] - 1.0, 1.0)
        drift[k] = (weighted * line).sum(axis=2) / line2
        length[k] = np.sqrt(line2)
        low[k] = np.fmin.reduce(axes[n:, :, some] + lowest[..., some], axis=2)
        high[k] = np.fmax.reduce(axes[n:, :, some] + highest[..., some], axis=2)
    return _Own(mean, scatter, count, drift, length, low, high)


def _pooled(scatter: FloatArray, count: IntArray) -> FloatArray:
    """(S, 3), the sample variance that most dwells have: weighted mean of the compatible ones."""
    middle = np.median(scatter, axis=0)
    weight = count[..., None] * (_log_ratio(scatter, middle, count) <= _LARGER)
    total = np.maximum(weight.sum(axis=0), 1)
    return np.asarray(np.where(weight.any(axis=0), (weight * scatter).sum(axis=0) / total, middle))


def _log_ratio(scatter: FloatArray, middle: FloatArray, count: IntArray) -> FloatArray:
    """log(variance / middle) in standard deviations, as spread among the dwells or as sampled."""
    tiny = np.finfo(np.float64).tiny
    log = np.log(np.maximum(scatter, tiny)) - np.log(np.maximum(middle, tiny))
    sampled = np.sqrt(2.0 / np.maximum(count - 1, 1))[..., None]
    spread = 1.4826 * np.median(np.abs(log), axis=0)
    return np.asarray(log / np.maximum(sampled, spread))


_STEP = 0.5  # s; a temperature changes slowly, and is kept as means over this time


@dataclass(slots=True)
class Thermometer:
    """Lets pieces of a log pass and keeps their temperatures as means over short steps.

    time, value : per field, pieces of (steps,), s and °C.
    """

    rows: bool = False
    time: list[list[FloatArray]] = field(default_factory=list)
    value: list[list[FloatArray]] = field(default_factory=list)

    def passing(self, pieces: Iterable[Log]) -> Iterator[Log]:
        """Pass pieces on."""
        for piece in pieces:
            self.rows = piece.rows == "postures"
            self.time = self.time or [[] for _ in piece.temperature]
            self.value = self.value or [[] for _ in piece.temperature]
            for series, time, value in zip(piece.temperature, self.time, self.value, strict=True):
                known = np.isfinite(series.value[:, 0])
                if known.any():
                    stamps, celsius = series.time[known], series.value[known, 0]
                    step = np.floor(stamps / _STEP) if not self.rows else stamps
                    first = np.flatnonzero(np.append(True, np.diff(step) > 0))
                    count = np.diff(np.append(first, len(step)))
                    time.append(np.add.reduceat(stamps, first) / count)
                    value.append(np.add.reduceat(celsius, first) / count)
            yield piece

    def at(self, start: FloatArray, end: FloatArray, n: int) -> FloatArray | None:
        """Mean temperature (K, n), °C, over K stretches at n sensors; None where none is recorded.

        A stretch without a sample gets what lies between its neighbours. Raises DataError where a
        field holds no number.
        """
        if not self.time:
            return None
        columns = []
        for times, values in zip(self.time, self.value, strict=True):
            if not times:
                raise DataError(Finding("temperature-unreadable"))
            time, value = np.concatenate(times), np.concatenate(values)
            total = np.append(0.0, np.cumsum(value))
            first, last = np.searchsorted(time, start), np.searchsorted(time, end, side="right")
            count = last - first
            between = np.interp((start + end) / 2, time, value)
            mean = (total[last] - total[first]) / np.maximum(count, 1)
            columns.append(np.where(count > 0, mean, between))
        return np.stack(columns if len(columns) > 1 else columns * n, axis=1)
