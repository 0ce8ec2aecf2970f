"""Truths are drawn with the standard deviations that the rig file states."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.errors import RigError
from tdfscal.records import DeclaredUncertainty
from tdfscal.simulation import Options, draw_truths, make_rig

from .rigs import chi2_p, loose_rig, plausible

TRIALS = 400


def test_draws_match_the_stated_uncertainties() -> None:
    rig = loose_rig()
    truth = draw_truths(rig, Options(), np.random.default_rng(1), TRIALS)
    offset = truth.rpy - rig.nominal_rpy
    diagonal = np.diagonal(truth.sensitivity, axis1=-2, axis2=-1)
    beside = truth.sensitivity[..., [0, 0, 1], [1, 2, 2]]
    lean = np.arcsin(truth.gravity[..., :2] / rig.gravity)
    checks = {
        "zero": truth.zero / 0.5,
        "mass": (truth.mass - 500.0) / 0.2,
        "barycentre": (truth.barycentre - rig.barycentre.value)[:, :2] / [1e-3, 2e-3],
        "hinge": (truth.hinge - rig.hinge) / 2e-5,
        "datum": truth.datum / 5e-5,
        "diagonal": diagonal / 0.004,
        "beside": beside * np.sqrt(2.0) / 0.004,
        "gravity": lean / 5e-4,
        "installation": offset / [0.02, 0.02, 0.05],
    }
    for name, unit in checks.items():
        assert plausible(chi2_p(unit)), name
        assert abs(np.mean(unit)) < 4.0 / np.sqrt(unit.size), name
    np.testing.assert_array_equal(truth.barycentre[:, 2], 0.25)  # known exactly
    np.testing.assert_array_equal(truth.sensitivity, np.swapaxes(truth.sensitivity, -1, -2))
    np.testing.assert_allclose(np.linalg.norm(truth.gravity, axis=-1), 9.80665, rtol=1e-14)


def test_rotation_is_yaw_pitch_roll() -> None:
    truth = draw_truths(loose_rig(), Options(), np.random.default_rng(3), 5)
    expected = Rotation.from_euler("ZYX", truth.rpy.reshape(-1, 3)[:, ::-1]).as_matrix()
    np.testing.assert_allclose(truth.rotation.reshape(-1, 3, 3), expected, atol=1e-15)


def test_infinite_scatter_is_refused() -> None:
    rig = make_rig(declared=DeclaredUncertainty(force_noise=np.inf))
    with pytest.raises(RigError, match="force_noise"):
        draw_truths(rig, Options(), np.random.default_rng(0), 1)
