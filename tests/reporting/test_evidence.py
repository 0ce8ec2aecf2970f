"""What a calibration file keeps for its report, against independent arithmetic."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
        lengths = [np.linalg.norm(force), np.linalg.norm(moment)]
        np.testing.assert_allclose(table.before[row], lengths, rtol=0, atol=1e-6)
