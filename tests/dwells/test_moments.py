"""Moments of groups of samples, of one size and of many, against numpy group by group."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from tdfscal.dwells.moments import moments
from tdfscal.records import IntArray

RNG = np.random.default_rng(11)
SIZES = {
    "one size": np.full(300, 20),
    "one size, ends cut": np.array([7, *[20] * 300, 13]),
    "one missing amid": np.array([*[20] * 100, 19, *[20] * 150]),
    "any size": RNG.integers(1, 60, 400),
    "single samples": np.ones(500, dtype=np.int64),
    "more than is reduced at once": np.array([5, 50_000, 50_000, 5]),
    "many slabs": np.array([3, *[25] * 4000, 1]),
    "one group": np.array([9]),
}


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("sizes", SIZES.values(), ids=SIZES)
def test_against_numpy(sizes: IntArray, order: Literal["C", "F"]) -> None:
    bounds = np.concatenate(([0], np.cumsum(sizes)))
    level = RNG.normal(size=(len(sizes), 3)) * [1.0, 300.0, 0.001] + [0.5, 800.0, 0.0]
    value = np.repeat(level, sizes, axis=0) + RNG.normal(size=(bounds[-1], 3))
    number = np.arange(len(sizes))
    found = moments(np.asarray(value, order=order), number, bounds[:-1], extremes=True)
    assert np.array_equal(found.count, sizes)
    for k in np.unique([*range(0, len(sizes), 37), len(sizes) - 1]):
        some = value[bounds[k] : bounds[k + 1]]
        mean = some.mean(axis=0)
        np.testing.assert_allclose(found.mean[:, k], mean, rtol=1e-14, atol=1e-14)
        scatter = ((some - mean) ** 2).sum(axis=0)
        np.testing.assert_allclose(found.scatter[:, k], scatter, rtol=3e-7, atol=1e-24)
        for extreme, expected in ((found.low, some.min(axis=0)), (found.high, some.max(axis=0))):
            np.testing.assert_allclose(extreme[:, k], expected - mean, rtol=1e-6, atol=2e-12)
