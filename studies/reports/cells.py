"""Rows of the studies' tables, and their numbers in words."""

from __future__ import annotations

import numpy as np

from studies.runs.ratios import Share
from tdfscal.records import FloatArray

#: A row of a CSV file by the names of its columns; None where there is no number.
Row = dict[str, str | float | int | None]


def number(value: float) -> float | None:
    """A number, None where it is none."""
    return float(value) if np.isfinite(value) else None


def with_error(value: float, std: float) -> str:
    """A number with its standard error, where there are such."""
    if np.isnan(value):
        return "–"
    return f"{value:.3g}" + ("" if np.isnan(std) else f" ± {std:.2g}")


def mean_of(values: FloatArray) -> tuple[float, float]:
    """Mean and standard error over runs (N,); NaN where there are too few."""
    if values.size == 0:
        return np.nan, np.nan
    std = float(np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else np.nan
    return float(values.mean()), std


def mean_se(values: FloatArray, runs: int) -> str:
    """Mean ± standard error of runs, and of how many where some did not come so far."""
    lost = f" ({values.size} of {runs})" if values.size < runs else ""
    return f"{with_error(*mean_of(values))}{lost}"


def share_said(share: Share) -> str:
    """Share of runs with its interval, in per cent."""
    return f"{100 * share.value:.0f} ({100 * share.low:.0f}–{100 * share.high:.0f})"
