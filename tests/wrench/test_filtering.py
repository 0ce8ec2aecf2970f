"""The Kalman filter against the Riccati recursion and least squares; logs that come in pieces."""

from itertools import pairwise

import numpy as np
import pytest

from tdfscal.model.samples_in_motion import Samples
from tdfscal.records import FloatArray
from tdfscal.wrench.filtering import Smoother, Walk, filter_for, filtered

WALKS = [Walk(q, 1.0, 0.004) for q in (0.04, 4.0)]
each = pytest.mark.parametrize("walk", WALKS)


@each
def test_gain_solves_the_riccati_equation(walk: Walk) -> None:
    p = walk.r
    for _ in range(500):
        ahead = p + walk.q
        gain = ahead / (ahead + walk.r)
        p = (1 - gain) * ahead
    assert walk.gain == pytest.approx(gain, rel=1e-12)


@each
def test_smoother_is_the_least_squares_answer(walk: Walk) -> None:
    """x minimises Σ (y − x)²/r + Σ (x_k − x_{k−1})²/q, once the filter is in its steady state."""
    n = 400
    y = np.random.default_rng(2).standard_normal((n, 1)).cumsum(axis=0)
    D = np.diff(np.eye(n), axis=0)
    best = np.linalg.solve(np.eye(n) / walk.r + D.T @ D / walk.q, y / walk.r)
    smoother = Smoother(walk)
    found = np.concatenate([smoother(y[:123]), smoother(y[123:]), smoother.rest()])
    np.testing.assert_allclose(found[150:], best[150:], atol=1e-7)


def log(noise: float = 2.0) -> Samples:
    """30 000 samples at 200 Hz with a gap of a second in the middle, and a force that ramps."""
    rng = np.random.default_rng(4)
    time = np.arange(30_000) / 200.0
    time[15_000:] += 1.0
    force = np.tile(50.0 * time[:, None, None], (1, 3, 3)) + noise * rng.standard_normal(
        (time.size, 3, 3)
    )
    return Samples(time, time[:, None, None] + np.arange(9.0).reshape(3, 3), force)


def run(samples: Samples, kind: str, cuts: list[int]) -> tuple[FloatArray, FloatArray, FloatArray]:
    model = filter_for(15.0, samples)
    assert model.r == pytest.approx(4.0, rel=0.05)
    assert model.interval == pytest.approx(5e-3)
    pieces = (samples.rows(slice(a, b)) for a, b in pairwise(cuts))
    out = list(filtered(pieces, kind, model))  # type: ignore[arg-type]
    return (
        np.concatenate([s.time for s in out]),
        np.concatenate([s.position for s in out]),
        np.concatenate([s.force for s in out]),
    )


@pytest.mark.parametrize("kind", ["kalman", "smooth"])
def test_pieces_give_what_the_whole_gives(kind: str) -> None:
    samples = log()
    time, position, whole = run(samples, kind, [0, 30_000])
    # Every sample once, positions as they were.
    np.testing.assert_array_equal(time, samples.time)
    np.testing.assert_array_equal(position, samples.position)
    parts = run(samples, kind, [0, 10, 11, 14_990, 15_010, 21_000, 30_000])
    np.testing.assert_array_equal(parts[0], samples.time)
    np.testing.assert_allclose(parts[2], whole, atol=1e-6)
    # After the gap the filter starts at the first sample.
    if kind == "kalman":
        np.testing.assert_allclose(whole[15_000], samples.force[15_000], atol=1e-9)
    model = Walk.of(15.0, 2.0, 5e-3)
    late = np.mean(50.0 * time[:, None, None] - whole) / 50.0
    assert late == pytest.approx(model.delay if kind == "kalman" else 0.0, abs=4e-4)
