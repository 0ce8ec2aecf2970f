"""Statistics of single points: statistics by leaving them out, probabilities by their laws."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from tdfscal.errors import NotIdentifiableError
from tdfscal.numerics.registration import LARGEST_MEANINGFUL_STD, Registration, extend, register
from tdfscal.records import FloatArray

NOISE = 1e-5
COV = np.diag([1.0, 2.0, 0.5]) * NOISE**2


def points(seed: int, count: int = 7) -> tuple[FloatArray, FloatArray]:
    """Measured and reference points of one rigid set, with noise."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-0.2, 0.2, size=(count, 3))
    R = Rotation.random(random_state=seed)
    noise = rng.multivariate_normal(np.zeros(3), COV, size=count)
    return R.apply(x) + np.array([1.0, -2.0, 0.5]) + noise, x


def stacked(cov: FloatArray, count: int) -> FloatArray:
    return np.tile(cov, (count, 1, 1))


def law(fit: Registration, dof: int | None = None, floor: float | None = None) -> FloatArray:
    """Probability of each point's statistic, by scipy.stats.

    χ² by the stated noise; where the others alone are worse than stated, F against these too.
    Without stated noise F, and χ² against the least noise there can be.
    """
    others = (fit.dof if dof is None else dof) - fit.redundancy
    rest = (fit.chi2 - fit.statistic) / others
    against = stats.f.sf(fit.statistic / fit.redundancy / rest, fit.redundancy, others)
    if floor is not None:
        own = stats.chi2.sf(fit.statistic / floor, fit.redundancy)
        return np.asarray(np.maximum(against, own))
    own = stats.chi2.sf(fit.statistic, fit.redundancy)
    return np.asarray(np.where(rest > 1, np.maximum(own, against), own))


def test_statistic_of_a_point_is_the_fall_of_chi2_without_it() -> None:
    y, x = points(1)
    fit = register(y, x, stacked(COV, 7))
    assert np.array_equal(fit.redundancy, np.full(7, 3))
    for j in range(7):
        keep = np.arange(7) != j
        without = register(y[keep], x[keep], stacked(COV, 6))
        assert fit.statistic[j] == pytest.approx(fit.chi2 - without.chi2, rel=1e-3)


@pytest.mark.parametrize("off", [0.0, 4e-5, 1e-3])
@pytest.mark.parametrize("worse", [1.0, 3.0])
def test_outliers_have_the_probability_of_their_law(off: float, worse: float) -> None:
    """Stated noise, right or three times too small; one point off by nothing to a hundred σ."""
    y, x = points(2)
    y[3] += [off, 0, 0]
    fit = register(y, x, stacked(COV, 7) / worse**2)
    assert np.allclose(fit.outlier_p, law(fit), rtol=1e-6, atol=1e-300)
    assert fit.p_value == pytest.approx(stats.chi2.sf(fit.chi2, fit.dof), rel=1e-9)
    assert fit.sigma is None
    if off == 1e-3:
        assert fit.outlier_p.argmin() == 3
        assert fit.outlier_p[3] < 1e-6


def test_an_extension_is_the_joint_least_squares() -> None:
    """Value, covariance and fall of χ² by brute force."""
    y, x = points(7, 9)
    fit = register(y, x, stacked(COV, 9))
    centred = x - x.mean(axis=0)
    columns = np.einsum("ij,njq->niq", fit.rotation, centred[:, :, None] * np.eye(3)[:, :2])
    found = extend(fit, columns)
    assert found is not None
    root = np.linalg.cholesky(np.linalg.inv(COV)).T
    J = (root @ np.concatenate([fit.jacobian, -columns], axis=2)).reshape(-1, 8)
    e = (root @ fit.residual[..., None]).ravel()
    step = np.linalg.lstsq(J, -e, rcond=None)[0]
    cov = np.linalg.inv(J.T @ J)
    assert np.allclose(found.value, step[6:], rtol=1e-6, atol=1e-12)
    assert np.allclose(found.covariance, cov[6:, 6:], rtol=1e-6, atol=0)


def test_a_rotation_of_no_meaning_is_refused_at_its_limit() -> None:
    """Points beside a line by w know the turn about it to noise / (w √n)."""
    count = 40
    line = np.linspace(-1, 1, count)[:, None] * [1.0, 0, 0]
    side = np.where(np.arange(count) % 2, 1.0, -1.0)[:, None] * [0, 1.0, 0]
    side -= line * (line[:, 0] @ side[:, 1]) / (line[:, 0] @ line[:, 0])
    for factor, refused in ((0.9, True), (1.1, False)):
        width = factor * NOISE / (LARGEST_MEANINGFUL_STD * np.sqrt(count))
        x = line + width * side
        cov = stacked(np.eye(3) * NOISE**2, count)
        if refused:
            with pytest.raises(NotIdentifiableError):
                register(x, x, cov)
        else:
            std = np.sqrt(register(x, x, cov).rotation_covariance[0, 0])
            assert std == pytest.approx(LARGEST_MEANINGFUL_STD / factor, rel=0.02)


def test_an_extension_that_the_points_do_not_show_is_none() -> None:
    x = np.random.default_rng(14).uniform(size=(5, 3)) * [1, 1, 0]
    fit = register(x, x, stacked(COV, 5))
    columns = np.zeros((5, 3, 1))
    columns[:, 2, 0] = x[:, 2]
    assert extend(fit, columns) is None
