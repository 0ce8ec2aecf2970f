"""Noise as the calibration found it, when a later log is judged."""

import numpy as np
import pytest

from tdfscal.validation.residual_wrench import AS_STATED, KnownNoise


def test_a_level_from_residuals_widens_the_tail_as_few_of_them_do() -> None:
    rng, dof, freedom = np.random.default_rng(1), 30, 12
    ratio = rng.chisquare(freedom, 200_000) / (rng.chisquare(dof, 200_000) / dof)
    known = KnownNoise(1.5, dof)
    for edge in (20.0, 30.0):
        assert known.chi2_sf(edge, freedom) == pytest.approx(np.mean(ratio > edge), rel=0.1)
        assert AS_STATED.chi2_sf(edge, freedom) < known.chi2_sf(edge, freedom)
