"""Lengths of normal vectors by closed forms, and the decision rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal.acceptance.gate import Conformity, assess, coverage_radius, within
from tdfscal.model.calibrated import Calibrated
from tdfscal.significance import EXPANDED_COVERAGE
from tdfscal.wrench.contact_wrench import wrenches
from tests.words import in_words
from tests.wrench.held_out import RIG, world

GIVEN = world(1).given[0]


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


def limited(of: Calibrated, force: float) -> Conformity:
    """Judged by this limit in its rig file."""
    stated = replace(of.rig.acceptance, contact_force=force)
    return assess(replace(of, rig=replace(of.rig, acceptance=stated)))


def test_guard_band() -> None:
    U = assess(GIVEN).force.expanded
    assert limited(GIVEN, 1.0001 * U).conforms
    tight = limited(GIVEN, 0.9999 * U)
    assert not tight.conforms
    assert len(tight.findings) == 1
    assert "contact force" in in_words(tight.findings)[0]
    assert tight.force.exceeding == pytest.approx(1 - EXPANDED_COVERAGE, rel=0.01)


def test_limits_come_from_the_rig_file() -> None:
    limits = replace(RIG.acceptance, contact_force=1e-3, contact_rpy=(0.02, -0.01, 0.1))
    found = assess(replace(GIVEN, rig=replace(RIG, acceptance=limits)))
    assert found.rpy == (0.02, -0.01, 0.1)
    assert not found.force.conforms
    assert found.torque.conforms
    assert found.force.exceeding == pytest.approx(1.0, abs=1e-4)


def test_the_posture_is_at_rest() -> None:
    from tdfscal.acceptance.gate import at_rest

    position, reading = at_rest(GIVEN, (0.05, -0.03, 0.2))
    value = wrenches(GIVEN, np.zeros(1), position, reading).value
    assert np.abs(value).max() < 1e-8
