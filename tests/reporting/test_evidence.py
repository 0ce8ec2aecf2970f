"""What a calibration file keeps for its report, against independent arithmetic."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdfscal.numerics.distributions import chi2_sf
from tests.reporting.samples import Sample, sample


@pytest.fixture(scope="module")
def made() -> Sample:
    return sample(touched=True)


def test_wrench_before_is_that_of_section_7(made: Sample) -> None:
    """f = −Rᵀ Σ f_i − Rᵀ G, M = −Σ r_i × Rᵀ f_i − r_m × Rᵀ G with nominal angles 0 and zeros 0."""
    rig, table = made.rig.rig, made.calibration.postures
    assert table is not None
    weight = np.array([0.0, 0.0, -500.0 * 9.80665])
    centred = rig.hinge - rig.hinge.mean(axis=0)
    for row, k in enumerate(table.index):
        seen = made.dwells.position[k] - made.dwells.position[k].mean(axis=0)
        R = Rotation.align_vectors(seen, centred)[0].as_matrix()
        in_lcs = made.dwells.force[k] @ R
        force = -in_lcs.sum(axis=0) - R.T @ weight
        moment = -np.cross(rig.hinge, in_lcs).sum(axis=0)
        moment -= np.cross(rig.barycentre.value, R.T @ weight)
        np.testing.assert_allclose(table.force_before[row], force, rtol=0, atol=1e-6)
        np.testing.assert_allclose(table.moment_before[row], moment, rtol=0, atol=1e-6)


def test_residuals_of_each_axis_are_as_uncertain_as_is_said() -> None:
    """Leave-one-out residuals of many campaigns, each axis over its std: mean square 1."""
    squares = []
    for seed in range(1, 5):
        table = sample(seed=seed).calibration.postures
        assert table is not None
        assert table.force_std is not None
        assert table.moment_std is not None
        for value, std in ((table.force_after, table.force_std),
                           (table.moment_after, table.moment_std)):  # fmt: skip
            squares.append((np.array(value) / np.array(std)) ** 2)
    total, count = float(np.sum(squares)), np.size(squares)
    # Leave-one-out residuals are correlated, which widens the sum: half the count is safe.
    assert 1e-4 < chi2_sf(total / 2, count // 2) < 1 - 1e-4
