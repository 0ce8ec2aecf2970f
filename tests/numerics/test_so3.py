"""Axioms, sweeps around 0 and ±π, and Jacobians by an independent route."""

from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.numerics import so3
from tdfscal.numerics.so3 import from_directions

RNG = np.random.default_rng(7)
AXES = RNG.normal(size=(20, 3))
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
SMALL = 10.0 ** -np.arange(1, 16)
ANGLES = np.concatenate([[0.0, 1e-300], SMALL, np.pi - SMALL, [0.3, 1.0, 2.0, 3.0]])
EPS = np.finfo(float).eps


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_a_rotation_and_log_inverts_it(angle: float) -> None:
    v = angle * AXES
    R = so3.exp(v)
    assert np.allclose(R @ np.swapaxes(R, -1, -2), np.eye(3), rtol=0, atol=8 * EPS)
    assert np.allclose(np.linalg.det(R), 1, rtol=0, atol=8 * EPS)
    # Relative accuracy at small angles; near π the sign is free but these stay below it.
    assert np.allclose(so3.log(R), v, rtol=8 * EPS, atol=8 * EPS * max(angle, 1e-300))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-4, 9.9e-3, 1.01e-2, 0.5, 3.1])
def test_exp_and_left_jacobian_against_power_series(angle: float) -> None:
    mpmath.mp.dps = 50
    for axis in AXES[:4]:
        v = angle * axis
        K = mpmath.matrix(so3.hat(v).tolist())
        term, expo, jac = mpmath.eye(3), mpmath.eye(3), mpmath.eye(3)
        for k in range(1, 60):
            term = term * K / k
            expo = expo + term
            jac = jac + term / (k + 1)
        for computed, series in ((so3.exp(v), expo), (so3.left_jacobian(v), jac)):
            exact = np.array(series.tolist(), dtype=float)
            assert np.abs(computed - exact).max() < 8 * EPS


def test_rpy_is_the_papers_product() -> None:
    rpy = RNG.uniform([-3, -1.5, -3], [3, 1.5, 3], size=(50, 3))
    oracle = Rotation.from_euler("xyz", rpy)  # extrinsic: Rz Ry Rx
    assert np.allclose(so3.from_rpy(rpy), oracle.as_matrix(), rtol=0, atol=4 * EPS)
    assert np.allclose(so3.to_rpy(so3.from_rpy(rpy)), rpy, rtol=0, atol=1e-13)


def test_rpy_jacobian_by_complex_step() -> None:
    h = 1e-30
    for rpy in RNG.uniform([-3, -1.4, -3], [3, 1.4, 3], size=(20, 3)):
        R = so3.from_rpy(rpy)
        jac = so3.rpy_jacobian(R)
        for j in range(3):
            d = so3.exp(1j * h * np.eye(3)[j]) @ R
            # d atan2(y, x) = (x dy − y dx)/(x² + y²)
            cp2 = R[0, 0] ** 2 + R[1, 0] ** 2
            di = d.imag / h
            roll = (R[2, 2] * di[2, 1] - R[2, 1] * di[2, 2]) / (R[2, 2] ** 2 + R[2, 1] ** 2)
            yaw = (R[0, 0] * di[1, 0] - R[1, 0] * di[0, 0]) / cp2
            pitch = -di[2, 0] / np.sqrt(cp2)
            assert np.allclose(jac[:, j], [roll, pitch, yaw], rtol=1e-12, atol=1e-13)


def test_covariance_of_angles_by_differences() -> None:
    rng = np.random.default_rng(5)
    R = so3.from_rpy(rng.uniform(-1.2, 1.2, (3, 3)))
    root = rng.normal(size=(9, 9))
    h = 1e-6
    step = h * root.T.reshape(9, 3, 3)  # one column of the root turns all three
    turned = so3.to_rpy(so3.exp(step) @ R) - so3.to_rpy(so3.exp(-step) @ R)
    turned /= 2 * h
    expected = np.einsum("pni,pnj->nij", turned, turned)
    assert np.allclose(so3.rpy_covariance(R, root @ root.T), expected, rtol=1e-7, atol=1e-8)
    variance = so3.rpy_variance(R, root @ root.T)
    assert np.allclose(variance, np.diagonal(expected, axis1=1, axis2=2), rtol=1e-7)


def test_what_an_entry_of_a_rotation_is_known_to_by_complex_step() -> None:
    h, R, A = 1e-30, so3.exp(AXES[:2]), RNG.normal(size=(6, 6))
    moved = [so3.exp(1j * h * column.reshape(2, 3)) @ R for column in A.T]
    variance = np.sum([(each.imag / h) ** 2 for each in moved], axis=0)
    np.testing.assert_allclose(so3.entry_std(R, A @ A.T) ** 2, variance, rtol=1e-12)


def test_project_returns_the_nearest_rotation_never_a_mirror() -> None:
    M = RNG.normal(size=(200, 3, 3))
    R = so3.project(M)
    assert np.allclose(np.linalg.det(R), 1)
    others = so3.exp(RNG.normal(size=(200, 50, 3)))
    best = np.linalg.norm(M - R, axis=(1, 2))
    assert (np.linalg.norm(M[:, None] - others, axis=(2, 3)) >= best[:, None] - 1e-12).all()


def test_quaternion_against_scipy() -> None:
    R = so3.exp(np.concatenate([a * AXES for a in ANGLES]))
    q, oracle = so3.to_quaternion(R), Rotation.from_matrix(R).as_quat(canonical=True)
    assert np.allclose(np.abs(np.sum(q * oracle, axis=1)), 1, rtol=0, atol=1e-14)
    assert (q[:, 3] >= 0).all()


def test_where_roll_and_yaw_are_one_turn_the_turns_stand_for_them() -> None:
    """Less than 1.1° from a pitch of ±90° (cosine 0.02) jacobian and deviations are of turns."""
    edge = np.arccos(0.02)
    pitch = np.array([0.0, edge - 1e-6, edge + 1e-6, np.pi / 2, -np.pi / 2, -edge + 1e-6])
    base = so3.from_rpy(np.stack([0.3 + 0 * pitch, pitch, -0.4 + 0 * pitch], axis=1))
    stuck = np.array([False, False, True, True, True, False])
    assert np.array_equal(so3.locked(base), stuck)
    turn = 1e-3 * RNG.normal(size=(6, 3))
    R = so3.exp(turn) @ base
    found = so3.deviations(R, base)
    assert np.allclose(found[stuck], turn[stuck], rtol=0, atol=1e-15)
    angles = so3.to_rpy(R) - so3.to_rpy(base)
    assert np.allclose(found[~stuck], angles[~stuck], rtol=0, atol=1e-12)
    assert np.array_equal(so3.rpy_jacobian(base)[stuck], np.tile(np.eye(3), (3, 1, 1)))
    cov = np.diag(np.arange(1.0, 19.0))
    own = so3.rpy_variance(base, cov).ravel()[np.repeat(stuck, 3)]
    assert np.array_equal(own, np.arange(1.0, 19.0)[np.repeat(stuck, 3)])


def test_deviations_lose_whole_turns() -> None:
    """From a yaw of 179° to −179° are 2°."""
    rpy = np.radians([[0, 0, 179.0], [-179.0, 0, 0]])
    other = np.radians([[0, 0, -179.0], [179.0, 0, 0]])
    found = so3.deviations(so3.from_rpy(other), so3.from_rpy(rpy))
    assert np.allclose(found, np.radians([[0, 0, 2], [-2, 0, 0]]), rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_measured_directions_are_met(seed: int) -> None:
    """Where the axes are known, the rotation has them; it is always one."""
    rng = np.random.default_rng(seed)
    rpy = rng.normal(size=3)
    nominal = Rotation.from_euler("xyz", rpy).as_matrix()
    true = Rotation.random(random_state=seed).as_matrix()
    for axes in ("", "x", "y", "z", "xy", "xz", "yz", "xyz"):
        for R in (
            true,
            nominal,
            nominal @ np.diag([-1.0, -1.0, 1]),
            nominal @ np.diag([1.0, -1, -1]),
        ):
            directions: dict[Any, Any] = {a: tuple(R[:, "xyz".index(a)]) for a in axes}
            found = from_directions(rpy.tolist(), directions)
            assert np.allclose(found @ found.T, np.eye(3), rtol=0, atol=1e-9)
            assert np.linalg.det(found) == pytest.approx(1)
            for axis, towards in directions.items():
                assert np.allclose(found[:, "xyz".index(axis)], towards, rtol=0, atol=1e-8)


@pytest.mark.parametrize("axis", range(3))
def test_what_no_axis_shows_stays_nominal(axis: int) -> None:
    """One axis measured: turned the shortest way, about the normal of the two directions."""
    rpy = np.array([0.4, -0.2, 1.0])
    nominal = Rotation.from_euler("xyz", rpy)
    assert np.allclose(from_directions(rpy.tolist(), {}), nominal.as_matrix(), rtol=0, atol=1e-15)
    own = nominal.as_matrix()[:, axis]
    normal = np.cross(own, [0.3, 0.2, 0.9])
    for angle in (0.0, 1e-12, 1e-3, 1.0, 3.0):
        turn = Rotation.from_rotvec(angle * normal / np.linalg.norm(normal))
        found = from_directions(rpy.tolist(), {"xyz"[axis]: tuple(turn.apply(own))})
        assert np.allclose(found, (turn * nominal).as_matrix(), rtol=0, atol=1e-8)
