"""Conformity of a rig whose contact wrench can be written out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

from tdfscal.acceptance.gate import (
    Conformity,
    assess,
    assess_stated,
    conforming_months,
    coverage_radius,
    judge,
    within,
)
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.records import FloatArray

from .test_gate import FINE, LEVEL, exact

STD = 1e-3


def given(inertial_mass: float = 500.0) -> Calibrated:
    rig = exact()
    rig = replace(rig, mass=replace(rig.mass, value=np.asarray(inertial_mass)))
    return independent(rig, LEVEL, STD**2 * np.eye(9))


def by_hand(calibrated: Calibrated) -> FloatArray:
    """Covariance of force and moment: each sensor carries a third of a centred terminal."""
    rig = calibrated.rig
    F = np.array([0, 0, float(rig.mass.value) * rig.gravity / 3])
    total = np.zeros((6, 6))
    for hinge in rig.hinge:
        for d in STD * np.eye(3):
            f = np.cross(d, F)
            w = np.concatenate([f, np.cross(hinge, f)])
            total += np.outer(w, w)
    return total


def test_covariance_is_that_of_turned_thirds_of_the_weight() -> None:
    found = assess(given())
    assert np.allclose(found.covariance, by_hand(given()), rtol=0, atol=1e-9)
    assert (found.force.quantity, found.force.unit) == ("force", "N")
    assert (found.torque.quantity, found.torque.unit) == ("torque", "N·m")
    std = np.sqrt(np.diagonal(by_hand(given())))
    assert np.allclose([*found.force.std, *found.torque.std], std, rtol=1e-9, atol=1e-9)
    # Two equal horizontal directions and none upright: χ² with two degrees of freedom.
    assert found.force.expanded == pytest.approx(std[0] * np.sqrt(-2 * np.log(0.0455)), rel=1e-4)
    assert found.conforms
    assert found.findings == ()


def limited(of: Calibrated, force: float | None = None, torque: float | None = None) -> Conformity:
    """Judged by these limits in its rig file."""
    stated = replace(of.rig.acceptance, contact_force=force, contact_torque=torque)
    return assess(replace(of, rig=replace(of.rig, acceptance=stated)))


def test_one_quantity_above_its_limit_is_one_reason() -> None:
    U = assess(given()).torque.expanded
    found = limited(given(), torque=0.99 * U)
    assert found.force.limit == np.inf
    assert found.torque.limit == 0.99 * U
    assert not found.conforms
    assert len(found.findings) == 1
    assert not limited(given(), force=1e-3).conforms
    assert len(limited(given(), force=1e-3, torque=1e-3).findings) == 2


@pytest.mark.parametrize(
    ("force", "torque", "judged"),
    [(None, None, False), (1.0, None, True), (None, 1.0, True), (1.0, 1.0, True)],
)
def test_nothing_is_judged_where_the_rig_file_states_no_limit(
    force: float | None, torque: float | None, judged: bool
) -> None:
    one = given()
    stated = replace(one.rig.acceptance, contact_force=force, contact_torque=torque)
    found = assess_stated(replace(one, rig=replace(one.rig, acceptance=stated)))
    assert (found is not None) == judged
    if found is not None:
        assert found.force.limit == (np.inf if force is None else force)


def test_an_open_quantity_exceeds_every_limit_but_none() -> None:
    unknown = np.zeros_like(given().open)
    unknown[9:12] = True
    found = limited(replace(given(), open=unknown), force=1e9)
    assert found.force.expanded == np.inf
    assert found.force.exceeding == 1.0
    assert assess(replace(given(), open=unknown)).force.exceeding == 0.0


def test_a_limit_met_exactly_conforms() -> None:
    U = assess(given()).force.expanded
    assert limited(given(), force=U).conforms


def test_lengths_scale_with_the_noise() -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(size=(3, 3))
    one = coverage_radius(A @ A.T)
    assert within(A @ A.T, one) == pytest.approx(0.9545, abs=1e-4)
    assert coverage_radius(4 * A @ A.T) == pytest.approx(2 * one, rel=1e-9)
    half = coverage_radius(A @ A.T, 0.5)
    assert within(A @ A.T, half) == pytest.approx(0.5, abs=1e-9)


def test_an_error_far_smaller_than_the_ball_is_within() -> None:
    assert within(1e-4 * np.eye(3), 4.5) == pytest.approx(1.0, abs=1e-12)
    assert within(1e4 * np.eye(3), 1e-3) == pytest.approx(0.0, abs=1e-12)
    assert within(np.zeros((3, 3)), 5.0) == 1.0


def test_a_contact_of_the_limit_may_conform_and_still_not_be_seen() -> None:
    one = assess(given()).force
    # 1.67 σ stop one machine in ten within an hour, 1.645 σ more is what 95 % stay below.
    worst = (ndtri(1.0 - (1.0 - np.exp(-0.1)) / 2.0) + ndtri(0.95)) * one.std.max()
    assert one.smallest_contact == pytest.approx(worst, rel=1e-12)
    assert one.expanded < 0.99 * worst
    assert not limited(given(), force=1.01 * worst).findings
    unseen = limited(given(), force=0.99 * worst)
    assert [f.code for f in unseen.findings] == ["contact-below-threshold"]
    assert not any(f.rejects for f in judge(given().rig, FINE, 1.0, conformity=unseen))


def test_a_walk_ends_conformity_when_its_variance_fills_the_room() -> None:
    one = given()
    U = assess(one).force.expanded
    assert conforming_months(one, 1e-4) == {}

    def within_limit(limit: float) -> Calibrated:
        limits = replace(one.rig.acceptance, contact_force=limit)
        return replace(one, rig=replace(one.rig, acceptance=limits))

    assert conforming_months(within_limit(2.0 * U), 0.0) == {"force": np.inf}
    assert conforming_months(within_limit(0.9 * U), 1e-4) == {"force": 0.0}
    # Turns alone make this wrench: twice their uncertainty has four times their variance.
    months = conforming_months(within_limit(2.0 * U), 1e-4)["force"]
    assert months == pytest.approx(3.0 * STD**2 / 1e-4**2, rel=1e-6)
