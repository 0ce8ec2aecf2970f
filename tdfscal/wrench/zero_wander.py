"""How far zeros have moved since they were calibrated: as is declared, and by 1/f noise.

1/f noise of one-sided spectral density A/f has the generalised autocovariance −A ln|τ|. The zero of
a calibration is the mean of this noise over its campaign of length T. At a time u from the middle
of the campaign the noise differs from that mean by a variance which exceeds the one that the
campaign's own postures show by

    A [2 g(u/T) + 3],    g(x) = ∫ ln|x − s| ds over −½ … ½.

It grows with the logarithm of the age, as far as the spectrum goes on as it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import BoolArray, Drift, FloatArray
from tdfscal.wrench.sample_noise import LogHead

#: Differences of neighbouring means per channel behind an Allan variance, at least.
_DIFFERENCES = 4

#: Variance (N, n or 1), N², at times (N,), s.
ZeroVariance = Callable[[FloatArray], FloatArray]


def moved_zeros(
    drift: Drift,
    start: float,
    age: ZeroAge,
    temperature: Callable[[FloatArray], FloatArray | None] | None,
) -> ZeroVariance | None:
    """Variance by which zeros have moved since they held; None where they stay.

    start : s, first sample of the log, and age : of the zeros then. temperature : °C, (N, n) at
    times (N,).
    """
    if not (drift.time > 0 or drift.walk > 0 or (drift.temperature > 0 and temperature)):
        return None

    def variance(time: FloatArray) -> FloatArray:
        elapsed = (time - start + age.seconds)[:, None]
        out = _square(drift.time, elapsed) + drift.walk**2 * np.abs(elapsed)
        if drift.temperature > 0 and temperature is not None:
            now, first = temperature(time), temperature(np.array([start]))
            if now is not None and first is not None:
                out = out + _square(drift.temperature, now - first + age.warming)
        return np.asarray(out)

    return variance


def flicker_level(
    head: LogHead, axes: BoolArray, posture_variance: float, span: float, dwell: float
) -> float:
    """A of 1/f noise, N²: the lesser of what dwells and what the calibration's postures show.

    axes : (n, 3), which components are measured. posture_variance : N² per axis, by which the
    calibration's postures scatter beyond what is declared; they span a time, and each lasts a
    dwell, s. Within dwells 1/f noise has the Allan variance 2 ln 2 A at every averaging time; the
    means of dwells scatter over a campaign by A ln(span / dwell). Noise that is white, of short
    memory or constant within a posture shows at one of both scales only.
    """
    if head.averaged or not span > 2 * dwell > 0:
        return 0.0
    within = _allan_variance(head, axes)
    if within is None:
        within = np.inf
    # Of what the means of dwells are stated to scatter by, short memory makes no more than half of
    # what means of half a dwell show; the rest is the 1/f noise itself.
    brief = min(head.mean_variance, within / 2)
    between = max(posture_variance - brief, 0.0) / np.log(span / dwell)
    return float(min(between, within / (2 * np.log(2))))


def flicker(level: float, start: float, age: ZeroAge, span: float) -> ZeroVariance | None:
    """Variance of 1/f noise since the calibration; None where there is none.

    level : A, N². start, age : as for `moved_zeros`. span : s, of the calibration's postures.
    """
    if not level > 0:
        return None

    def variance(time: FloatArray) -> FloatArray:
        x = np.abs(time - start + age.seconds - span / 2) / span
        return np.asarray(level * np.maximum(2.0 * _mean_log(x) + 3.0, 0.0)[:, None])

    return variance


def _mean_log(x: FloatArray) -> FloatArray:
    """∫ ln|x − s| ds over s from −½ to ½."""
    a, b = x + 0.5, x - 0.5
    size = np.abs(b)
    log = np.log(size, where=size > 0, out=np.zeros_like(size))
    return np.asarray(a * np.log(a) - b * log - 1.0)


def _allan_variance(head: LogHead, axes: BoolArray) -> float | None:
    """Of the measured channels, at the longest averaging time that dwells allow; N²."""
    parts = [head.samples.force[row][:, axes] for row in head.dwells(head.samples.time)]
    size = max((len(part) for part in parts), default=0) // 2
    while size:
        whole = [part[: len(part) // size * size].reshape(-1, size, axes.sum()) for part in parts]
        squares = [np.diff(part.mean(axis=1), axis=0) ** 2 for part in whole]
        count = sum(map(len, squares))
        if count >= _DIFFERENCES:
            return float(sum(each.sum() for each in squares) / (2 * count * axes.sum()))
        size //= 2
    return None


def _square(slope: float, change: FloatArray) -> FloatArray:
    """(slope · change)², 0 where nothing has changed, however unknown the slope."""
    moved = change != 0
    return np.square(np.multiply(slope, change, where=moved, out=np.zeros(change.shape)))
