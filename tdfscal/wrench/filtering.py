"""Kalman filter of the sensors' signals: the force walks at random, its measurement is noisy.

x_k = x_{k−1} + w_k with variance q per sample, y_k = x_k + v_k with variance r (Kalman, J. Basic
Eng. 82, 1960), in its steady state. The causal filter serves a controller and costs delay; the
Rauch–Tung–Striebel smoother serves recorded logs and costs none. All channels share one gain:
forces that balance each other stay balanced, since all are late by the same time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np

from tdfscal.errors import DataError
from tdfscal.frozen import record, replace
from tdfscal.model.samples_in_motion import Samples
from tdfscal.records import FloatArray
from tdfscal.wrench.wrench_noise import FEWEST, scatter_in_windows

#: N by which a force walks in a second: a contact builds up by K v = 10 kN/m · 1.5 mm/s (Sect. 5).
WALK = 15.0

Kind = Literal["none", "kalman", "smooth"]

#: Weight from which on the smoother takes no notice of later samples.
_FORGOTTEN = 1.0e-9
#: Sampling intervals without a sample that end a stretch.
_GAP = 3.0


@record
class Walk:
    """Variances of a random walk per sample, q, and of its measurement, r, N²; interval : s."""

    q: float
    r: float
    interval: float

    @classmethod
    def of(cls, walk: float, noise: float, interval: float) -> Walk:
        """Walk : N in a second. noise : N, standard deviation of a sample."""
        return cls(walk**2 * interval, noise**2, interval)

    @property
    def gain(self) -> float:
        """Steady-state gain, 0 < g ≤ 1."""
        p = 0.5 * (self.q + np.sqrt(self.q * (self.q + 4.0 * self.r)))  # predicted variance
        return float(p / (p + self.r))

    @property
    def delay(self) -> float:
        """Time by which the causal filter is late on a slow signal, s: (1 − g) / g samples."""
        return (1.0 - self.gain) / self.gain * self.interval

    def noise_left(self, *, smooth: bool) -> float:
        """Share that the filter, or the smoother, leaves of the white noise's standard deviation.

        √Σ h_k² with h_k = g a^k, a = 1 − g; the smoother's h_k = g / (1 + a) a^|k|.
        """
        g, a = self.gain, 1.0 - self.gain
        both = (1.0 + a**2) / (1.0 + a) ** 2 if smooth else 1.0
        return float(g * np.sqrt(both / (1.0 - a**2)))


class Causal:
    """The causal filter over pieces of a signal in their order."""

    def __init__(self, walk: Walk) -> None:
        self._gain = walk.gain
        self._last: FloatArray | None = None

    def __call__(self, piece: FloatArray) -> FloatArray:
        """Filtered piece (N, ...); the first sample of all starts the filter."""
        if not len(piece):
            return piece
        out = _follow(self._gain, piece, piece[0] if self._last is None else self._last)
        self._last = out[-1]
        return out

    def rest(self) -> FloatArray:
        """Nothing is held back."""
        return np.empty((0,))


def _follow(g: float, signal: FloatArray, start: FloatArray) -> FloatArray:
    """x_k = x_{k−1} + g (y_k − x_{k−1}) along the first axis, from x_{−1} = start."""
    from scipy.signal import lfilter  # slow to import

    out, _ = lfilter([g], [1.0, g - 1.0], signal, axis=0, zi=(1.0 - g) * start[None])
    return np.asarray(out)


class Smoother:
    """The RTS smoother over pieces of a signal in their order, as far as the future is known.

    In the steady state its backward pass is the causal filter run backwards over the filtered
    signal; what lies so far ahead that it no longer counts is not waited for.
    """

    def __init__(self, walk: Walk) -> None:
        self._gain = walk.gain
        self._causal = Causal(walk)
        remembered = max(1.0 - self._gain, 1e-300)
        self.ahead = int(np.ceil(np.log(_FORGOTTEN) / np.log(remembered)))
        self._held: FloatArray | None = None

    def __call__(self, piece: FloatArray) -> FloatArray:
        """Smoothed samples (N', ...) that are ready: all but the newest `ahead`."""
        new = self._causal(piece)
        held = new if self._held is None else np.concatenate([self._held, new])
        ready = max(len(held) - self.ahead, 0)
        self._held = held[ready:]
        return self._back(held)[:ready] if ready else held[:0]

    def rest(self) -> FloatArray:
        """Smoothed samples that were not ready."""
        return np.empty((0,)) if self._held is None else self._back(self._held)

    def _back(self, held: FloatArray) -> FloatArray:
        return _follow(self._gain, held[::-1], held[-1])[::-1]


def filter_for(walk: float, head: Samples) -> Walk:
    """Filter of a log by its first samples, whose noise is taken as white.

    walk : N in a second.

    Raises DataError where no filter can be made.
    """
    variance, windows = scatter_in_windows(head.time, head.force.reshape(len(head.time), -1))
    if not windows or not np.isfinite(variance).all():
        raise DataError(
            f"the noise cannot be measured from {len(head.time)} samples",
            hint=f"give {FEWEST} finite samples or more",
        )
    noise = float(np.sqrt(variance.mean()))
    return Walk.of(walk, noise, float(np.median(np.diff(head.time))))


def filtered(samples: Iterable[Samples], kind: Kind, model: Walk) -> Iterator[Samples]:
    """Filter the forces of a log that comes in pieces, in bounded memory; anew after a gap."""
    new, longest = Causal if kind == "kalman" else Smoother, _GAP * model.interval
    stage: Causal | Smoother = new(model)
    late: Samples | None = None  # what the smoother holds back, of every stream
    end = -np.inf
    for piece in samples:
        for part in piece.stretches(longest):
            if part.time[0] - end > longest:
                yield from _released(late, stage.rest())
                late, stage = None, new(model)
            end = float(part.time[-1])
            force = stage(part.force)
            whole = part if late is None else Samples.joined([late, part])
            late = whole.rows(slice(len(force), None))
            yield from _released(whole.rows(slice(len(force))), force)
    yield from _released(late, stage.rest())


def _released(samples: Samples | None, force: FloatArray) -> Iterator[Samples]:
    """Samples with filtered forces, if there are any."""
    if samples is not None and len(force):
        yield replace(samples, force=force)
