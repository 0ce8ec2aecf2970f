"""Gauss–Newton and its decomposition against scipy and closed forms."""

import numpy as np
import pytest
from scipy.optimize import least_squares as oracle

from tdfscal.numerics.least_squares import gauss_newton, gram_root, spectrum
from tdfscal.records import FloatArray

RNG = np.random.default_rng(3)


@pytest.mark.parametrize(("m", "p"), [(8, 4), (4, 4), (3, 4)])
def test_root_is_that_of_the_pseudo_inverse(m: int, p: int) -> None:
    J = RNG.normal(size=(m, p)) * 10.0 ** np.arange(p)
    parts = spectrum(J)
    assert len(parts.values) == min(m, p)
    assert parts.null.shape == (p - min(m, p), p)
    scaled = J / parts.scale
    assert np.allclose(np.linalg.norm(scaled, axis=0), 1.0, atol=0)
    expected = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12) / np.outer(parts.scale, parts.scale)
    assert np.allclose(parts.root @ parts.root.T, expected, rtol=1e-8, atol=0)
    assert np.allclose(scaled @ parts.null.T, 0.0, atol=1e-12)


def test_columns_that_no_row_sees_are_null() -> None:
    J = RNG.normal(size=(6, 3))
    J = np.concatenate([J, np.zeros((6, 1)), J[:, :1] + J[:, 1:2]], axis=1)
    parts = spectrum(J)
    assert len(parts.values) == 3
    for direction in parts.null:
        assert np.abs(J @ (direction / parts.scale)).max() < 1e-12
    step = parts.solve(RNG.normal(size=6))
    assert step[3] == 0.0
    assert spectrum(np.zeros((3, 0))).values.size == 0
    nothing = spectrum(np.zeros((3, 2)))
    assert nothing.values.size == 0
    assert not nothing.solve(np.ones(3)).any()


@pytest.mark.parametrize("units", [1.0, 1e6])
def test_gram_root_is_that_of_the_pseudo_inverse(units: float) -> None:
    J = RNG.normal(size=(9, 4)) * np.array([1.0, units, 1 / units, 1.0])
    expected = np.linalg.inv(J.T @ J)
    G = gram_root(J.T @ J, len(J))
    scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
    assert np.abs((G @ G.T - expected) / scale).max() < 1e-9
    blind = np.concatenate([J, np.zeros((9, 1))], axis=1)
    G = gram_root(blind.T @ blind, len(blind))
    assert np.abs((G @ G.T)[:4, :4] / scale - expected / scale).max() < 1e-9
    assert not G[4].any()


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_steps_minimise_their_damped_sum_of_squares(damping: float) -> None:
    J, r = RNG.normal(size=(7, 3)), RNG.normal(size=7)
    parts = spectrum(J)
    D = np.diag(parts.scale**2)
    expected = -np.linalg.solve(J.T @ J + damping * D, J.T @ r)
    assert np.allclose(parts.solve(r, damping), expected, rtol=1e-10, atol=0)


def rosenbrock(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    residual = np.array([1 - x[0], 10 * (x[1] - x[0] ** 2), 0.1 * x[0] * x[1]])
    return residual, np.array([[-1, 0], [-20 * x[0], 10], [0.1 * x[1], 0.1 * x[0]]])


def move(x: FloatArray, step: FloatArray) -> FloatArray:
    return x + step


def test_minimum_is_that_of_scipy() -> None:
    """From a start whose full steps do not descend: they are damped until they do."""
    start = np.array([-1.9, 2.0])
    expected = oracle(lambda x: rosenbrock(x)[0], start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    found = gauss_newton(rosenbrock, move, start)
    assert found.converged
    assert np.allclose(found.state, expected.x, rtol=0, atol=1e-7)
    assert found.cost == pytest.approx(2 * expected.cost, rel=1e-9)
    residual, jacobian = rosenbrock(found.state)
    assert np.array_equal(found.residual, residual)
    assert np.array_equal(found.jacobian, jacobian)


def test_too_few_steps_are_said() -> None:
    start = np.array([-1.9, 2.0])
    few = gauss_newton(rosenbrock, move, start, iterations=2)
    assert not few.converged
    assert few.iterations == 2
    assert few.cost < float(np.sum(rosenbrock(start)[0] ** 2))
    assert np.array_equal(few.residual, rosenbrock(few.state)[0])
    assert np.array_equal(few.jacobian, rosenbrock(few.state)[1])


@pytest.mark.parametrize("curvature", [0.0, 0.9, 2.5, 6.0])
def test_curved_residuals_outweigh_a_direction_that_is_hardly_known(curvature: float) -> None:
    """r = (10 + k y²/2, x − 1, s y), with 10 k / s² the curvature: the minimum is at y = 0."""
    s = 1e-2
    k = curvature * s**2 / 10.0

    def curved(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual = np.array([10.0 + k * x[1] ** 2 / 2, x[0] - 1.0, s * x[1]])
        return residual, np.array([[0.0, k * x[1]], [1.0, 0.0], [0.0, s]])

    found = gauss_newton(curved, move, np.array([0.0, 5.0]))
    assert found.converged
    assert s * abs(found.state[1]) < 1e-6


def test_what_cannot_descend_stays_and_says_so() -> None:
    """A Jacobian that points uphill, and a residual that is no number."""

    def uphill(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return 1.0 + x**2 + x, np.array([[-1.0]])

    found = gauss_newton(uphill, move, np.array([0.0]))
    assert not found.converged
    assert abs(found.state[0]) < 60 * 2e-6

    def none(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([np.nan]), np.array([[1.0]])

    lost = gauss_newton(none, move, np.array([5.0]))
    assert not lost.converged
    assert lost.state[0] == 5.0
    assert lost.iterations == 1


def test_directions_without_information_stay_at_the_start() -> None:
    found = gauss_newton(
        lambda x: (np.array([x[0] - 3.0]), np.array([[1.0, 0.0]])), move, np.array([0.0, 7.0])
    )
    assert found.converged
    assert np.allclose(found.state, [3.0, 7.0], rtol=1e-12, atol=0)
