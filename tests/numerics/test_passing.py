"""A line through the lags of few moves, against what normal scatter makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from tdfscal.numerics.streams import line_through


@pytest.mark.parametrize("moves", [5, 7, 12, 40])
def test_three_standard_errors_cover_lines_of_few_moves(moves: int) -> None:
    """Scatter alone lies beyond three in 0.27 %; 3000 draws leave up to twice that, and a third."""
    rng = np.random.default_rng(moves)
    beyond = np.zeros(2)
    for _ in range(3000):
        time = np.sort(rng.uniform(0.0, 10.0 * moves, moves))
        line = line_through(time, rng.normal(0.0, 5e-3, moves), 1e-9)
        beyond += np.abs([line.value / line.std, line.rate / line.rate_std]) > 3.0
    assert beyond.max() / 3000 < 0.01
