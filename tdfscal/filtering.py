"""Kalman filter of the sensors' signals: the force walks at random, its measurement is noisy.

Per channel x_k = x_{k−1} + w_k with variance q per sample, y_k = x_k + v_k with variance r
(Kalman, J. Basic Eng. 82, 1960). The causal filter serves a controller and costs delay; the
Rauch–Tung–Striebel smoother serves recorded logs and costs none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import DataError, UsageError
from tdfscal.records import FloatArray

_FEWEST = 16


@dataclass(frozen=True, slots=True)
class Walk:
    """Variances of a random walk per sample, q, and of its measurement, r; (C,), one per channel,
    in the square of the signal's unit.
    """

    q: FloatArray
    r: FloatArray

    def __post_init__(self) -> None:
        if not (np.all(self.q > 0.0) and np.all(self.r >= 0.0) and np.all(np.isfinite(self.r))):
            raise UsageError(
                "a Kalman filter needs a walk above zero and a finite noise",
                hint="state the noise as a standard deviation, and a walk above zero",
            )

    @property
    def gain(self) -> FloatArray:
        """Steady-state gain (C,): 0 < g ≤ 1."""
        p = 0.5 * (self.q + np.sqrt(self.q * (self.q + 4.0 * self.r)))  # predicted variance
        return np.asarray(p / (p + self.r))

    @property
    def delay(self) -> FloatArray:
        """Delay (C,) in samples with which the causal filter follows a slow signal: (1 − g) / g."""
        return np.asarray((1.0 - self.gain) / self.gain)

    @property
    def reduction(self) -> FloatArray:
        """White noise's standard deviation after the causal filter over that before, (C,)."""
        return np.asarray(np.sqrt(self.gain / (2.0 - self.gain)))


def estimate_walk(signal: FloatArray) -> Walk:
    """Measured variances of a signal (N, C) of even sampling.

    Of its differences d_k = w_k + v_k − v_{k−1}: cov(d_k, d_{k−1}) = −r and var d = q + 2 r, by
    their medians' robust counterparts, so that moves and jolts do not count as noise. A channel
    that walks less than 1e-6 of its noise is given that much.

    Raises DataError for fewer than 16 samples or numbers that are none.
    """
    if signal.ndim != 2 or len(signal) < _FEWEST or not np.all(np.isfinite(signal)):
        raise DataError(
            f"the noise cannot be measured from {len(signal)} samples",
            hint=f"give {_FEWEST} finite samples or more",
        )
    d1 = _variance(np.diff(signal, axis=0))  # q + 2 r
    d2 = _variance(signal[2:] - signal[:-2])  # 2 q + 2 r
    q = np.maximum(d2 - d1, 0.0)
    r = np.maximum(d1 - 0.5 * d2, 0.0)
    least = np.maximum(1.0e-6 * r, np.finfo(float).tiny * 1e20)
    return Walk(np.maximum(q, least), r)


def _variance(difference: FloatArray) -> FloatArray:
    """Robust variance (C,) of normal numbers with mean 0: (median |d| / 0.6745)²."""
    return np.asarray((np.median(np.abs(difference), axis=0) / 0.6744897501960817) ** 2)


class Causal:
    """The causal filter in its steady state, over pieces of a signal in their order."""

    def __init__(self, walk: Walk) -> None:
        self._gain = walk.gain
        self._last: FloatArray | None = None

    def __call__(self, piece: FloatArray) -> FloatArray:
        """Filtered piece (N, C); the first sample of all starts the filter."""
        if not len(piece):
            return piece
        from scipy.signal import lfilter  # slow to import

        first = piece[0] if self._last is None else self._last
        out = np.empty_like(piece)
        for c, g in enumerate(self._gain):
            out[:, c], _ = lfilter([g], [1.0, g - 1.0], piece[:, c], zi=[(1.0 - g) * first[c]])
        self._last = out[-1]
        return out


def smooth(walk: Walk, signal: FloatArray) -> FloatArray:
    """RTS-smoothed signal (N, C): exact, with a diffuse start; no delay.

    Raises UsageError where the channels are not the walk's.
    """
    if signal.ndim != 2 or signal.shape[1] != len(walk.q):
        raise UsageError(f"{len(walk.q)} channels were stated, the signal is {signal.shape}")
    if len(signal) < 2:
        return signal.copy()
    x, p = np.empty_like(signal), np.empty_like(signal)
    x[0], p[0] = signal[0], walk.r
    for k in range(1, len(signal)):
        ahead = p[k - 1] + walk.q
        g = ahead / (ahead + walk.r)
        x[k] = x[k - 1] + g * (signal[k] - x[k - 1])
        p[k] = (1.0 - g) * ahead
    for k in range(len(signal) - 2, -1, -1):
        back = p[k] / (p[k] + walk.q)
        x[k] += back * (x[k + 1] - x[k])
    return x
