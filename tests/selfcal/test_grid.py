"""The grid of benchmarks/selfcal_grid.py with the bounds that its table has to keep."""

import numpy as np
import pytest

from benchmarks.selfcal_grid import cells, row

pytestmark = pytest.mark.slow


def test_grid_reaches_the_bound_and_says_so() -> None:
    """Over all cells: each holds 20 campaigns, too few to judge a cell by itself."""
    rows = [row((1000 + seed, cell, 20)) for seed, cell in enumerate(cells())]
    rmse = np.sqrt(np.mean([(r.rmse / r.bound) ** 2 for r in rows]))
    stated = np.sqrt(np.mean([(r.stated / r.rmse) ** 2 for r in rows]))
    assert rmse <= 1.10
    assert 0.93 <= stated <= 1.07
    assert 0.9 <= np.mean([r.mahalanobis for r in rows]) <= 1.1
    assert 0.935 <= np.mean([r.single for r in rows]) <= 0.965
    assert 0.935 <= np.mean([r.joint for r in rows]) <= 0.965
