import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from tdfscal.comparison.compatibility import combine, compare_pair, rpy_std
from tdfscal.errors import DataError
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rotations
from tests.words import refusal

from .world import chi2_bounds, error_vector

NAMES = ("ncp1", "ncp2", "ncp3")


def covariance(rng: np.random.Generator, size: float) -> FloatArray:
    root = rng.normal(size=(9, 14))
    return np.asarray(size**2 * root @ root.T / 14)


def draw(
    rng: np.random.Generator, truth: FloatArray, cov: FloatArray, names: tuple[str, ...] = NAMES
) -> Rotations:
    d = rng.multivariate_normal(np.zeros(9), cov).reshape(3, 3)
    X = Rotation.from_rotvec(-d).as_matrix() @ truth
    return Rotations(names, X, cov)


def truths(rng: np.random.Generator, angle: float = 0.1) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(angle * rng.normal(size=(3, 3))).as_matrix())


def about(rotations: Rotations, k: int, vector: list[float]) -> Rotations:
    X = rotations.rotation.copy()
    X[k] = Rotation.from_rotvec(vector).as_matrix() @ X[k]
    return Rotations(rotations.supports, X, rotations.covariance)


def test_chi2_and_en_of_independent_estimates() -> None:
    total, above = 0.0, 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        X = truths(rng)
        a, b = (draw(rng, X, covariance(rng, s)) for s in (3e-4, 1e-3))
        pair = compare_pair(("a", a), ("b", b))
        total += pair.chi2
        above += int(np.sum(pair.en > 1))
    low, high = chi2_bounds(9 * 200)
    assert low < total < high
    # |E_n| > 1 with k = 2 in 4.55 % of 1800 angles; correlation only widens the spread.
    assert 0.025 * 1800 < above < 0.07 * 1800


def test_a_known_difference_in_closed_form() -> None:
    """Both level, yaw differs by 1 mrad with 0.3 and 0.4 mrad: E_n = 1 / (2 · 0.5) = 1."""
    eye = np.tile(np.eye(3), (3, 1, 1))
    a = Rotations(NAMES, eye, (0.3e-3) ** 2 * np.eye(9))
    b = Rotations(NAMES, eye, (0.4e-3) ** 2 * np.eye(9))
    pair = compare_pair(("a", about(a, 1, [0, 0, 1e-3])), ("b", b))
    assert pair.rpy[1] == pytest.approx([0, 0, 1e-3], abs=1e-15)
    assert pair.rotation_vector[1] == pytest.approx([0, 0, 1e-3], abs=1e-15)
    assert pair.en[1, 2] == pytest.approx(1.0, rel=1e-12)
    assert pair.chi2 == pytest.approx(4.0, rel=1e-12)
    assert pair.dof == 9
    # Of three sensors one stands out at 1/2 %: χ² = 15.3 on 3; 21.67 on 9 would have missed it.
    limit = 0.5e-3 * np.sqrt(stats.chi2.isf(0.005 / 3, 3))
    more = compare_pair(("a", about(a, 1, [0, 0, 1.001 * limit])), ("b", b))
    assert more.p_value > 0.01
    assert not more.verified
    assert more.finding.code == "calibrations-incompatible"
    assert more.finding.values["angle"] == "yaw"
    assert more.finding.values["support"] == "ncp2"
    less = compare_pair(("a", about(a, 1, [0, 0, 0.999 * limit])), ("b", b))
    assert less.verified
    assert less.en[1, 2] > 1.7
    assert less.finding.code == "calibrations-compatible"


def test_detectable_is_seen_in_95_of_100() -> None:
    rng = np.random.default_rng(9)
    X, C = truths(rng), covariance(rng, 5e-4)
    zero = Rotations(NAMES, X, 1e-20 * np.eye(9))
    size = compare_pair(("a", Rotations(NAMES, X, C)), ("b", zero)).detectable[2, 1]
    rpy = so3.to_rpy(X)
    rpy[2, 1] += size
    moved = so3.from_rpy(rpy)
    seen = sum(
        not compare_pair(("a", draw(rng, moved, C)), ("b", zero)).verified for _ in range(200)
    )
    assert 0.9 * 200 < seen < 0.99 * 200


def test_angles_differ_the_short_way_round() -> None:
    half = np.tile(Rotation.from_euler("x", np.pi - 1e-4).as_matrix(), (3, 1, 1))
    other = np.tile(Rotation.from_euler("x", -np.pi + 1e-4).as_matrix(), (3, 1, 1))
    cov = 1e-6 * np.eye(9)
    pair = compare_pair(("a", Rotations(NAMES, half, cov)), ("b", Rotations(NAMES, other, cov)))
    assert pair.rpy[:, 0] == pytest.approx(-2e-4, abs=1e-12)


def test_a_covariance_that_is_none_is_refused() -> None:
    rng = np.random.default_rng(3)
    a = draw(rng, truths(rng), covariance(rng, 1e-3))
    for bad in (np.zeros((9, 9)), np.full((9, 9), 1e-6), np.diag([np.inf, *[1e-6] * 8])):
        found = refusal(compare_pair, ("a", a), ("b", Rotations(NAMES, a.rotation, bad)))
        assert found.code == "covariance-singular"


def test_joint_error_is_within_the_stated_uncertainty() -> None:
    total, wrong = 0.0, 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        X = truths(rng, 1.0)
        a, b = (draw(rng, X, covariance(rng, s)) for s in (5e-4, 1e-3))
        joint = combine(a, b)
        d = error_vector(X, joint.rotations.rotation)
        total += float(d @ np.linalg.solve(joint.rotations.covariance, d))
        wrong += not joint.test.verified
    low, high = chi2_bounds(9 * 60)
    assert low < total < high
    assert wrong <= 4  # 1 % of 60 expected; more than 4 has a chance of 4e-4


def test_joint_weights_in_closed_form() -> None:
    """Two turns about z with σ and 2σ: the mean lies a fifth of the way, variance 4/5 σ²."""
    eye = np.tile(np.eye(3), (3, 1, 1))
    a = Rotations(NAMES, eye, 1e-6 * np.eye(9))
    b = about(Rotations(NAMES, eye, 4e-6 * np.eye(9)), 2, [0, 0, 1e-3])
    joint = combine(a, b)
    assert so3.to_rpy(joint.rotations.rotation)[2] == pytest.approx([0, 0, 2e-4], abs=1e-15)
    assert rpy_std(joint.rotations) == pytest.approx(np.sqrt(0.8) * 1e-3, rel=1e-9)
    assert joint.test.verified


def test_other_supports_are_refused() -> None:
    rng = np.random.default_rng(2)
    X = truths(rng)
    a = draw(rng, X, covariance(rng, 1e-3))
    b = draw(rng, X, covariance(rng, 1e-3), ("ncp1", "ncp2", "ncp4"))
    with pytest.raises(DataError, match="ncp4"):
        compare_pair(("a", a), ("b", b))
