"""Monte Carlo in motion: against the linear interval, and against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.motioncal.estimator import MovingFit, MovingPriors, fit_moving
from tdfscal.motioncal.uncertainty import Sampler, estimate, simulate
from tdfscal.numerics import so3
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
    # 48 spectra share the trials; 5 % are left to their chance.
    assert found.std == pytest.approx(linear.uncertainty.rpy_std, rel=0.05)


def test_a_known_spectrum_leaves_the_covariance_of_the_noise_alone(fit: MovingFit) -> None:
    sure = replace(fit, noise=replace(fit.noise, covariance=np.zeros_like(fit.noise.covariance)))
    rng, known = np.random.default_rng(5), estimate(sure)
    turns = so3.log(
        Sampler(known, rng, np.ones((3, 1))).draw(rng, 8000)
        @ np.swapaxes(fit.state.still.rotation, 1, 2)
    ).reshape(8000, -1)
    covariance = known.uncertainty.covariance
    # Standard error of a variance from 8000 draws: 1.6 %.
    assert turns.var(axis=0) == pytest.approx(np.diagonal(covariance), rel=0.08)


def test_a_wrong_interval_is_refuted(fit: MovingFit) -> None:
    linear = estimate(fit)
    known = linear.uncertainty
    wrong = replace(known, rpy_covariance=0.25 * known.rpy_covariance)
    assert np.all(wrong.rpy_std < 0.6 * known.rpy_std)
    found = simulate(replace(linear, uncertainty=wrong), np.random.default_rng(6), 20_000, ALL)
    assert not found.validated
