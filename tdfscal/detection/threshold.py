"""The threshold that a path without contact exceeds seldom enough, and the contact that exceeds it.

What the calibration leaves uncertain is one draw x per machine: at a place of the path it makes a
wrench a·x, the same noise on top everywhere. The probability that |a·x + noise| exceeds a threshold
anywhere on the path is the mean over x of what the noise does given x (below). It is worked
out by importance sampling: with p_b what it would be if all of the path were like place b, a place
is drawn with a probability as p_b, then a_b·x as it is where that stops, then the rest of x freely;
the mean of P(stop | x) Σ p_b / Σ P(stop at b | x) is then the probability, with a relative error
that does not grow as it gets small (Adler, Blanchet and Liu, Ann. Appl. Probab. 22, 2012).

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

from functools import lru_cache

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.special import ndtr

from tdfscal.frozen import record
from tdfscal.records import FloatArray

#: Draws behind a probability, and the places across which a single one is integrated.
_DRAWS = 1024
_ACROSS = np.linspace(-8.5, 8.5, 681)
#: Places this close to each other, as a share of what stands at the worst, are one.
_ALIKE = 0.02
#: Share of the variance along the path that is left out with the least of its modes.
_LEFT_OUT = 1e-4
#: How close a threshold is come to, in standard deviations.
_CLOSE = 1e-4


@record
class Places:
    """A component along the path: what one machine has on it at B places, for r draws.

    factor : (B, r), N or N·m by standard normal numbers. share : (B,), of the path's time.
    """

    factor: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, factor: FloatArray, weight: FloatArray, noise: float) -> Places:
        """Reduce places (N, R) with times (N,): fewer draws, and like places together."""
        values, vectors = np.linalg.eigh(factor @ factor.T)
        values = np.maximum(values[::-1], 0.0)
        most = 1 + int(np.searchsorted(np.cumsum(values), (1 - _LEFT_OUT) * values.sum()))
        if values[0] > 0.0:
            factor = vectors[:, ::-1][:, :most] * np.sqrt(values[:most])
        else:
            factor = np.zeros((len(factor), 1))
        near = _ALIKE * (np.linalg.norm(factor, axis=1).max() + noise)
        # The farthest from all that were taken is taken next.
        taken = [int(np.argmax(np.linalg.norm(factor, axis=1)))]
        away = np.linalg.norm(factor - factor[taken[0]], axis=1)
        nearest = np.zeros(len(factor), dtype=np.intp)
        while away.max() > near:
            taken.append(int(np.argmax(away)))
            new = np.linalg.norm(factor - factor[taken[-1]], axis=1)
            nearest[new < away] = len(taken) - 1
            away = np.minimum(away, new)
        share = np.bincount(nearest, weight, len(taken))
        return cls(factor[taken], share / share.sum())

    @property
    def std(self) -> FloatArray:
        """Standard deviation (B,) at each place."""
        return np.asarray(np.linalg.norm(self.factor, axis=1))


@record
class Watch:
    """A threshold on one component over a path of a duration, s."""

    places: Places
    noise: Noise
    duration: float

    def threshold(self, probability: float) -> float:
        """Return the threshold, N or N·m, that is exceeded on the path with this probability."""
        total = float(np.hypot(self.places.std.max(), self.noise.std))
        if total == 0.0:
            return 0.0
        from scipy.optimize import brentq  # slow to import, seldom needed

        chance, wanted = _Chance.of(self, total), float(np.log(probability))

        def excess(level: float) -> float:
            """What ln P, nearly straight, has above the one that is wanted; it is 0 at 0."""
            return (np.log(max(chance(level), 1e-300)) if level else 0.0) - wanted

        high = 2.0 * total
        while excess(high) > 0.0:
            high *= 1.5
        return float(brentq(excess, 0.0, high, xtol=_CLOSE * total))

    def smallest_contact(self, threshold: float, probability: float) -> float:
        """Return the contact that exceeds a threshold with this probability at any time.

        What is there at a time is what this machine has on it, and the noise of that sample.
        """
        std = np.hypot(self.places.std, self.noise.std)
        if not std.max() > 0.0:
            return threshold
        from scipy.optimize import brentq  # slow to import, seldom needed

        def excess(contact: float) -> float:
            above = (np.array([[contact], [-contact]]) - threshold) / np.maximum(std, 1e-300)
            return float(self.places.share @ ndtr(above).sum(axis=0)) - probability

        return float(brentq(excess, 0.0, threshold + 9.0 * std.max())) if excess(0.0) < 0 else 0.0


@record
class _Chance:
    """Probability that a threshold is exceeded, the same draws for every threshold."""

    watch: Watch
    table: Crossings
    direction: FloatArray
    free: FloatArray
    uniform: FloatArray

    @classmethod
    def of(cls, watch: Watch, total: float) -> _Chance:
        noise, std = watch.noise, watch.places.std
        if noise.std <= 1e-6 * total:  # hardly any: half a step of `_ACROSS` smooths the stairs
            noise = Noise(1.5e-2 * total, 0.0, 0.0, 1.0, np.inf)
        factor = watch.places.factor
        unit = np.zeros_like(factor)
        unit[:, 0] = 1.0
        np.divide(factor, std[:, None], out=unit, where=std[:, None] > 0)
        rng = np.random.default_rng(0)
        free = rng.standard_normal((_DRAWS, factor.shape[1]))
        uniform = (rng.permutation(_DRAWS) + 0.5) / _DRAWS
        return cls(watch, crossings(noise), unit, free, uniform)

    def __call__(self, threshold: float) -> float:
        places, T = self.watch.places, self.watch.duration
        spread = places.std[:, None] * _ACROSS  # (B, X)
        rate, begun = self._crossed(threshold, spread)
        alone = -np.expm1(-(rate * T + begun)) * np.exp(-0.5 * _ACROSS**2)
        step = (_ACROSS[1] - _ACROSS[0]) / np.sqrt(2.0 * np.pi)
        each = alone.sum(axis=1) * step
        total = float(each.sum())
        if not total > 0.0:
            return 0.0
        ends = np.cumsum(each) / total
        which = np.minimum(np.searchsorted(ends, (np.arange(_DRAWS) + 0.5) / _DRAWS), len(each) - 1)
        along = np.empty(_DRAWS)
        for b in np.unique(which):
            rows = which == b
            cumulative = np.cumsum(alone[b])
            along[rows] = np.interp(
                self.uniform[rows], (cumulative - 0.5 * alone[b]) / cumulative[-1], _ACROSS
            )
        unit = self.direction[which]
        x = self.free + (along - np.einsum("nr,nr->n", self.free, unit))[:, None] * unit
        rate, begun = self._crossed(threshold, x @ places.factor.T)  # (N, B)
        stopped = -np.expm1(-(rate @ places.share * T + begun.max(axis=1)))
        each_alone = -np.expm1(-(rate * T + begun))
        return total * float(np.mean(stopped / each_alone.sum(axis=1)))

    def _crossed(self, threshold: float, there: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rate on both sides, 1/s, and what it begins with, with so much on the wrench."""
        low, high = self.table.at(threshold - there), self.table.at(threshold + there)
        return low[0] + high[0], low[1] + high[1]


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


@record
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


@record
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
