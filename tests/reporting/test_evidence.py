"""What a calibration file keeps for its report, against independent arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.reporting.samples import Sample, sample


@pytest.fixture(scope="module")
def made() -> Sample:
    return sample(touched=True)


def test_postures_are_the_dwells_in_use(made: Sample) -> None:
    table = made.calibration.postures
    assert table is not None
    assert made.calibration.fit is not None
    assert [r.index for r in made.calibration.fit.rejected] == [4]
    assert table.index == (0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11)
    assert list(table.start) == made.dwells.start[list(table.index)].tolist()
    assert list(table.end) == made.dwells.end[list(table.index)].tolist()


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


def test_histogram_is_that_of_standard_normal_trials(made: Sample) -> None:
    trials = made.calibration.monte_carlo
    assert trials is not None
    assert trials.histogram is not None
    middle = np.arange(-3.875, 4.0, 0.25)
    counts = np.array(trials.histogram)
    total = counts.sum(axis=-1)
    assert np.all(total <= 4000)
    assert np.all(total > 0.998 * 4000)  # 6e-5 of a normal lies beyond four standard deviations
    mean = counts @ middle / total
    std = np.sqrt(counts @ middle**2 / total - mean**2)
    assert np.all(np.abs(mean) < 5 / np.sqrt(4000))
    assert np.all(np.abs(std - 1) < 5 / np.sqrt(8000) + 0.003)  # binning adds 0.25²/24 = 0.0026


def test_loads_point_where_the_mean_squared_load_is_largest(made: Sample) -> None:
    seen = made.calibration.observability
    assert seen is not None
    assert seen.loads is not None
    kept = [k for k in range(12) if k != 4]
    c = made.calibration
    F = np.einsum("nab,knb->nka", c.rotation, made.dwells.force[kept] - c.zero)
    for i, load in enumerate(seen.loads):
        assert load.support == c.support_names[i]
        axis = np.array(load.axis)
        assert np.linalg.norm(axis) == pytest.approx(1, abs=1e-12)
        along = F[i] @ axis
        across = np.linalg.norm(F[i] - np.outer(along, axis), axis=1)
        assert load.across == pytest.approx(np.sqrt(np.mean(across**2)), rel=1e-9)
        for off in Rotation.from_rotvec(0.01 * np.eye(3)).as_matrix():
            assert np.sum((F[i] @ off @ axis) ** 2) <= np.sum(along**2) * (1 + 1e-12)
