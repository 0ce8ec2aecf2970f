"""Ratios of means over paired runs, and shares of runs with their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from tdfscal.records import BoolArray, FloatArray
from tdfscal.significance import INTERVAL_COVERAGE


@dataclass(frozen=True, slots=True)
class Ratio:
    """A ratio of means with its standard error; std NaN for a single run, both without any."""

    value: float
    std: float


def ratio(a: FloatArray, b: FloatArray) -> Ratio:
    """mean(a) / mean(b) of paired runs (N,); its standard error from the residuals a − ρ b.

    Cochran, Sampling Techniques, Eq. 2.39.
    """
    n = len(a)
    if n == 0 or b.mean() == 0.0:
        return Ratio(np.nan, np.nan)
    value = float(a.mean() / b.mean())
    spread = float(np.std(a - value * b, ddof=1)) if n > 1 else np.nan
    return Ratio(value, spread / (abs(float(b.mean())) * float(np.sqrt(n))))


@dataclass(frozen=True, slots=True)
class Share:
    """Runs of which something holds, with the binomial interval of its probability."""

    count: int
    runs: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Estimate of the probability."""
        return self.count / self.runs


def share(holds: BoolArray) -> Share:
    """Clopper and Pearson's interval of `significance.INTERVAL_COVERAGE`, of runs (N,)."""
    k, n = int(np.sum(holds)), len(holds)
    tail = 0.5 * (1.0 - INTERVAL_COVERAGE)
    low = float(betaincinv(k, n - k + 1, tail)) if k else 0.0
    high = float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0
    return Share(k, n, low, high)
