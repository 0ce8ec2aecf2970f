"""A line through lags against normal scatter; splines against scipy and a cubic, which they are."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tdfscal.numerics.streams import even_spline, line_through


@pytest.mark.parametrize("moves", [5, 12])
def test_three_standard_errors_cover_lines_of_few_moves(moves: int) -> None:
    """Scatter alone lies beyond three in 0.27 %; 3000 draws leave up to twice that, and a third."""
    rng = np.random.default_rng(moves)
    beyond = np.zeros(2)
    for _ in range(3000):
        time = np.sort(rng.uniform(0.0, 10.0 * moves, moves))
        line = line_through(time, rng.normal(0.0, 5e-3, moves), 1e-9)
        beyond += np.abs([line.seconds / line.std, line.rate / line.rate_std]) > 3.0
    assert beyond.max() / 3000 < 0.01


@pytest.mark.parametrize("count", [4, 5, 40])
def test_the_spline_is_that_of_scipy(count: int) -> None:
    rng = np.random.default_rng(count)
    value = rng.normal(size=(count, 2, 3))
    place = np.concatenate([rng.uniform(0, count - 1, 50), np.arange(count)])
    expected = CubicSpline(np.arange(count), value)(place)
    assert np.allclose(even_spline(value)(place), expected, rtol=0, atol=1e-12)
