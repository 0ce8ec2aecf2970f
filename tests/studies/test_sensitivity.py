"""Fig. 4 against closed forms and random draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies.sensitivity import jacobian, run, sweep, wrench_error
from tdfscal.numerics import so3
from tdfscal.records import UncertainValue
from tdfscal.simulation import make_rig, reference_rig


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


def test_internal_forces_by_random_draws() -> None:
    rig, internal = make_rig(4), 300.0
    found = sweep(rig, internal, points=3)
    angles = np.zeros((4, 3))
    angles[1, 2] = 0.05
    J, J_true = (jacobian(rig, np.eye(3), so3.from_rpy(a)) for a in (np.zeros((4, 3)), angles))
    G = np.array([0.0, 0.0, -500.0 * 9.80665])
    load = np.concatenate([G, np.cross([0.0, 0.0, 0.25], G)])
    smallest = np.linalg.lstsq(J_true, -load, rcond=None)[0]  # the minimum-norm solution
    draws = 20_000
    free = np.random.default_rng(0).normal(scale=internal, size=(draws, 12))
    free -= free @ np.linalg.pinv(J_true) @ J_true  # what makes no net wrench
    square = np.square((smallest + free) @ (J - J_true).T)
    for mine, rows in ((found.force, np.s_[:3]), (found.torque, np.s_[3:])):
        each = square[:, rows].sum(axis=1)
        error = each.std() / np.sqrt(draws)
        assert abs(mine[1, 2, -1] ** 2 - each.mean()) < 4 * error


def test_a_mounting_turned_by_a_quarter_exchanges_roll_and_pitch() -> None:
    rig = replace(
        reference_rig(), barycentre=UncertainValue(np.array([0.05, 0.02, 0.25]), np.zeros(3))
    )
    turned = replace(rig, nominal_rpy=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2], [0, 0, 0]]))
    plain, other = (sweep(r, points=5) for r in (rig, turned))
    # Rz(90°) Ry(β) Rx(α): a small roll is then a turn about y, a small pitch one about −x.
    assert other.torque[1, 0] == pytest.approx(plain.torque[1, 1], abs=1e-8)
    assert other.torque[1, 1] == pytest.approx(plain.torque[1, 0], abs=1e-8)
    assert plain.torque[1, 0, -1] != pytest.approx(plain.torque[1, 1, -1], rel=0.1)


def test_one_sensor_that_is_off_in_closed_form() -> None:
    rig, theta = reference_rig(), 0.03
    angles = rig.nominal_rpy.copy()
    angles[1, 0] += theta
    error = wrench_error(rig, so3.from_rpy(rig.nominal_rpy), so3.from_rpy(angles))
    third = 500.0 * 9.80665 / 3
    assert error[0] == pytest.approx(2 * third * np.sin(theta / 2), rel=1e-9)


def test_what_follows_from_the_chosen_mass_is_no_verdict() -> None:
    study = run(reference_rig())
    assert study.beside == ()
    assert any("81.71" in value for _, value, _ in study.chosen)
    heavier = run(make_rig(mass=600.0))
    assert any("98.06" in value for _, value, _ in heavier.chosen)
