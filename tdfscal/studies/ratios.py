"""Ratios of means over paired runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.records import FloatArray


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
