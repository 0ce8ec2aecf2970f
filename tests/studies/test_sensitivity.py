"""Fig. 4 against closed forms and random draws."""

import numpy as np
import pytest

from studies.sensitivity import sweep
from tdfscal.simulation import reference_rig


def test_the_reference_rig_has_81_7_newtons_for_roll_and_pitch_and_none_for_yaw() -> None:
    found = sweep(reference_rig())
    theta = found.off
    # Every sensor carries a third of the weight, upright; turned by θ it errs by 2 F sin(θ/2).
    third = 500.0 * 9.80665 / 3
    expected = 2 * third * np.abs(np.sin(theta / 2))
    for i in range(3):
        assert found.force[i, 0] == pytest.approx(expected, abs=1e-9)
        assert found.force[i, 1] == pytest.approx(expected, abs=1e-9)
        assert np.abs(found.force[i, 2]).max() < 1e-9
        assert np.abs(found.torque[i, 2]).max() < 1e-9
    assert found.force[:, :2, -1] == pytest.approx(np.full((3, 2), 81.7), abs=0.05)
    # Roll turns sensor 1, on the x axis, across its lever of 0.6 m; pitch along it.
    assert found.torque[0, 0] == pytest.approx(0.6 * expected, abs=1e-9)
    assert found.torque[0, 1] == pytest.approx(0.6 * third * (1 - np.cos(theta)), abs=1e-9)


def test_the_printed_moment_rows_make_a_torque_of_yaw() -> None:
    """Rᵀ X r̂ f = X (r × f): a vertical load's moment, turned with the sensor by its yaw."""
    found = sweep(reference_rig())
    lever_force = 0.6 * 500.0 * 9.80665 / 3
    expected = 2 * lever_force * np.abs(np.sin(found.off / 2))
    assert found.printed[:, 2] == pytest.approx(np.tile(expected, (3, 1)), rel=2e-3, abs=1e-9)
    assert found.printed[0, 2, -1] == pytest.approx(49.0, abs=0.1)
