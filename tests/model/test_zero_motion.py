"""Functions by which zeros move, against what they are defined to be."""

import numpy as np
import pytest

from tdfscal.model.postures import WALK_MODES, ZeroAge, walk_modes, zero_motion
from tdfscal.records import Drift

TIME = np.array([10.0, 12.0, 17.0, 30.0])
TEMPERATURE = 20.0 + np.array([[0, 0], [1, 2], [3, 5], [2, 9.0]])


def test_slopes_and_parabola_vanish_at_the_first_posture() -> None:
    drift = Drift(time=0.1, temperature=0.2, parabola=0.3)
    found = zero_motion(drift, TIME, TEMPERATURE, 2)
    assert found is not None
    assert found.kind == ("time", "temperature", "parabola")
    assert np.array_equal(found.std, [0.1, 0.2, 0.3])
    assert found.remainder == 0.0
    elapsed = np.array([0.0, 2.0, 7.0, 20.0])
    for sensor in range(2):
        expected = [elapsed, TEMPERATURE[:, sensor] - 20.0, elapsed**2]
        assert np.array_equal(found.value[:, sensor], np.stack(expected, axis=1))
    some = found.subset(np.array([1, 3]))
    assert np.array_equal(some.value, found.value[[1, 3]])
    assert some.kind == found.kind


def test_a_few_postures_have_the_covariance_of_a_random_walk() -> None:
    """q² min(t_k, t_l) from the first posture on."""
    elapsed = TIME - 10.0
    expected = 0.3**2 * np.minimum(elapsed[:, None], elapsed[None])
    modes, left = walk_modes(0.3, TIME)
    assert np.allclose(modes @ modes.T, expected, rtol=0, atol=1e-14)
    assert left == 0.0
    found = zero_motion(Drift(walk=0.3), TIME, None, 3)
    assert found is not None
    assert set(found.kind) == {"walk"}
    assert len(found.kind) == 3  # the first posture does not move
    assert np.array_equal(found.std, np.ones(3))
    for sensor in range(3):
        value = found.value[:, sensor]
        assert np.allclose(value @ value.T, expected, rtol=0, atol=1e-14)


def test_many_postures_keep_the_largest_modes_and_the_variance_that_they_leave() -> None:
    """The sum over all sines is min(t, t'); what is left out is some per mill of it."""
    K, q = 400, 0.5
    time = np.linspace(5.0, 105.0, K)
    modes, left = walk_modes(q, time)
    assert modes.shape == (K, WALK_MODES)
    elapsed = time - 5.0
    covariance = q**2 * np.minimum(elapsed[:, None], elapsed[None])
    # The tail of Σ 2 / (span ω²) beyond 40 modes: 2 span / π² Σ_{j ≥ 40} (j + ½)⁻².
    tail = 2 * 100.0 / np.pi**2 * np.sum((np.arange(40, 4_000_000) + 0.5) ** -2.0)
    assert np.abs(modes @ modes.T - covariance).max() < 1.01 * q**2 * tail
    off = np.diagonal(covariance - modes @ modes.T).mean()
    assert off == pytest.approx(q**2 * tail / 2, rel=0.02)
    # Shared by K / 40 postures together, it counts as so many times its variance in each.
    assert left == pytest.approx(off * K / WALK_MODES, rel=0.02)


def test_a_single_instant_does_not_walk() -> None:
    modes, left = walk_modes(1.0, np.full(3, 7.0))
    assert modes.shape == (3, 0)
    assert left == 0.0


def test_zeros_that_were_taken_before_have_moved_by_the_first_posture() -> None:
    """A slope, a parabola and a walk that began 100 s and 3 K before."""
    drift = Drift(time=0.1, temperature=0.2, parabola=0.3)
    age = ZeroAge(seconds=100.0, warming=3.0)
    found = zero_motion(drift, TIME, TEMPERATURE, 2, age)
    assert found is not None
    elapsed = np.array([100.0, 102.0, 107.0, 120.0])
    expected = [elapsed, TEMPERATURE[:, 1] - 17.0, elapsed**2]
    assert np.allclose(found.value[:, 1], np.stack(expected, axis=1), rtol=1e-14, atol=0)
    walked = zero_motion(Drift(walk=0.3), TIME, None, 1, ZeroAge(seconds=100.0))
    assert walked is not None
    modes = walked.value[:, 0]
    covariance = 0.3**2 * np.minimum(elapsed[:, None], elapsed[None])
    assert np.allclose(modes @ modes.T, covariance, rtol=1e-12, atol=0)
