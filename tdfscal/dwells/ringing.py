"""What rings or creeps alike after every move of a log: found on all stops together.

One stop alone does not tell slow ringing from a level: a crest is flat for a while. But the mode is
one of the machine, y = c + Re(a e^{−λt}) with λ = 1/τ − iω common to all stops, and it starts when
the NCPs come to rest. Noise, vibration and drift do not know which end of a stop is its begin: the
same stops read backwards show how much of them such a shape explains by chance.

Slow noise has more of a slow shape than of a fast one. Where what the mode leaves of the stops is
correlated, it is looked for again with shapes and stops whitened by the noise's autoregression.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.special import fdtrc

from tdfscal.dwells.dwell_means import evenly
from tdfscal.frozen import record
from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import RINGING_PER_LOG

_STOPS = 40  # that the mode is looked for in
_FEWEST = 5
_USUAL, _MOST = 0.5, 100.0  # quantile of what the stops show; how many times that one may show
_SHORTEST = 8  # bins
_LONGEST = 12.0  # s of a stop that are looked at
_SLOWEST, _CONSTANTS = 5.0, 8  # s; time constants tried
_LOWEST, _HIGHEST, _FREQUENCIES = 0.1, 6.0, 16  # Hz; frequencies tried, besides none
_ROUNDS, _CLOSE = 24, 1e-3  # parabolas at most; relative distance of the last one's decays
_LASTING = 6.0  # time constants after which nothing is left to fit
_MEMORY = 2  # order of the noise's autoregression
_WHITE = 4.0  # standard deviations by which correlations of white noise stay below

ComplexArray = npt.NDArray[np.complex128]
Memory = Sequence[tuple[float, FloatArray]]
"""An autoregression: for bins 0, 1, … of a stop, the last for all that follow, how many times wider
the noise of the later bins is than its own once φ (k,) of the k bins before it is taken off."""


@record
class Ringing:
    """The mode and how much of it each stop has.

    decay : λ per bin. width : of a bin, s. first, last : (R,), the stops in bins.
    amplitude : (R, A), a at the begin of each stop, N. power : (R, A), E|a|² given the data, N².
    """

    decay: complex
    width: float
    first: IntArray
    last: IntArray
    amplitude: ComplexArray
    power: FloatArray

    @property
    def constant(self) -> float:
        """Time constant, s."""
        return float(self.width / self.decay.real)

    @property
    def frequency(self) -> float:
        """Hz; 0 where it creeps and does not swing."""
        return float(abs(self.decay.imag) / (2 * np.pi * self.width))

    def removed(self, value: FloatArray) -> FloatArray:
        """The forces (A, B) without it."""
        value = value.copy()
        for a, b, amplitude in zip(self.first, self.last, self.amplitude, strict=True):
            wave = np.exp(-self.decay * np.arange(b - a))
            value[:, a:b] -= (amplitude[:, None] * wave).real
        return value

    def left(self, rest: int, start: IntArray, end: int) -> FloatArray:
        """Bias that it may leave in means over bins [start, end) of the stop at bin `rest`, (S, A).

        Whatever its phase: that is known to no more than the mode is one and the same.
        """
        k = int(np.searchsorted(self.first, rest))
        if k == len(self.first) or self.first[k] != rest:
            return np.zeros((len(start), self.power.shape[1]))
        tail = np.exp(-self.decay * (start - rest)) * -np.expm1(-self.decay * (end - start))
        mean = np.abs(tail / np.expm1(-self.decay)) / (end - start)
        return np.asarray(mean[:, None] * np.sqrt(self.power[k]))


def find_ringing(
    value: FloatArray, noise: FloatArray, first: IntArray, last: IntArray, width: float
) -> Ringing | None:
    """Look for a mode common to the stops [first, last) in bins; None where there is none.

    value : (A, B), forces. noise : (A,), standard deviation of a bin. width : of a bin, s.
    """
    long = last - first >= _SHORTEST
    first, last = first[long], last[long]
    noisy = noise > 0
    if len(first) < _FEWEST or not noisy.any() or round(_LONGEST / width) < _SHORTEST:
        return None
    some = evenly(len(first), _STOPS)
    scaled = [
        value[noisy, a:b] / noise[noisy, None] for a, b in zip(first[some], last[some], strict=True)
    ]
    decay, memory = _likeliest(scaled, width, ()), list[tuple[float, FloatArray]]()
    if decay is not None and (memory := _memory(scaled, decay)):
        decay = _likeliest(scaled, width, memory)
    if decay is None:
        return None
    return _in_all_stops(value, noise, first, last, decay, width, memory)


def _waves(decays: Sequence[complex], most: int, memory: Memory) -> FloatArray:
    """Two shapes of each decay (G,) over the first bins of a stop, whitened, (G, 2, most)."""
    wave = np.exp(-np.asarray(decays)[:, None] * np.arange(most))
    return _whitened(np.stack([wave.real, -wave.imag], axis=1), memory)


@record
class _Products:
    """Shapes (G, 2, N) and a stop (A, N), whitened and less their levels.

    gram : (G, 2, 2), products of the shapes; seen : (G, 2, A), of shapes and stop.
    """

    shapes: FloatArray
    stop: FloatArray
    gram: FloatArray
    seen: FloatArray

    @classmethod
    def of(cls, waves: FloatArray, stop: FloatArray, memory: Memory) -> _Products:
        """Take a stop (A, N) as it is, and waves that may be longer."""
        level = _whitened(np.ones(stop.shape[1]), memory)
        level /= np.sqrt(level @ level)
        shapes = waves[..., : stop.shape[1]]
        shapes = shapes - (shapes @ level)[..., None] * level
        stop = _whitened(stop - stop.mean(axis=1, keepdims=True), memory)
        stop = stop - (stop @ level)[:, None] * level
        gram = shapes @ np.swapaxes(shapes, 1, 2)
        # Two shapes that are nearly one, or the second that is none, must not divide by zero.
        gram += 1e-9 * gram[..., :1, :1] * np.eye(2)
        return cls(shapes, stop, gram, shapes @ stop.T)

    @property
    def explained(self) -> FloatArray:
        """Sum of squares of each axis that each decay explains, (G, A)."""
        return np.asarray((self.seen * np.linalg.solve(self.gram, self.seen)).sum(axis=1))

    @property
    def rest(self) -> FloatArray:
        """The stop (A, N) without the first decay."""
        fitted = np.linalg.solve(self.gram[0], self.seen[0])
        return np.asarray(self.stop - fitted.T @ self.shapes[0])


def _explained(
    stops: Sequence[FloatArray], decays: Sequence[complex], memory: Memory
) -> FloatArray:
    """Sum of squares of each of S stops (A, N) that each decay explains, (S, G)."""
    waves = _waves(decays, max(stop.shape[1] for stop in stops), memory)
    return np.array([_Products.of(waves, stop, memory).explained.sum(axis=1) for stop in stops])


def _likeliest(stops: Sequence[FloatArray], width: float, memory: Memory) -> complex | None:
    """The decay that explains more of the stops (A, N) than of them read backwards by most."""
    most = round(_LONGEST / width)
    slowest = min(_SLOWEST / width, float(np.median([stop.shape[1] for stop in stops])))
    constants = np.geomspace(2.0, max(slowest, 4.0), _CONSTANTS)
    frequencies = np.geomspace(_LOWEST, min(_HIGHEST, 0.2 / width), _FREQUENCIES)
    decays = [
        complex(1.0 / tau, -2.0 * np.pi * f * width) for tau in constants for f in (0, *frequencies)
    ]
    forth = [stop[:, :most] for stop in stops]
    begins = _explained(forth, decays, memory)
    ends = _explained([stop[:, ::-1][:, :most] for stop in stops], decays, memory)
    usual = _weights(np.maximum(begins, ends)) == 1.0
    begins, ends = (np.sum(explained, axis=0, where=usual) for explained in (begins, ends))
    best = int(np.argmax(begins - ends))
    # As many independent numbers as stops, shapes and sensors: the axes of one may move as one.
    dof = (
        usual[:, best].sum() * (1 if decays[best].imag == 0 else 2) * max(len(stops[0]) / 3.0, 1.0)
    )
    if fdtrc(dof, dof, begins[best] / max(ends[best], 1e-300)) > RINGING_PER_LOG:
        return None
    # A wrong reading that this shape does not see would draw the search to one that does.
    kept = np.flatnonzero(usual.all(axis=1))
    return _refined([forth[k] for k in kept], decays[best], memory) if len(kept) else None


def _weights(shown: FloatArray) -> FloatArray:
    """What each stop counts, by what it shows (S, G): none for much more than is usual.

    A step in one stop, of a signal that dropped out, would else be a mode of all.
    """
    most = _MOST * np.quantile(shown, _USUAL, axis=0)
    return np.divide(most, shown, out=np.ones_like(shown), where=shown > most)


def _memory(stops: Sequence[FloatArray], decay: complex) -> list[tuple[float, FloatArray]]:
    """Autoregression of the stops' noise, by Yule and Walker; none where it is white.

    From the later halves of the stops (A, N), without the decay.
    """
    waves = _waves([decay], max(stop.shape[1] for stop in stops), ())
    each, count = np.zeros((len(stops), _MEMORY + 1)), 0
    for own, stop in zip(each, stops, strict=True):
        rest = _Products.of(waves, stop, ()).rest[:, stop.shape[1] // 2 :]
        rest = rest - rest.mean(axis=1, keepdims=True)
        own[:] = [np.sum(rest[:, k:] * rest[:, : rest.shape[1] - k]) for k in range(_MEMORY + 1)]
        count += rest.size
    lags = np.sum(_weights(each[:, :1]) * each, axis=0)
    if np.abs(lags[1:]).max() <= _WHITE * lags[0] / np.sqrt(count):
        return []
    lag = np.arange(_MEMORY)
    steps = [
        np.linalg.solve(lags[np.abs(lag[:k] - lag[:k, None])], lags[1 : k + 1])
        for k in range(_MEMORY + 1)
    ]
    left = [float(lags[0] - phi @ lags[1 : k + 1]) for k, phi in enumerate(steps)]
    return [(np.sqrt(left[-1] / own), phi) for own, phi in zip(left, steps, strict=True)]


def _whitened(value: FloatArray, memory: Memory) -> FloatArray:
    """Values (..., N) without what the bins before them say; all as noisy as the last."""
    white = value.copy()
    for k, (factor, phi) in enumerate(memory):
        here = slice(k, k + 1 if k < len(memory) - 1 else None)
        for back, part in enumerate(phi, 1):
            white[..., here] -= part * value[..., k - back :][..., : white[..., here].shape[-1]]
        white[..., here] *= factor
    return white


def _refined(stops: Sequence[FloatArray], decay: complex, memory: Memory) -> complex:
    """The decay that explains most, from one close to it: parabolas through ever closer decays."""
    at = np.array([np.log(decay.real), decay.imag][: 2 if decay.imag else 1])
    step = np.array([0.3, 0.15 * abs(decay.imag)][: len(at)])
    around = np.array(list(product((-1.0, 0.0, 1.0), repeat=len(at))))
    for _ in range(_ROUNDS):
        tried = at + step * around
        decays = [complex(np.exp(x[0]), x[1] if len(x) > 1 else 0.0) for x in tried]
        explained = _explained(stops, decays, memory).sum(axis=0)
        best, top = around[np.argmax(explained)], _top_of_parabola(around, explained)
        if top is None or (np.abs(top) > 1.0).any():
            top = best
        at = at + step * top
        if top is not best or not best.any():
            step = step / 4.0
        if step[0] < _CLOSE:
            break
    return complex(np.exp(at[0]), at[1] if len(at) > 1 else 0.0)


def _top_of_parabola(x: FloatArray, value: FloatArray) -> FloatArray | None:
    """Where the parabola fitted to values (G,) at x (G, D) is highest; None where it has no top."""
    first, second = np.triu_indices(x.shape[1])
    terms = np.column_stack([np.ones(len(x)), x, x[:, first] * x[:, second]])
    fit = np.linalg.lstsq(terms, value, rcond=None)[0]
    gradient, curvature = fit[1 : 1 + x.shape[1]], np.zeros((x.shape[1],) * 2)
    curvature[first, second] = fit[1 + x.shape[1] :]
    curvature += curvature.T
    if np.linalg.eigvalsh(curvature).max() >= 0.0:
        return None
    return np.asarray(-np.linalg.solve(curvature, gradient))


def _in_all_stops(
    value: FloatArray,
    noise: FloatArray,
    first: IntArray,
    last: IntArray,
    decay: complex,
    width: float,
    memory: Memory,
) -> Ringing:
    """Amplitudes given the mode: normal, with a width that all stops show together."""
    length = np.minimum(last - first, round(_LASTING / decay.real) + _SHORTEST)
    waves = _waves([decay], int(length.max()), memory)
    gram, seen = np.empty((len(first), 2, 2)), np.empty((len(first), 2, len(value)))
    back, rough = np.empty((len(first), len(value))), np.empty((len(first), len(value)))
    for k, (a, b, n) in enumerate(zip(first, last, length, strict=True)):
        own = _Products.of(waves, value[:, a : a + n], memory)
        gram[k], seen[k], rough[k] = own.gram[0], own.seen[0], _of_long_means(own.rest)
        back[k] = _Products.of(waves, value[:, b - n : b][:, ::-1], memory).explained[0]
    rank = 2 if decay.imag else 1
    # The stops read backwards show the noise, unless they ring to their ends; then what the mode
    # does not explain has to.
    variance = np.minimum(np.median(back, axis=0) / rank, np.median(rough, axis=0))
    variance = np.maximum(variance, noise**2)
    explained = (seen * np.linalg.solve(gram, seen)).sum(axis=1)
    explained = _weights(explained) * explained - rank * variance
    size = np.trace(gram, axis1=1, axis2=2).sum()
    prior = np.maximum(explained.sum(axis=0), 0.0) / size
    amplitude = np.zeros((len(first), 2, len(value)))
    power = np.zeros((len(first), len(value)))
    for axis in np.flatnonzero((prior > 0) & (variance > 0)):
        information = gram / variance[axis] + np.eye(2) / prior[axis]
        covariance = np.linalg.inv(information)[:, :rank, :rank]
        given = covariance @ seen[:, :rank, axis, None] / variance[axis]
        amplitude[:, :rank, axis] = given[..., 0]
        power[:, axis] = (given**2).sum(axis=(1, 2)) + np.trace(covariance, axis1=1, axis2=2)
    return Ringing(decay, width, first, last, amplitude[:, 0] + 1j * amplitude[:, 1], power)


def _of_long_means(value: FloatArray) -> FloatArray:
    """Variance per bin in the means of windows, the largest of windows up to a quarter, (A,)."""
    total = np.zeros((len(value), value.shape[1] + 1))
    np.cumsum(value, axis=1, out=total[:, 1:])
    largest = np.zeros(len(value))
    width = 1
    while 4 * width <= value.shape[1]:
        change = np.diff(total[:, ::width], n=2, axis=1) / width
        np.maximum(largest, 0.5 * width * np.mean(change**2, axis=1), out=largest)
        width *= 2
    return largest
