"""Numbers with their standard errors, and the tests of the studies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from tdfscal.records import FloatArray

#: That an unbiased study is called biased, all its angles together.
FALSE_BIAS = 0.01
#: Standard errors within which two numbers are the same.
SAME = 2.0
#: Chance below which a number is none of the runs'.
UNLIKELY = 0.05


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard error over the runs; NaN where there is none."""

    value: float
    std: float = float("nan")

    def __str__(self) -> str:
        if np.isnan(self.value):
            return "–"
        if not self.std > 0.0:
            return f"{self.value:.3g}".replace("-", "−")
        # Two digits of the standard error where it begins with 1, else one.
        digits = -int(np.floor(np.log10(self.std / 2.0 + 1e-300)))
        if digits <= 0:
            value, std = (f"{round(number, digits):.0f}" for number in (self.value, self.std))
            return f"{value} ± {std}".replace("-", "−")
        return f"{self.value:.{digits}f} ± {self.std:.{digits}f}".replace("-", "−")


def mean(values: FloatArray) -> Estimate:
    """Of runs (N,), those that are not NaN."""
    own = values[np.isfinite(values)]
    if own.size == 0:
        return Estimate(np.nan)
    std = float(np.std(own, ddof=1) / np.sqrt(own.size)) if own.size > 1 else np.nan
    return Estimate(float(own.mean()), std)


def jackknife(function: Callable[..., float], *samples: FloatArray) -> Estimate:
    """Of any function of paired samples (N, …), by leaving out one run after the other."""
    n = len(samples[0])
    keep = ~np.eye(n, dtype=np.bool_)
    value = float(function(*samples))
    if n < 3:
        return Estimate(value)
    each = np.array([function(*(s[k] for s in samples)) for k in keep])
    return Estimate(value, float(np.sqrt((n - 1) * np.mean((each - each.mean()) ** 2))))


def ratio(a: FloatArray, b: FloatArray) -> Estimate:
    """mean(a) / mean(b) of paired runs (N,), over those that both have."""
    both = np.isfinite(a) & np.isfinite(b)
    if not both.any() or b[both].mean() == 0.0:
        return Estimate(np.nan)
    return jackknife(lambda x, y: x.mean() / y.mean(), a[both], b[both])


def deviation(error: FloatArray) -> float:
    """Mean over the angles of their standard deviations over the runs; error (N, …)."""
    return float(np.mean(np.std(error, axis=0, ddof=1)))


def root_mean_square(error: FloatArray) -> float:
    """Over runs and angles (N, …)."""
    return float(np.sqrt(np.mean(error**2)))


def bias_probability(error: FloatArray) -> float:
    """That unbiased angles have a mean as far from 0 as the worst of these, error (N, …).

    Student's t of each angle with N − 1 degrees of freedom, Bonferroni over the angles.
    """
    n = len(error)
    t = error.mean(axis=0) / (np.std(error, axis=0, ddof=1) / np.sqrt(n))
    p = 2.0 * stdtr(n - 1, -np.abs(t))
    return float(min(1.0, np.min(p) * np.size(p)))


def drawn_alike(number: float, draws: FloatArray, bound: str = "") -> float:
    """Chance that one more run lies as far out as a number, by draws (N,); NaN of fewer than 3.

    Student's t of a new observation, N − 1 degrees of freedom, of logarithms where all are above
    zero. bound : "<" or ">": the chance that one more run lies on that side of the number.
    """
    n = len(draws)
    if n < 3 or np.ptp(draws) == 0.0:
        return float("nan")
    values = draws
    if number > 0.0 and np.all(draws > 0.0):
        number, values = np.log(number), np.log(draws)
    t = (number - values.mean()) / (np.std(values, ddof=1) * np.sqrt(1.0 + 1.0 / n))
    if bound:
        return float(stdtr(n - 1, t if bound == "<" else -t))
    return float(2.0 * stdtr(n - 1, -abs(t)))
