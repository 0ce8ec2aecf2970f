"""Cubic splines through evenly spaced values, without what importing scipy.interpolate costs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.records import FloatArray


def even_spline(value: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Cubic spline through values (N, ...) at 0, 1, …, N − 1, N ≥ 4, as a function of places (M,).

    Its third derivative does not jump at the second and the last but one of them ("not a knot").
    """
    from scipy.linalg import solve_banded  # slow to import, seldom needed

    N, change = len(value), np.diff(value, axis=0)
    bands = np.ones((3, N))
    bands[1, 1:-1] = 4.0
    bands[0, 1] = bands[2, -2] = 2.0
    right = np.empty(value.shape)
    right[1:-1] = 3 * (change[1:] + change[:-1])
    right[0], right[-1] = (5 * change[0] + change[1]) / 2, (5 * change[-1] + change[-2]) / 2
    slope = solve_banded((1, 1), bands, right.reshape(N, -1)).reshape(value.shape)

    def at(place: FloatArray) -> FloatArray:
        k = np.clip(np.floor(place).astype(int), 0, N - 2)
        t = (place - k).reshape(-1, *(1,) * (value.ndim - 1))
        bend = slope[k] - change[k], slope[k + 1] - change[k]
        return np.asarray(
            value[k] + t * change[k] + t * (1 - t) * ((1 - t) * bend[0] - t * bend[1])
        )

    return at
