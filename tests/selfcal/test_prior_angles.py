"""Priors on the angles themselves."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.errors import NotIdentifiableError
from tdfscal.numerics import so3
from tests.selfcal.campaigns import SQUEEZED, calibrated, fitted

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


@pytest.mark.parametrize("signs", [(-1, -1, 1), (1, -1, -1), (-1, 1, -1)])
def test_a_sensor_against_its_stated_mounting_is_rejected_with_the_signs(
    signs: tuple[int, int, int],
) -> None:
    """Two axes of opposite sign are half a turn, which no stated 0.2 rad allows."""
    held, free = (replace(RIG, rpy_std=np.full((3, 3), std)) for std in (0.2, np.inf))
    dwells = BATCH.dwells(0)
    force = dwells.force.copy()
    force[:, 1] *= signs
    for rig, rejected in ((held, True), (free, False)):
        result = fitted(rig, replace(dwells, force=force))
        (turned,) = (found for found in result.findings if found.code == "sensor-turned")
        assert turned.subject == ("ncp2",)
        assert turned.values["signs"] == list(signs)
        assert [found.code for found in result.reasons][:1] == ["mounting-suspected"] * rejected
    assert not fitted(held, dwells).reasons
