"""The Kalman filter against the Riccati recursion and least squares."""

from __future__ import annotations

import numpy as np
import pytest

from tdfscal.errors import DataError, UsageError
from tdfscal.filtering import Causal, Walk, estimate_walk, smooth

WALK = Walk(q=np.array([0.04, 4.0]), r=np.array([1.0, 1.0]))


def test_gain_solves_the_riccati_equation() -> None:
    p = WALK.r.copy()
    for _ in range(500):
        ahead = p + WALK.q
        gain = ahead / (ahead + WALK.r)
        p = (1 - gain) * ahead
    np.testing.assert_allclose(WALK.gain, gain, rtol=1e-12)


def test_delay_is_that_of_a_ramp() -> None:
    ramp = np.repeat(np.arange(400.0)[:, None], 2, axis=1)
    out = Causal(WALK)(ramp)
    np.testing.assert_allclose(ramp[-1] - out[-1], WALK.delay, rtol=1e-9)


def test_noise_reduction() -> None:
    noise = np.random.default_rng(0).standard_normal((200_000, 2))
    found = Causal(WALK)(noise)[100:].std(axis=0)
    np.testing.assert_allclose(found, WALK.reduction, rtol=0.015)


def test_pieces_join() -> None:
    signal = np.random.default_rng(1).standard_normal((100, 2))
    whole, filter_ = Causal(WALK)(signal), Causal(WALK)
    np.testing.assert_allclose(
        np.concatenate([filter_(signal[:37]), filter_(signal[37:])]), whole, rtol=1e-12
    )


def test_smoother_is_the_least_squares_answer() -> None:
    """x minimises Σ (y − x)²/r + Σ (x_k − x_{k−1})²/q."""
    y = np.random.default_rng(2).standard_normal((40, 2)).cumsum(axis=0)
    D = np.diff(np.eye(40), axis=0)
    for c in range(2):
        A = np.eye(40) / WALK.r[c] + D.T @ D / WALK.q[c]
        np.testing.assert_allclose(smooth(WALK, y)[:, c], np.linalg.solve(A, y[:, c] / WALK.r[c]))


def test_variances_are_measured() -> None:
    rng = np.random.default_rng(3)
    true = np.cumsum(np.sqrt(WALK.q) * rng.standard_normal((40_000, 2)), axis=0)
    found = estimate_walk(true + np.sqrt(WALK.r) * rng.standard_normal(true.shape))
    np.testing.assert_allclose(found.q[1], WALK.q[1], rtol=0.1)
    np.testing.assert_allclose(found.r[0], WALK.r[0], rtol=0.05)


def test_bad_input() -> None:
    with pytest.raises(DataError, match="16"):
        estimate_walk(np.zeros((3, 1)))
    with pytest.raises(UsageError, match="walk above zero"):
        Walk(q=np.zeros(1), r=np.ones(1))
    with pytest.raises(UsageError, match="channels"):
        smooth(WALK, np.zeros((4, 3)))
