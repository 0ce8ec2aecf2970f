"""Splines through even values against scipy's, and against a cubic, which they are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tdfscal.numerics.streams import even_spline


@pytest.mark.parametrize("count", [4, 5, 40])
def test_the_spline_is_that_of_scipy(count: int) -> None:
    rng = np.random.default_rng(count)
    value = rng.normal(size=(count, 2, 3))
    place = np.concatenate([rng.uniform(0, count - 1, 50), np.arange(count)])
    expected = CubicSpline(np.arange(count), value)(place)
    assert np.allclose(even_spline(value)(place), expected, rtol=0, atol=1e-12)


def test_a_cubic_is_its_own_spline() -> None:
    def cubic(x: np.ndarray) -> np.ndarray:
        return 1 - 2 * x + 0.3 * x**2 - 0.01 * x**3

    place = np.linspace(0, 12, 97)
    found = even_spline(cubic(np.arange(13.0)))(place)
    assert np.allclose(found, cubic(place), rtol=0, atol=1e-12)
