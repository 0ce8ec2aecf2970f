"""Drift and returns from the residuals, and priors on the angles themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.errors import NotIdentifiableError
from tdfscal.numerics import so3
from tdfscal.significance import CHANGED_RIG
from tdfscal.simulation import Drift, Faults
from tests.selfcal.campaigns import SQUEEZED, calibrated
from tests.words import in_words

RIG = simulation.reference_rig()


def returning(faults: Faults) -> simulation.Batch:
    """A campaign of 18 postures whose first six are visited again at the end."""
    planned = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(1), 1).means.position[
        0
    ]
    command = np.concatenate([planned[:18], planned[:6]])
    options = replace(SQUEEZED, squeeze=0.0, command=command, faults=faults)
    return simulation.simulate_dwells(RIG, options, np.random.default_rng(2), 5)


def test_returns_are_found_and_quiet_on_a_sound_machine() -> None:
    batch = returning(Faults())
    for i in range(5):
        found = calibrated(batch, RIG, i).stability
        assert found.returns == 6
        assert found.repeat is not None
        assert found.repeat.p_value > 1e-4
        assert found.drift.p_value > 1e-4
        assert not in_words(found.findings)


def test_a_drifting_zero_shows_as_trend_and_between_visits() -> None:
    batch = returning(Faults(drifts=(Drift(0, (0.7, -0.7, 0.7)),)))
    for i in range(5):
        result = calibrated(batch, RIG, i)
        assert result.stability.repeat is not None
        assert result.stability.drift.p_value < CHANGED_RIG
        assert result.stability.repeat.p_value < CHANGED_RIG
        assert "drifts" in " ".join(in_words(result.suspicions[0].findings(rejects=False)))


def test_angles_known_by_their_prior_are_not_a_measurement() -> None:
    """A prior sharper than the data: the estimate stays there, and no number is printed."""
    batch = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(3), 1)
    truth = so3.to_rpy(batch.truth.rotation[0])
    sharp = replace(RIG, nominal_rpy=truth, rpy_std=np.full((3, 3), 1e-6))
    with pytest.raises(NotIdentifiableError, match="mostly that of its prior"):
        calibrated(batch, sharp, 0)


def test_a_mild_prior_on_the_angles_narrows_and_is_in_the_budget() -> None:
    batch = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(3), 1)
    truth = so3.to_rpy(batch.truth.rotation[0])
    free = calibrated(batch, RIG, 0).uncertainty
    mild = replace(RIG, nominal_rpy=truth, rpy_std=3 * free.rpy_std)
    held = calibrated(batch, mild, 0).uncertainty
    # Independent information adds: 1/9 of the data's own, angle by angle and at least that much
    # where the angles are correlated.
    assert (held.rpy_std < free.rpy_std).all()
    assert (held.rpy_std > free.rpy_std * np.sqrt(0.5)).all()
    assert (held.contributions["prior angles"] > 0).all()
