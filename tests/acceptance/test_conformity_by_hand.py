"""Conformity of a rig whose contact wrench can be written out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.acceptance.conformity import assess, assess_stated, coverage_radius, exceeding, within
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.records import FloatArray

from .test_gate import LEVEL, exact

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
    assert found.reasons == ()


def test_known_deviation_goes_to_its_own_quantity() -> None:
    deviation = np.arange(1.0, 7.0)
    found = assess(given(), deviation=deviation)
    assert np.array_equal(found.force.deviation, deviation[:3])
    assert np.array_equal(found.torque.deviation, deviation[3:])


def test_one_quantity_above_its_limit_is_one_reason() -> None:
    U = assess(given()).torque.expanded
    found = assess(given(), torque=0.99 * U)
    assert found.force.limit == np.inf
    assert found.torque.limit == 0.99 * U
    assert not found.conforms
    assert len(found.reasons) == 1
    assert not assess(given(), force=1e-3).conforms
    assert len(assess(given(), force=1e-3, torque=1e-3).reasons) == 2


def test_the_limits_given_go_before_those_of_the_rig_file() -> None:
    one = given()
    stated = replace(one.rig.acceptance, contact_force=1e-3, contact_torque=2e-3)
    one = replace(one, rig=replace(one.rig, acceptance=stated))
    assert (assess(one).force.limit, assess(one).torque.limit) == (1e-3, 2e-3)
    found = assess(one, force=5.0, torque=6.0, rpy=(0.01, 0.02, 0.03))
    assert (found.force.limit, found.torque.limit) == (5.0, 6.0)
    assert found.rpy == (0.01, 0.02, 0.03)


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
    found = assess(replace(given(), open=unknown), force=1e9)
    assert found.force.expanded == np.inf
    assert found.force.exceeding == 1.0
    assert assess(replace(given(), open=unknown)).force.exceeding == 0.0


def test_a_limit_met_exactly_conforms() -> None:
    U = assess(given()).force.expanded
    assert assess(given(), force=U).conforms


def test_lengths_scale_with_the_noise() -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(size=(3, 3))
    one = coverage_radius(A @ A.T)
    assert within(A @ A.T, np.zeros(3), one) == pytest.approx(0.9545, abs=1e-4)
    assert coverage_radius(4 * A @ A.T) == pytest.approx(2 * one, rel=1e-9)
    half = coverage_radius(A @ A.T, 0.5)
    assert within(A @ A.T, np.zeros(3), half) == pytest.approx(0.5, abs=1e-9)


def test_a_mean_far_outside_or_inside_is_certain() -> None:
    cov, mean = 1e-4 * np.eye(3), np.array([0.0, 3.0, 4.0])
    assert exceeding(cov, mean, 4.5) == pytest.approx(1.0, abs=1e-12)
    assert exceeding(cov, mean, 5.5) == pytest.approx(0.0, abs=1e-12)
    assert exceeding(cov, mean, np.inf) == 0.0
    for axis in 5 * np.eye(3):
        assert exceeding(cov, axis, 1.0) == exceeding(cov, -axis, 1.0) == 1.0
    assert within(np.zeros((3, 3)), mean, 5.0) == 1.0


def test_errors_along_one_line_have_k_2_whatever_the_line() -> None:
    for v in np.random.default_rng(5).normal(size=(10, 3)):
        assert coverage_radius(np.outer(v, v)) == pytest.approx(2 * np.linalg.norm(v), rel=1e-5)
