"""Noise of the contact wrench behind a controller's filter, measured where the log lets it be seen.

It is the scatter within static dwells; where none rests long enough, within windows. Its slow
part comes from the spectrum of means over bins (`dwells.slow_noise`); what it loses to the mean
that is taken off is put back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.detection.threshold import Noise
from tdfscal.dwells.noise_spectrum import SlowNoise, slow_noise
from tdfscal.frozen import record
from tdfscal.records import FloatArray

#: Windows where nothing rests, s; what scatters this many times as much as usual is a touch.
_WINDOW, _TOUCHED = 60.0, 4.0
#: Bins of a window.
_BINS = 128
#: Samples of a window, at least.
_FEWEST = 16
#: Independent values at rest, at least: a standard deviation of theirs is known to a tenth.
_FEW_AT_REST = 50
#: Cycles per bin up to which means over bins have the spectrum of the noise.
_UNBINNED = 0.125
#: Equivalent noise bandwidth of the filter over its cut-off: π / (2 √2).
_BANDWIDTH = np.pi / np.sqrt(8.0)
#: Sampling intervals without a sample, from which on a filter begins anew.
_GAP = 3.0


class LowPass:
    """A causal Butterworth low-pass of the second order, over pieces of a signal in their order.

    cutoff : Hz; None: nothing is filtered. White noise has no derivative and a level without a
    filter is crossed as often as it is sampled; behind this one it is crossed upwards `cutoff`
    times a second at most (Rice).
    """

    def __init__(self, cutoff: float | None, interval: float) -> None:
        self._coefficients = None if cutoff is None else _butterworth(cutoff * interval)
        self._longest, self._begins = _GAP * interval, 2.0 / (cutoff or np.inf)
        self._state: FloatArray | None = None
        self._ready = self._end = -np.inf

    def __call__(self, time: FloatArray, value: FloatArray) -> FloatArray:
        """Filtered piece (N, c) at times (N,), s; 0 until it has forgotten how it began.

        After a gap it begins anew.
        """
        if self._coefficients is None or not len(value):
            return value
        from scipy.signal import lfilter, lfilter_zi  # slow to import

        b, a = self._coefficients
        out = np.empty_like(value)
        cuts = np.flatnonzero(np.diff(time, prepend=self._end) > self._longest)
        for first, last in zip([0, *cuts], [*cuts, len(time)], strict=True):
            if first == last:
                continue
            if first in cuts or self._state is None:
                self._state = lfilter_zi(b, a)[:, None] * value[first]
                self._ready = float(time[first]) + self._begins
            out[first:last], self._state = lfilter(b, a, value[first:last], 0, self._state)
        self._end = float(time[-1])
        out[time < self._ready] = 0.0
        return out


def _butterworth(share: float) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of the filter, its cut-off as a share of the sampling rate."""
    from scipy.signal import butter  # slow to import

    b, a = butter(2, 2.0 * share)
    return b, a


def _filtered(value: FloatArray, share: float) -> FloatArray:
    """The whole of a signal (N, c) through the filter at once, as if it came again and again."""
    b, a = _butterworth(share)
    late = np.exp(-2j * np.pi * np.fft.rfftfreq(len(value)))[:, None] ** np.arange(3)
    return np.fft.irfft(
        np.fft.rfft(value, axis=0) * ((late @ b) / (late @ a))[:, None], len(value), axis=0
    )


@record
class MeasuredNoise:
    """Noise of each of the six components, and what it was measured on.

    resting : in static dwells, else in windows of a motion. spans : how many there were; none
    where the log shows no noise, which is 0 then. longest : s, of them.
    """

    components: tuple[Noise, ...]
    resting: bool
    spans: int
    longest: float


def serving(rest: Sequence[slice], interval: float, cutoff: float | None) -> list[slice]:
    """Rows of dwells that show the noise; none where all hold too few independent values of it.

    A filter forgets what was before a dwell within a few of its time constants, and leaves as many
    independent values as its bandwidth.
    """
    late = _forgotten(interval, cutoff)
    spans = [slice(row.start + late, row.stop) for row in rest]
    spans = [row for row in spans if row.stop - row.start >= _FEWEST]
    values = sum(_independent(row.stop - row.start, interval, cutoff) for row in spans)
    return spans if values >= _FEW_AT_REST else []


def _forgotten(interval: float, cutoff: float | None) -> int:
    """Samples after which a filter has forgotten how it began."""
    return 0 if cutoff is None else int(np.ceil(1.0 / (cutoff * interval)))


def _independent(size: int, interval: float, cutoff: float | None) -> float:
    """Independent values in so many samples behind the filter."""
    return size if cutoff is None else min(2.0 * _BANDWIDTH * cutoff * interval * size, size)


def measured_noise(
    time: FloatArray,
    value: FloatArray,
    rest: Sequence[slice],
    cutoff: float | None,
) -> MeasuredNoise:
    """Measure the noise of a wrench (N, 6) at times (N,), s.

    rest : rows that lie in each static dwell. cutoff : of the filter, Hz.
    """
    count = value.shape[1]
    interval = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    seen = value if cutoff is None else _filtered(value, cutoff * interval)
    spans = serving(rest, interval, cutoff)
    if not (resting := bool(spans)):
        size, late = max(_FEWEST, round(_WINDOW / interval)), _forgotten(interval, cutoff)
        spans = [slice(k, min(k + size, len(time))) for k in range(late, len(time), size)]
        # The last one is a remnant, unless it is the only one.
        spans = [row for row in spans if 2 * (row.stop - row.start) >= size] or spans[:1]
    spans = _untouched([row for row in spans if row.stop - row.start >= _FEWEST], value)
    if not spans:
        none = Noise(0.0, 0.0, 0.0, 1.0, interval)
        return MeasuredNoise((none,) * count, resting, 0, 0.0)
    longest = interval * max(row.stop - row.start for row in spans)
    slow, relaxation = _slow_part([value[row] for row in spans], interval)
    passed = np.array([_passed(tau, cutoff) for tau in relaxation])
    slow = slow * passed * (relaxation > _memory(cutoff, interval))
    total, step = np.zeros(count), np.zeros(count)
    kept, samples = np.zeros(count), 0.0
    for row in spans:
        part = seen[row] - seen[row].mean(axis=0)
        size = len(part)
        share = max(1.0 - 1.0 / _independent(size, interval, cutoff), 0.1)
        total += np.sum(part**2, axis=0)
        step += np.sum(np.diff(part, axis=0) ** 2, axis=0) * size / (size - 1)
        kept += size * np.array([1.0 - _lost(tau, size * interval) for tau in relaxation])
        samples += size * share
    fast = np.maximum(total - slow * kept, 0.0) / samples
    rough = step / sum(row.stop - row.start for row in spans) / 2.0
    if cutoff is None:
        rough = rough - slow * -np.expm1(-interval / relaxation)
    unlike = np.divide(rough, fast, out=np.ones(count), where=fast > 0)
    return MeasuredNoise(
        tuple(
            Noise(float(np.sqrt(f)), float(np.clip(1.0 - u, -1.0, 1.0 - 1e-12)),
                  float(np.sqrt(s)), float(tau), interval)
            for f, u, s, tau in zip(fast, unlike, slow, relaxation, strict=True)
        ),
        resting,
        len(spans),
        longest,
    )  # fmt: skip


def _memory(cutoff: float | None, interval: float) -> float:
    """How long the fast part remembers, s: what relaxes faster is a part of it."""
    return 2.0 * interval if cutoff is None else 1.0 / (2.0 * cutoff)


def _untouched(spans: list[slice], value: FloatArray) -> list[slice]:
    """Leave out windows that scatter far more than most."""
    if len(spans) < 3:
        return spans
    variance = np.array([value[row].var(axis=0) for row in spans])
    usual = np.median(variance, axis=0)
    touched = (variance > _TOUCHED * usual).any(axis=1)
    return [row for row, bad in zip(spans, touched, strict=True) if not bad] or spans


def _slow_part(parts: Sequence[FloatArray], interval: float) -> tuple[FloatArray, FloatArray]:
    """Variance and relaxation, s, of the slow part of each component (c,)."""
    count = parts[0].shape[1]
    longest = max(map(len, parts))
    size = max(1, longest // _BINS)  # samples in a bin
    frequency, power = list[FloatArray](), list[FloatArray]()
    for part in parts:
        bins = len(part) // size
        order = np.arange(1, bins)
        order = order[order / (2.0 * bins) <= _UNBINNED] if size > 1 else order
        if not len(order):
            continue
        mean = part[: bins * size].reshape(bins, size, count).mean(axis=1)
        mean -= mean.mean(axis=0)
        basis = np.cos(np.pi * order[:, None] * (np.arange(bins) + 0.5) / bins)
        frequency.append(order / (2.0 * bins))
        power.append((np.sqrt(2.0 / bins) * basis @ mean) ** 2)
    variance, relaxation = np.zeros(count), np.ones(count)
    if not frequency:
        return variance, relaxation
    where = np.concatenate(frequency)
    rank = np.argsort(where, kind="stable")
    ordinates = np.concatenate(power)[rank].T
    length = longest / size
    for c, found in enumerate(slow_noise(where[rank], ordinates, length)):
        if found is not None:
            variance[c], relaxation[c] = _relaxing(found, length, size * interval)
    return variance, relaxation


def _relaxing(found: SlowNoise, length: float, bin_time: float) -> tuple[float, float]:
    """One relaxation, variance and time, s, for all that are likely; rates add as variances do.

    1/f noise is what it is from a window's length down to a bin.
    """
    forever = np.isinf(found.relaxation)
    time = np.where(forever, length / 4.0, found.relaxation)
    size = found.slow * np.where(forever, 2.0 * np.log(length), 1.0)
    variance = float(size @ found.weight)
    if not variance > 0.0:
        return 0.0, 1.0
    return variance, bin_time * variance / float((size / time) @ found.weight)


def _lost(relaxation: float, length: float) -> float:
    """Share of the slow variance that a mean over a length, s, takes off."""
    x = relaxation / length
    return float(2.0 * x * (1.0 + x * np.expm1(-1.0 / x)))


def _passed(relaxation: float, cutoff: float | None) -> float:
    """Share of the variance of an Ornstein–Uhlenbeck process that the filter lets pass."""
    if cutoff is None:
        return 1.0
    x = np.geomspace(1e-6, 1e4, 4001)  # 2π f τ
    passed = 1.0 / (1.0 + (x / (2.0 * np.pi * cutoff * relaxation)) ** 4)
    return float(np.trapezoid(passed / (1.0 + x**2), x) * 2.0 / np.pi)
