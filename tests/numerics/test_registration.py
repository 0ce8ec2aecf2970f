"""Rigid registration: its minimum, what it refuses; statistics of single points by their laws."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from tdfscal.errors import NotIdentifiableError
from tdfscal.numerics.registration import (
    LARGEST_MEANINGFUL_STD,
    MirroredError,
    Registration,
    extend,
    register,
)
from tdfscal.records import FloatArray
from tests.tracker.world import rotation

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


C = np.diag([1e-5, 2e-5, 5e-5]) ** 2
D = np.diag([1e-5, 3e-5, 1e-5]) ** 2


def cloud(rng: np.random.Generator, count: int = 6) -> FloatArray:
    return np.asarray(rng.uniform(-0.1, 0.1, size=(count, 3)))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, np.pi - 1e-9, np.pi])
@pytest.mark.parametrize("known", [True, False])
def test_without_noise_the_transform_is_returned(angle: float, known: bool) -> None:
    rng = np.random.default_rng(1)
    x, t = cloud(rng), np.array([5.0, -0.3, 1.2])
    axis = np.array([0.6, 0.0, -0.8])
    R = Rotation.from_rotvec(angle * axis).as_matrix()
    y = x @ R.T + t
    fit = register(y, x, stacked(C, 6), stacked(D, 6)) if known else register(y, x)
    assert np.abs(fit.rotation - R).max() < 1e-12
    assert np.abs(fit.translation[0] - t).max() < 1e-12
    assert np.linalg.det(fit.rotation) == pytest.approx(1, abs=1e-14)
    assert fit.handed


def test_one_rotation_with_a_translation_per_group() -> None:
    rng = np.random.default_rng(2)
    x, R, t = cloud(rng, 9), rotation(rng), rng.normal(size=(3, 3))
    group = np.repeat(np.arange(3), 3)
    fit = register(x @ R.T + t[group], x, stacked(C, 9), None, group)
    assert np.abs(fit.rotation - R).max() < 1e-12
    assert np.abs(fit.translation - t).max() < 1e-12
    assert fit.dof == 27 - 3 - 9


def test_minimum_is_that_of_a_general_optimiser() -> None:
    """With an anisotropic reference covariance, S itself turns with R."""
    rng = np.random.default_rng(4)
    x, R = cloud(rng), rotation(rng)
    big_D = np.diag([2e-3, 1e-5, 1e-5]) ** 2
    y = x @ R.T + rng.normal(size=x.shape) * 1e-4
    x = x + rng.multivariate_normal(np.zeros(3), big_D, size=6)
    noise = stacked(np.eye(3) * 1e-8, 6)
    fit = register(y, x, noise, stacked(big_D, 6))

    def cost(p: FloatArray) -> float:
        turned = Rotation.from_rotvec(p[:3] * 1e-3).as_matrix() @ fit.rotation
        e = y - x @ turned.T - fit.translation[0] - p[3:] * 1e-3
        S = np.eye(3) * 1e-8 + turned @ big_D @ turned.T
        return float(np.einsum("ni,ij,nj->", e, np.linalg.inv(S), e))

    best = minimize(cost, np.zeros(6), method="BFGS", options={"gtol": 1e-6})
    std = np.sqrt(np.diag(fit.covariance))
    assert np.all(np.abs(best.x) * 1e-3 < 1e-4 * std)
    assert cost(np.zeros(6)) == pytest.approx(fit.chi2, rel=1e-9)


def test_mirrored_points_are_refused() -> None:
    rng = np.random.default_rng(7)
    x = cloud(rng)
    y = (x * [1, 1, -1]) @ rotation(rng).T + rng.normal(size=x.shape) * 1e-5
    for covariances in ((stacked(C, 6), None), (None, None)):
        with pytest.raises(MirroredError, match="mirror image"):
            register(y, x, *covariances)


@pytest.mark.parametrize(("noise", "away"), [(0.0, 30.0), (1e-8, 30.0), (1e-5, 0.0)])
def test_lines_in_every_direction_are_refused(noise: float, away: float) -> None:
    rng = np.random.default_rng(12)
    for k in range(30):
        along = rng.normal(size=3) if k % 3 else np.eye(3)[k % 9 // 3]
        count = int(rng.integers(3, 9))
        x = np.linspace(0, 10.0 ** rng.integers(-2, 2), count)[:, None] * along + away
        y = x @ rotation(rng).T + noise * rng.normal(size=x.shape)
        for covariance in (stacked(np.eye(3) * 1e-10, count), None):
            with pytest.raises(NotIdentifiableError, match="one line"):
                register(y, x, covariance)


@pytest.mark.parametrize("count", [0, 2, 5])
def test_too_few_points_and_coincident_ones_are_refused(count: int) -> None:
    x = np.tile([0.1, 0.2, 0.3], (count, 1))
    with pytest.raises(NotIdentifiableError):
        register(x, x, stacked(C, count))
