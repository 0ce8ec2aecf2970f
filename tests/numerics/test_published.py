"""Published results, reproduced by the uncertainty code: GUM H.2; JCGM 101 9.2.4 and 9.3."""

import numpy as np
import pytest

from tdfscal.numerics.distributions import (
    chi2_quantile,
    chi2_sf,
    coverage_factor,
    numerical_tolerance,
    propagate,
)
from tdfscal.numerics.least_squares import gauss_newton, spectrum
from tdfscal.records import FloatArray

TRIALS = 200_000


def test_gum_h2_simultaneous_resistance_and_reactance() -> None:
    """H.2, approach 1: means of V, I, φ with their covariance give R and X."""
    observed = np.array(  # Table H.2: V in volts, I in amperes, φ in radians
        [
            [5.007, 19.663e-3, 1.0456],
            [4.994, 19.639e-3, 1.0438],
            [5.005, 19.640e-3, 1.0468],
            [4.990, 19.685e-3, 1.0428],
            [4.999, 19.678e-3, 1.0433],
        ]
    )
    mean = observed.mean(axis=0)
    white = np.linalg.inv(np.linalg.cholesky(np.cov(observed, rowvar=False) / len(observed)))

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        R, X, current = x
        Z = np.hypot(R, X)
        predicted = np.array([current * Z, current, np.arctan2(X, R)])
        jac = np.array([[current * R / Z, current * X / Z, Z], [0, 0, 1], [-X / Z**2, R / Z**2, 0]])
        return white @ (predicted - mean), white @ jac

    found = gauss_newton(model, lambda x, step: x + step, np.array([100.0, 200.0, 0.02]))
    root = spectrum(found.jacobian).root
    C = root @ root.T
    R, X, _ = found.state
    std = np.sqrt(np.diagonal(C))
    # Table H.4; the last digit printed decides.
    assert found.converged
    assert pytest.approx(127.732, abs=0.005) == R
    assert pytest.approx(219.847, abs=0.005) == X
    assert std[0] == pytest.approx(0.071, abs=0.001)
    assert std[1] == pytest.approx(0.295, abs=0.002)
    assert C[0, 1] / (std[0] * std[1]) == pytest.approx(-0.588, abs=0.01)
    z = np.array([R, X]) / np.hypot(R, X)
    assert np.hypot(R, X) == pytest.approx(254.260, abs=0.005)
    assert np.sqrt(z @ C[:2, :2] @ z) == pytest.approx(0.236, abs=0.002)


def test_jcgm_101_9_2_4_rectangular_inputs_of_unequal_width() -> None:
    """Table 4: the linear interval [−19.9, 19.9] is not validated, the trials give ±17.0."""
    rng = np.random.default_rng(0)
    half = np.sqrt(3) * np.array([1, 1, 1, 10])

    def draw(size: int) -> FloatArray:
        return np.asarray(rng.uniform(-half, half, size=(size, 4)).sum(axis=1, keepdims=True))

    u = np.sqrt([103.0])
    found = propagate(draw, u, 0.95, TRIALS, digits=2)
    assert u[0] == pytest.approx(10.1, abs=0.05)
    assert found.std[0] == pytest.approx(10.1, abs=0.05)
    assert found.low[0] == pytest.approx(-17.0, abs=0.05)
    assert found.high[0] == pytest.approx(17.0, abs=0.05)
    k = coverage_factor(0.95)
    assert k * u[0] == pytest.approx(19.9, abs=0.05)
    assert not found.validates(-k * u, k * u)


def test_jcgm_101_9_2_2_normal_inputs_are_validated() -> None:
    rng = np.random.default_rng(1)
    found = propagate(
        lambda size: rng.standard_normal((size, 4)).sum(axis=1, keepdims=True),
        np.array([2.0]), 0.95, TRIALS,
    )  # fmt: skip
    assert found.stable
    assert found.trials < TRIALS
    assert found.high[0] == pytest.approx(3.92, abs=0.05)
    half = coverage_factor(0.95) * np.array([2.0])
    assert found.validates(-half, half)


@pytest.mark.parametrize(
    ("u", "digits", "delta"),
    [(0.35, 1, 0.05), (0.00012, 1, 5e-5), (9.9, 1, 5.0), (1.0, 1, 0.5), (2.0, 2, 0.05)],
)
def test_numerical_tolerance(u: float, digits: int, delta: float) -> None:
    """7.9.2: u = c 10^l with c an integer of so many digits, δ = ½ 10^l; 9.9 rounds to 1 × 10¹."""
    assert numerical_tolerance(np.array(u), digits) == pytest.approx(delta, rel=1e-12)


def test_quantiles_against_tables() -> None:
    """χ² 0.95 quantiles, and Student's factors of the GUM's Table G.2."""
    assert chi2_quantile(0.95, [1, 6, 9]) == pytest.approx([3.841, 12.592, 16.919], abs=5e-4)
    assert chi2_sf([3.841], 1)[0] == pytest.approx(0.05, abs=1e-4)
    assert coverage_factor(0.95, [1, 5, 20, np.inf]) == pytest.approx(
        [12.71, 2.57, 2.09, 1.960], abs=5e-3
    )
