"""Priors on the angles themselves."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.errors import NotIdentifiableError
from tdfscal.numerics import so3
from tests.selfcal.campaigns import SQUEEZED, calibrated

RIG = simulation.reference_rig()
BATCH = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(3), 1)
TRUTH = so3.to_rpy(BATCH.truth.rotation[0])


def test_angles_known_by_their_prior_are_not_a_measurement() -> None:
    """A prior sharper than the data: the estimate stays there, and no number is printed."""
    sharp = replace(RIG, nominal_rpy=TRUTH, rpy_std=np.full((3, 3), 1e-6))
    with pytest.raises(NotIdentifiableError, match="mostly that of its prior"):
        calibrated(BATCH, sharp, 0)


def test_a_mild_prior_on_the_angles_narrows_and_is_in_the_budget() -> None:
    free = calibrated(BATCH, RIG, 0).uncertainty
    mild = replace(RIG, nominal_rpy=TRUTH, rpy_std=3 * free.rpy_std)
    held = calibrated(BATCH, mild, 0).uncertainty
    # Independent information adds: 1/9 of the data's own, angle by angle and at least that much
    # where the angles are correlated.
    assert (held.rpy_std < free.rpy_std).all()
    assert (held.rpy_std > free.rpy_std * np.sqrt(0.5)).all()
    assert (held.contributions["prior angles"] > 0).all()
