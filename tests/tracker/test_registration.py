import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from tdfscal.errors import NotIdentifiableError
from tdfscal.numerics.registration import MirroredError, register
from tdfscal.records import FloatArray

from .world import rotation

C = np.diag([1e-5, 2e-5, 5e-5]) ** 2
D = np.diag([1e-5, 3e-5, 1e-5]) ** 2


def stacked(cov: FloatArray, count: int) -> FloatArray:
    return np.tile(cov, (count, 1, 1))


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
