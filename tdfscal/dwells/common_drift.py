"""Drift that all stops of a log share."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from tdfscal.records import FloatArray, IntArray
from tdfscal.significance import DRIFT_PER_LOG

_MANY = 10  # stops that show what is common
_ALIKE = 0.8  # share of them with one sign
_MEDIAN = 1.2533141373155003  # standard error of a median / that of a mean, Gaussian
_LAST = 0.75  # of a stop: what comes before is settling, as a rule
_SHORTEST = 8  # bins


def common_drift(slope: FloatArray, length: FloatArray) -> FloatArray:
    """Drift (A,) of slopes (K, A) of stops of some length (K,); 0 where they show none.

    Settling takes the sign of the move before it; the drift of a zero keeps its own. The noise of a
    slope goes with the length to the power of −3/2.
    """
    if len(slope) < _MANY:
        return np.zeros(slope.shape[1])
    weight = length[:, None] ** 1.5
    middle = _median(slope, weight)
    alike = (weight * (np.sign(slope) == np.sign(middle))).sum(axis=0) >= _ALIKE * weight.sum()
    spread = 1.4826 * np.median(np.abs(slope - middle) * weight, axis=0)
    spread = _MEDIAN * spread / np.sqrt((weight**2).sum())
    z = float(-ndtri(0.5 * DRIFT_PER_LOG / len(middle)))
    return np.asarray(np.where(alike & (np.abs(middle) > z * spread), middle, 0.0))


def _median(value: FloatArray, weight: FloatArray) -> FloatArray:
    """(A,) of (K, A), each counted by its weight (K, 1)."""
    order = np.argsort(value, axis=0)
    share = np.cumsum(weight[order, 0], axis=0)
    half = np.argmax(share >= 0.5 * share[-1], axis=0)
    at = np.take_along_axis(order, half[None], axis=0)
    return np.asarray(np.take_along_axis(value, at, axis=0)[0])


def drift_of_rests(value: FloatArray, first: IntArray, last: IntArray, width: float) -> FloatArray:
    """Common drift (A,), N/s, of forces (A, B) over stops [first, last) in bins of width s."""
    slopes, lengths = [], []
    for a, b in zip(first, last, strict=True):
        a = b - round(_LAST * (b - a))
        if b - a >= _SHORTEST:
            t = np.arange(b - a) - 0.5 * (b - a - 1)
            slopes.append(value[:, a:b] @ t / (t @ t) / width)
            lengths.append(b - a)
    return common_drift(np.array(slopes).reshape(-1, len(value)), np.array(lengths, np.float64))
