"""Choice by linear algebra, against brute force; and order."""

from itertools import combinations, permutations

import numpy as np
import pytest

from tdfscal.planning.selection import (
    choose,
    distances,
    greedy,
    short_tour,
)
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


def test_tour_is_a_permutation_and_nearly_the_shortest() -> None:
    place = np.random.default_rng(2).normal(size=(7, 3, 3))
    distance = distances(place)

    def length(order: list[int]) -> float:
        return float(
            sum(distance[a, b] for a, b in zip(order, [*order[1:], order[0]], strict=True))
        )

    tour = short_tour(distance, 3)
    assert tour[0] == 3
    assert sorted(tour) == list(range(7))
    best = min(length([0, *rest]) for rest in permutations(range(1, 7)))
    assert length(tour.tolist()) <= 1.1 * best
