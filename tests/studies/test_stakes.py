"""What a calibration is worth, against closed forms and random draws."""

from __future__ import annotations

import numpy as np
import pytest

from studies.runs.sensitivity import rms_error, stake
from tdfscal.numerics import so3
from tdfscal.simulation import make_rig, reference_rig

RNG = np.random.default_rng(3)


def test_one_sensor_of_the_reference_rig_in_closed_form() -> None:
    """A sensor rolled by θ errs by 2 F sin(θ/2) of its third of the weight until it is known."""
    rig, theta, sigma = reference_rig(), 0.05, 1e-4
    angles = rig.nominal_rpy.copy()
    angles[1, 0] += theta
    found = stake(rig, so3.from_rpy(angles), sigma**2 * np.eye(9), np.zeros(3))
    third = 500.0 * 9.80665 / 3
    assert found.off[1] == pytest.approx([theta, 0.0, 0.0])
    assert found.before[0] == pytest.approx(2 * third * np.sin(theta / 2), rel=1e-9)
    # Two turns of each of three sensors across its load, independent of each other.
    assert found.after[0] == pytest.approx(third * sigma * np.sqrt(6), rel=1e-6)
    assert found.force[0] == pytest.approx([third * sigma, third * sigma, 0.0], abs=1e-9)


def test_correlated_errors_by_random_draws() -> None:
    rig, rpy, internal, draws = make_rig(4), np.array([0.1, -0.05, 0.2]), 300.0, 20_000
    X = so3.from_rpy(rig.nominal_rpy + 0.02 * RNG.standard_normal((4, 3)))
    root = 2e-4 * RNG.standard_normal((12, 12)) / np.sqrt(12)
    found = stake(rig, X, root @ root.T, rpy, internal=internal)
    d = (RNG.standard_normal((draws, 12)) @ root.T).reshape(draws, 4, 3)
    error = rms_error(rig, so3.from_rpy(rpy), so3.exp(d) @ X, X, internal)
    # The mean square of so many draws is known to about two per cent.
    assert np.sqrt(np.mean(error**2, axis=0)) == pytest.approx(found.after, rel=0.03)
