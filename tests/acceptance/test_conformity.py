"""Conformity where the contact wrench can be written out; lengths of normal vectors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal.acceptance import Conformity, assess, coverage_radius, within
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.records import FloatArray
from tdfscal.significance import EXPANDED_COVERAGE
from tests.simulation.rigs import exact_rig

from .test_gate import LEVEL

STD = 1e-3


def given(inertial_mass: float = 500.0) -> Calibrated:
    rig = exact_rig()
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


@pytest.mark.parametrize("quantity", ["force", "torque"])
def test_the_limit_is_guarded_by_the_expanded_uncertainty(quantity: str) -> None:
    U = getattr(assess(given()), quantity).expanded
    for factor in (1.0, 1.0001, 0.9999):
        found = limited(given(), **{quantity: factor * U})
        judged, other = found.force, found.torque
        if quantity == "torque":
            judged, other = other, judged
        assert (judged.limit, other.limit) == (factor * U, np.inf)
        assert found.conforms == judged.within_limit == (factor >= 1)
        assert sum(finding.rejects for finding in found.findings) == (factor < 1)
        assert judged.exceeding == pytest.approx(1 - EXPANDED_COVERAGE, rel=0.01)
    assert len(limited(given(), force=1e-3, torque=1e-3).findings) == 2


def test_coverage_radius_in_one_two_and_three_dimensions() -> None:
    assert stats.norm.cdf(2) - stats.norm.cdf(-2) == pytest.approx(EXPANDED_COVERAGE, abs=1e-15)
    for dof in (1, 2, 3):
        cov = np.diag([9.0] * dof + [0.0] * (3 - dof))
        expected = 3 * np.sqrt(stats.chi2.ppf(EXPANDED_COVERAGE, dof))
        assert coverage_radius(cov) == pytest.approx(expected, rel=1e-9)
    assert coverage_radius(np.zeros((3, 3))) == 0.0


def test_probability_of_an_ellipsoid_by_monte_carlo() -> None:
    rng, draws = np.random.default_rng(2), 400_000
    A = rng.standard_normal((3, 3)) * np.array([5.0, 1.0, 0.1])
    inside = np.linalg.norm(rng.standard_normal((draws, 3)) @ A.T, axis=1) < 4.0
    p = within(A @ A.T, 4.0)
    assert abs(inside.mean() - p) < 5 * np.sqrt(p * (1 - p) / draws)
