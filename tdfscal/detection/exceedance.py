"""How often noise alone crosses a level: samples that are correlated, and noise that is slow.

The noise of one component is a fast part, stationary and Gaussian, on a slow one, an
Ornstein–Uhlenbeck process. Two neighbouring samples of the fast part with correlation ρ lie on
either side of a level of u standard deviations with the probability

    P(x₀ ≤ u < x₁) = (1/2π) ∫ exp(−u² / (1 + cos φ)) dφ,  0 ≤ φ ≤ arccos ρ,

which is Φ(u) (1 − Φ(u)) of white noise and the formula of Rice (1944) of a band-limited one. Its
crossings are taken as a Poisson process; those that the slow part brings together are not: the
rate at which the sum first crosses is the lowest eigenvalue of the slow part's generator with the
fast part's rate as killing (Kac 1951), on a grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.special import ndtr

from tdfscal.records import FloatArray

_NODE, _WEIGHT = np.polynomial.legendre.leggauss(24)
#: Places of the slow part, over how many of its standard deviations either side.
_PLACES, _REACH = 141, 6.0
#: Levels at which rates are worked out and between which they are interpolated, in standard
#: deviations of the noise; and how fine the table is that is looked up.
_LEVELS = np.concatenate([np.linspace(-8.0, -3.0, 6), np.linspace(-2.0, 10.0, 37)])
_FINE = 4001
#: Rates, per s, below which and above which none is told apart from 0 and from ∞.
_LEAST, _MOST = 1e-40, 1e12
_SMALL = 1e-12


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of a component of the wrench, as a controller sees it after its filter; N or N·m.

    fast : standard deviation of what changes from sample to sample, and correlation : of
    neighbouring samples of it. slow : standard deviation of what outlasts them, and relaxation : s,
    in which it is forgotten. interval : s, between samples.
    """

    fast: float
    correlation: float
    slow: float
    relaxation: float
    interval: float

    @property
    def std(self) -> float:
        """Standard deviation of a sample."""
        return float(np.hypot(self.fast, self.slow))


def crossing_probability(level: FloatArray, correlation: float) -> FloatArray:
    """Probability that of two neighbouring samples the first lies below a level, the second above.

    level : in standard deviations.
    """
    end = np.arccos(np.clip(correlation, -1.0, 1.0))
    angle = end * (_NODE + 1.0) / 2.0
    # Near π the exponent is −∞ for any level but 0.
    falloff = -np.square(level)[..., None] / np.maximum(1.0 + np.cos(angle), _SMALL)
    return np.asarray(np.exp(falloff) @ _WEIGHT * end / (4.0 * np.pi))


def fast_rate(level: FloatArray, correlation: float, interval: float) -> FloatArray:
    """Rate, 1/s, at which samples that lay below a level cross it; level in standard deviations."""
    below = np.maximum(ndtr(level), 1e-300)
    chance = np.minimum(crossing_probability(level, correlation) / below, 1.0 - _SMALL)
    return np.asarray(-np.log1p(-chance) / interval)


@dataclass(frozen=True, slots=True)
class Crossings:
    """First crossings of a level on one side, over levels in N or N·m from `first` by `step`.

    rate : (L,), 1/s. begun : (L,), −ln of the probability that all begins below the level.
    """

    first: float
    step: float
    rate: FloatArray
    begun: FloatArray

    def at(self, level: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rate, and what it begins with, at levels of any shape."""
        place = np.clip((level - self.first) / self.step, 0.0, len(self.rate) - 1.000001)
        low = place.astype(np.intp)
        share = place - low
        rate, begun = (
            values[low] + slope[low] * share
            for values, slope in (
                (self.rate, np.diff(self.rate)),
                (self.begun, np.diff(self.begun)),
            )
        )
        return np.asarray(rate), np.asarray(begun)


@lru_cache(maxsize=64)
def crossings(noise: Noise) -> Crossings:
    """Tabulate the first crossings of a level by a noise whose standard deviation is not 0."""
    size = noise.std
    rate, begun = np.empty(len(_LEVELS)), np.empty(len(_LEVELS))
    if noise.slow <= _SMALL * size:
        rate = fast_rate(_LEVELS, noise.correlation, noise.interval)
        begun = -np.log(np.maximum(ndtr(_LEVELS), 1e-300))
    else:
        x = np.linspace(-_REACH, _REACH, _PLACES)
        diffusion = 1.0 / (noise.relaxation * (x[1] - x[0]) ** 2)
        half = np.exp(-0.25 * x**2)  # √ of the stationary density
        up = np.append(half[1:] / half[:-1], 0.0)
        down = np.append(0.0, half[:-1] / half[1:])
        root = half / np.linalg.norm(half)
        fast = max(noise.fast, 1e-3 * size)
        for k, level in enumerate(_LEVELS):
            over = (level * size - noise.slow * x) / fast
            kill = fast_rate(over, noise.correlation, noise.interval)
            value, vector = eigh_tridiagonal(
                diffusion * (up + down) + np.minimum(kill, _MOST),
                np.full(_PLACES - 1, -diffusion),
                select="i",
                select_range=(0, 0),
            )
            rate[k] = max(value[0], _LEAST)
            ground = np.abs(vector[:, 0])
            begun[k] = -np.log((ground @ root) * (ground @ (root * ndtr(over))) + 1e-300)
    fine = np.linspace(_LEVELS[0], _LEVELS[-1], _FINE)
    fall, falls = (0.5 * np.maximum(u, 0.0) ** 2 for u in (_LEVELS, fine))
    smooth = [
        np.exp(np.interp(fine, _LEVELS, np.log(np.clip(values, _LEAST, _MOST)) + fall) - falls)
        for values in (rate, begun)
    ]
    return Crossings(fine[0] * size, (fine[1] - fine[0]) * size, *smooth)
