"""Internal forces: what they are, and that a commanded or natural one has the stated size."""

import numpy as np
import pytest

from tdfscal.errors import UsageError
from tdfscal.simulation import Options, internal_part, simulate_campaign

from .rigs import chi2_p, exact_rig, plausible, still


def elastic_turning(largest_force: float) -> float:
    """Bound on how far the sprung terminal turns from its command, rad, at 20 N/µm on 0.6 m."""
    return 2.0 * largest_force / 2.0e7 / 0.6


@pytest.mark.parametrize("n", [3, 4, 6])
def test_internal_modes(n: int) -> None:
    rng = np.random.default_rng(n)
    place = rng.normal(size=(n, 3))
    basis = internal_part(place, np.eye(3 * n).reshape(3 * n, n, 3))
    np.testing.assert_allclose(basis.sum(axis=1), 0.0, atol=1e-13)
    np.testing.assert_allclose(np.cross(place, basis).sum(axis=1), 0.0, atol=1e-13)
    projector = basis.reshape(3 * n, 3 * n)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-13)
    assert np.trace(projector) == pytest.approx(3 * n - 6, abs=1e-12)


@pytest.mark.parametrize("n", [3, 4])
def test_squeeze_makes_the_commanded_internal_force(n: int) -> None:
    rig, squeeze = exact_rig(n), 300.0
    slack = simulate_campaign(rig, still(), np.random.default_rng(2))
    tight = simulate_campaign(rig, still(squeeze=squeeze), np.random.default_rng(2))
    commanded = 2.0e7 * tight.postures.displacement
    made = tight.force - slack.force
    turning = elastic_turning(float(np.abs(tight.force).max()))
    scale = np.linalg.norm(commanded, axis=(1, 2)).max()
    np.testing.assert_allclose(made, commanded, atol=2.0 * turning * scale)
    # Σ|F|² / squeeze² over the internal modes is χ² with K (3n − 6) degrees of freedom.
    assert plausible(chi2_p(commanded / squeeze, 24 * (3 * n - 6)))


def test_natural_internal_forces_need_positioning_errors() -> None:
    with pytest.raises(UsageError, match="positioner"):
        simulate_campaign(exact_rig(), Options(internal=100.0), np.random.default_rng(0))
