"""Rotations of which only some axes are measured."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.numerics.so3 import from_directions


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
