"""Monte Carlo in motion: against the linear interval, and against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.motioncal.estimator import MovingFit, MovingPriors, fit_moving
from tdfscal.motioncal.uncertainty import estimate, simulate
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, played, true_state

ALL = np.ones(3, dtype=np.bool_)


@pytest.fixture(scope="module")
def fit() -> MovingFit:
    campaign, slow, cut = played(MovingOptions(rate=100.0, duration=40.0, slow_noise=0.3), 3)
    return fit_moving(MovingPriors(campaign.rig, slow, DELAY), cut, true_state(campaign))


def test_trials_confirm_the_interval_of_a_plain_minute(fit: MovingFit) -> None:
    linear = estimate(fit)
    found = simulate(linear, np.random.default_rng(4), 20_000, ALL)
    assert found.trials == 20_000
    assert found.validated
    assert found.std == pytest.approx(linear.uncertainty.rpy_std, rel=0.03)


def test_a_wrong_interval_is_refuted(fit: MovingFit) -> None:
    linear = estimate(fit)
    known = linear.uncertainty
    wrong = replace(known, rpy_covariance=0.25 * known.rpy_covariance)
    assert np.all(wrong.rpy_std < 0.6 * known.rpy_std)
    found = simulate(replace(linear, uncertainty=wrong), np.random.default_rng(6), 20_000, ALL)
    assert not found.validated
