"""Fig. 4 against closed forms and random draws."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from studies.reports.sensitivity import document as sensitivity_document
from studies.runs.sensitivity import jacobian, sensitivity
from tdfscal.errors import UsageError
from tdfscal.numerics import so3
from tdfscal.records import UncertainValue
from tdfscal.simulation import make_rig, reference_rig


def test_the_reference_rig_has_81_7_newtons_for_roll_and_pitch_and_none_for_yaw() -> None:
    sweep = sensitivity(reference_rig(), np.zeros(3))
    theta = sweep.deviation
    # Every sensor carries a third of the weight, upright; turned by θ it errs by 2 F sin(θ/2).
    third = 500.0 * 9.80665 / 3
    expected = 2 * third * np.abs(np.sin(theta / 2))
    for i in range(3):
        assert sweep.force[i, 0] == pytest.approx(expected, abs=1e-9)
        assert sweep.force[i, 1] == pytest.approx(expected, abs=1e-9)
        assert np.abs(sweep.force[i, 2]).max() < 1e-9
        assert np.abs(sweep.torque[i, 2]).max() < 1e-9
    assert sweep.force[:, :2, -1] == pytest.approx(np.full((3, 2), 81.7), abs=0.05)
    # Roll turns sensor 1, on the x axis, across its lever of 0.6 m; pitch along it.
    assert sweep.torque[0, 0] == pytest.approx(0.6 * expected, abs=1e-9)
    assert sweep.torque[0, 1] == pytest.approx(0.6 * third * (1 - np.cos(theta)), abs=1e-9)


def test_internal_forces_by_random_draws() -> None:
    rig, rpy, internal = make_rig(4), np.array([0.1, -0.05, 0.2]), 300.0
    sweep = sensitivity(rig, rpy, internal=internal, points=3)
    angles = np.zeros((4, 3))
    angles[1, 2] = 0.05
    R = so3.from_rpy(rpy)
    J, J_true = (jacobian(rig, R, so3.from_rpy(a)) for a in (np.zeros((4, 3)), angles))
    G = R.T @ np.array([0.0, 0.0, -500.0 * 9.80665])
    load = np.concatenate([G, np.cross([0.0, 0.0, 0.25], G)])
    smallest = np.linalg.lstsq(J_true, -load, rcond=None)[0]  # the minimum-norm solution
    draws = 20_000
    free = np.random.default_rng(0).normal(scale=internal, size=(draws, 12))
    free -= free @ np.linalg.pinv(J_true) @ J_true  # what makes no net wrench
    square = np.square((smallest + free) @ (J - J_true).T)
    for mine, rows in ((sweep.force, np.s_[:3]), (sweep.torque, np.s_[3:])):
        each = square[:, rows].sum(axis=1)
        error = each.std() / np.sqrt(draws)
        assert abs(mine[1, 2, -1] ** 2 - each.mean()) < 4 * error
    still = sensitivity(rig, rpy, points=3)
    assert (sweep.force[:, :, -1] > still.force[:, :, -1]).all()


def test_a_mounting_turned_by_a_quarter_exchanges_roll_and_pitch() -> None:
    rig = replace(
        reference_rig(), barycentre=UncertainValue(np.array([0.05, 0.02, 0.25]), np.zeros(3))
    )
    turned = replace(rig, nominal_rpy=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2], [0, 0, 0]]))
    plain, other = (sensitivity(r, np.zeros(3), points=5) for r in (rig, turned))
    # Rz(90°) Ry(β) Rx(α): a small roll is then a turn about y, a small pitch one about −x.
    assert other.torque[1, 0] == pytest.approx(plain.torque[1, 1], abs=1e-8)
    assert other.torque[1, 1] == pytest.approx(plain.torque[1, 0], abs=1e-8)
    assert other.torque[0] == pytest.approx(plain.torque[0], abs=1e-8)
    assert plain.torque[1, 0, -1] != pytest.approx(plain.torque[1, 1, -1], rel=0.1)


def test_nonsense_is_refused() -> None:
    with pytest.raises(UsageError, match="sweep"):
        sensitivity(reference_rig(), np.zeros(3), span=0.0)
    with pytest.raises(UsageError, match="internal forces"):
        sensitivity(reference_rig(), np.zeros(3), internal=-1.0)


def test_the_document_is_strict_json() -> None:
    rig = reference_rig()
    sweeps = [sensitivity(rig, np.zeros(3), internal=internal) for internal in (0.0, 100.0)]
    document = sensitivity_document(rig, sweeps, {})
    back = json.loads(json.dumps(document, allow_nan=False))
    assert back["span"] == 0.05
    assert back["sweeps"][0]["supports"][1]["force_error"] == sweeps[0].force[1, :, -1].tolist()
    assert back["sweeps"][1]["internal"] == 100.0
