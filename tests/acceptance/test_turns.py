"""Turns about the axes of the base against the axes of roll, pitch and yaw written out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.acceptance import locked_sensors, prior_turn_std, turn_names
from tdfscal.records import FloatArray


def matrix(rpy: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_euler("xyz", rpy).as_matrix())


def axes(rpy: FloatArray) -> FloatArray:
    """Columns: the axes in the base that roll, pitch and yaw turn about."""
    _, pitch, yaw = rpy
    after_yaw = Rotation.from_euler("z", yaw)
    after_pitch = after_yaw * Rotation.from_euler("y", pitch)
    return np.stack([after_pitch.apply([1, 0, 0]), after_yaw.apply([0, 1, 0]), [0, 0, 1.0]], axis=1)


def test_priors_on_angles_as_turns() -> None:
    rng = np.random.default_rng(0)
    rpy = rng.uniform([-3, -1.3, -3], [3, 1.3, 3], size=(40, 3))
    std = rng.uniform(0.1, 1.0, size=(40, 3))
    found = prior_turn_std(std, matrix(rpy))
    for k in range(40):
        expected = np.sqrt(np.diagonal(axes(rpy[k]) @ np.diag(std[k] ** 2) @ axes(rpy[k]).T))
        assert np.allclose(found[k], expected, rtol=1e-12, atol=0)


def test_an_open_angle_leaves_open_what_it_turns_and_nothing_else() -> None:
    level, upright = np.zeros(3), np.array([0.0, 0.0, np.pi / 2])
    std = np.array([[np.inf, 0.2, 0.3], [np.inf, 0.2, 0.3]])
    found = prior_turn_std(std, matrix(np.stack([level, upright])))
    # At a yaw of 90° roll turns about Y and pitch about −X.
    assert np.allclose(found, [[np.inf, 0.2, 0.3], [0.2, np.inf, 0.3]], rtol=1e-12, atol=0)


@pytest.mark.parametrize(
    ("rpy", "own"),
    [
        ([0, 0, 0], (True, True, True)),
        ([2.0, 0, 0], (True, True, True)),  # roll moves no axis of pitch and yaw
        ([0, 0, np.pi], (True, True, True)),  # the same axes, the other way round
        ([0, 0, np.radians(19)], (True, True, True)),
        ([0, 0, np.radians(21)], (False, False, True)),
        ([0, np.radians(19), 0], (True, True, True)),
        ([0, np.radians(-21), 0], (False, True, True)),
        ([0, np.radians(44), 0], (False, True, True)),
        ([0, np.radians(46), 0], (False, False, False)),
        ([0, np.radians(-80), 0], (False, False, False)),
    ],
)
def test_a_turn_is_named_by_its_angle(rpy: list[float], own: tuple[bool, bool, bool]) -> None:
    (names,) = turn_names(matrix(np.array([rpy])))
    for name, angle, axis, same in zip(names, ("roll", "pitch", "yaw"), "XYZ", own, strict=True):
        assert name == (angle if same else f"turn about {axis}")


def test_only_sensors_pitched_by_a_right_angle_are_warned_of() -> None:
    pitch = np.radians([0.0, 88.0, 89.5, -90.0])
    rotation = matrix(np.stack([0 * pitch, pitch, 0 * pitch], axis=1))
    found = locked_sensors(["a", "b", "c", "d"], rotation)
    assert len(found) == 2
    assert [each.subject for each in found] == [("c",), ("d",)]
    assert [each.size for each in found] == pytest.approx(pitch[2:])
    assert locked_sensors(["a"], rotation[:1]) == []
