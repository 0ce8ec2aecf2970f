"""Noise that is slower than a stop: variance of a stop's mean from a fitted spectrum.

A mean scatters by what lies below the lowest frequency that a stop shows, so the spectrum is
carried on: white noise with one relaxation (a first-order autoregression), or with 1/f noise, each
as likely as Whittle's likelihood has it. Means of 1/f noise of spectral density A/f over stops of
length T scatter over a campaign of length C by A ln(C/T); what is slower is the zero's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import SLOW_NOISE

_PER_OCTAVE = 6  # bands in which ordinates are averaged
_RELAXATIONS = 31  # time constants tried
_UNLIKELY = 1e-4
_FEWEST = 40  # ordinates
_RATIOS = np.geomspace(1e-2, 1e5, 43)  # of the slow part to the white one, at the lowest frequency


@dataclass(frozen=True, slots=True)
class SlowNoise:
    """Two-sided spectra white + slow · shape(f), f in cycles per bin, per sample, N², G of them.

    relaxation : (G,), bins, of the shape of an autoregression of variance 1; ∞: the shape is 1/f.
    weight : (G,), how likely each is.
    """

    white: FloatArray
    slow: FloatArray
    relaxation: FloatArray
    weight: FloatArray

    def spectrum(self, frequency: FloatArray) -> FloatArray:
        """The likeliest at frequencies (F,), cycles per bin."""
        k = int(np.argmax(self.weight))
        shape = _shapes(tuple(self.relaxation[k : k + 1]), tuple(frequency.tolist()))[0]
        return np.asarray(self.white[k] + self.slow[k] * shape)

    def of_mean(self, length: IntArray, campaign: float) -> FloatArray:
        """Variance to expect of means over so many bins (K,) times that length."""
        T = np.asarray(length, dtype=np.float64)[:, None]
        forever = np.isinf(self.relaxation)
        pole = np.where(forever, 0.0, np.exp(-1.0 / self.relaxation))
        end = 2.0 * pole * (1.0 - pole**T) / (T * (1.0 - pole) ** 2)
        relaxed = (1.0 + pole) / (1.0 - pole) - end
        flicker = 2.0 * T * np.log(np.maximum(campaign / T, 1.0))
        reach = np.where(forever, flicker, relaxed)
        return np.asarray((self.white + self.slow * reach) @ self.weight)


def slow_noise(frequency: FloatArray, power: FloatArray, length: float) -> list[SlowNoise | None]:
    """Fit squared ordinates (A, F) of axes of one kind at ascending frequencies, each axis alone.

    Axes share what is slow, and how it compares with the white noise unless far likelier otherwise.
    None where white noise is about as likely. length : of a stop, bins; what relaxes slower looks
    like this or 1/f noise.
    """
    alive = power.any(axis=1)
    found: list[SlowNoise | None] = [None] * len(power)
    if power.shape[1] < _FEWEST or not alive.any():
        return found
    power = power[alive]
    octave = np.floor(_PER_OCTAVE * np.log2(frequency / frequency[0]))
    first = np.flatnonzero(np.diff(octave, prepend=-1.0))
    count = np.diff(np.append(first, power.shape[1]))
    middle = np.add.reduceat(frequency, first) / count
    mean, share = np.add.reduceat(power, first, axis=1) / count, count / count.sum()
    taus = (np.inf, *np.geomspace(0.5, max(length, 1.0), _RELAXATIONS).tolist())
    slow = _shapes(taus, tuple(middle.tolist()))
    shape = 1.0 + _RATIOS[:, None] * (slow / slow[:, :1])[:, None]  # (M, R, B)
    # −2 ln L = N ln σ² + Σ ln shape, σ² the mean of power / shape.
    white = np.einsum("ab,mrb->mra", mean * share, 1.0 / shape)
    cost = power.shape[1] * (np.log(white) + (np.log(shape) @ share)[..., None])
    plain = float(power.shape[1] * np.log(mean @ share).sum())
    least = float(cost.min(axis=1).sum(axis=1).min())
    if plain - least <= SLOW_NOISE:
        return found
    weight = _weights(cost, float(np.log(power.size)))
    for axis, place in enumerate(np.flatnonzero(alive)):
        m, r = np.nonzero(weight[..., axis] > _UNLIKELY)
        likely, level = weight[m, r, axis], white[m, r, axis]
        found[place] = SlowNoise(
            level, level * _RATIOS[r] / slow[m, 0], np.array(taus)[m], likely / likely.sum()
        )
    return found


def _weights(cost: FloatArray, unknown: float) -> FloatArray:
    """How likely models, ratios and axes (M, R, A) are by their −2 ln L; for each axis 1 in sum.

    1/f noise, the first model, is as likely before as all relaxations. unknown : what a ratio for
    each axis costs (Schwarz, Ann. Stat. 6, 1978).
    """
    before = 2.0 * np.log(len(cost) - 1.0) * (np.arange(len(cost)) > 0)
    alike = cost.sum(axis=2) + before[:, None]
    apart = cost.min(axis=1).sum(axis=1) + before
    if alike.min() <= apart.min() + unknown * (cost.shape[2] - 1):
        weight = np.repeat(np.exp(-0.5 * (alike - alike.min()))[..., None], cost.shape[2], axis=2)
    else:
        ratio = np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
        ratio /= ratio.sum(axis=1, keepdims=True)
        weight = np.exp(-0.5 * (apart - apart.min()))[:, None, None] * ratio
    return np.asarray(weight / weight.sum(axis=(0, 1)))


@lru_cache(maxsize=8)
def _shapes(relaxation: tuple[float, ...], frequency: tuple[float, ...]) -> FloatArray:
    """Spectra (M, F) of what may be slow: relaxations, or 1/f where it is ∞."""
    f, tau = np.array(frequency), np.array(relaxation)[:, None]
    pole = np.where(np.isinf(tau), 0.0, np.exp(-1.0 / tau))
    relaxed = (1.0 - pole**2) / (1.0 - 2.0 * pole * np.cos(2.0 * np.pi * f) + pole**2)
    return np.asarray(np.where(np.isinf(tau), 1.0 / f, relaxed))
