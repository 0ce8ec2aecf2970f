"""What is stated covers; the spectrum is that of the noise; trials confirm the interval."""

import numpy as np
import pytest

from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.dynamics import PARAMETERS
from tdfscal.motioncal.estimator import fit_moving
from tdfscal.motioncal.fit import MovingFit, MovingPriors
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.simulation.moving_campaign import MovingCampaign
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, distance, played, true_state


def fitted(options: MovingOptions, seed: int) -> tuple[MovingCampaign, MovingFit]:
    campaign, slow, cut = played(options, seed)
    return campaign, fit_moving(MovingPriors(campaign.rig, slow, DELAY), cut, true_state(campaign))


@pytest.fixture(scope="module")
def minute() -> tuple[MovingCampaign, MovingFit]:
    return fitted(MovingOptions(), 3)


def test_a_minute_of_motion_says_how_well(minute: tuple[MovingCampaign, MovingFit]) -> None:
    campaign, fit = minute
    assert fit.converged
    found = estimate(fit)
    known = found.uncertainty
    moving_std = known.parameter_std[-PARAMETERS:]
    away = distance(campaign, fit.state.still.rotation, known.covariance)
    assert chi2_quantile(1e-3, 9) < away < chi2_quantile(1 - 1e-3, 9)
    std = np.sqrt(np.diag(known.covariance))
    assert 0.07e-3 < std.mean() < 0.13e-3
    truth = true_state(campaign).moving.vector
    assert np.all(np.abs(fit.state.moving.vector - truth) < 4 * moving_std)
    assert moving_std[7] < 1e-3 < abs(fit.state.moving.delay)  # 5 ms were seen


def test_the_spectrum_is_that_of_the_noise(minute: tuple[MovingCampaign, MovingFit]) -> None:
    _, fit = minute
    density, _ = fit.noise.density(np.array([0.7, 1.5, 2.5]))
    assert density == pytest.approx(1.75**2 / 250, rel=0.25)
