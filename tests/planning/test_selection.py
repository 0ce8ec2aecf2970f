"""Choice by linear algebra, against brute force; and order."""

from itertools import combinations

import numpy as np
import pytest

from tdfscal.planning.plan import choose, greedy, short_tour
from tdfscal.records import FloatArray


def problem(seed: int, count: int = 9) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(count, 2, 5)) * rng.uniform(0.2, 3.0, (count, 1, 5))
    return J, 0.1 * np.eye(5), rng.normal(size=(3, 5))


def objective(J: FloatArray, base: FloatArray, L: FloatArray, chosen: list[int]) -> float:
    information = base + sum(J[k].T @ J[k] for k in chosen)
    return float(np.trace(L @ np.linalg.inv(information) @ L.T))


@pytest.mark.parametrize("seed", range(3))
def test_exchange_reaches_what_trying_all_sets_finds(seed: int) -> None:
    J, base, L = problem(seed)
    chosen = choose(J, base, L, 4)[0].tolist()
    reached = objective(J, base, L, chosen)
    best = min(objective(J, base, L, list(c)) for c in combinations(range(len(J)), 4))
    assert len(set(chosen)) == 4
    assert reached <= objective(J, base, L, greedy(J, base, L, 4)) * (1 + 1e-12)
    assert reached <= 1.01 * best


def test_the_nearest_posture_comes_next() -> None:
    """Along a line, from its end: in order; by the slowest axis, whose way it is."""
    place = np.zeros((7, 3, 3))
    place[:, 1, 2] = [0.0, 5.0, 1.0, 3.0, 2.0, 6.0, 4.0]
    assert short_tour(place).tolist() == [0, 2, 4, 3, 6, 1, 5]
