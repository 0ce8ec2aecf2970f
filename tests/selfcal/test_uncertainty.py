"""Covariance, budget and Monte Carlo against each other and against closed forms."""

from dataclasses import replace

import numpy as np
from scipy import stats

from tdfscal import simulation
from tdfscal.estimation.fit import information
from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, UncertainValue
from tdfscal.selfcal.monte_carlo import Sampler
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.simulation import Options, Recorder
from tests.selfcal.campaigns import SQUEEZED, calibrated, distance

RIG = replace(
    simulation.reference_rig(),
    declared=DeclaredUncertainty(1e-5, 2e-5, 5e-5, 0.1, 1e-3, 0.05),
    gravity_tilt_std=2e-4,
)
BATCH = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(11), 2)
RESULT = calibrated(BATCH, RIG, 0)


def test_monte_carlo_agrees_with_the_covariance() -> None:
    parts = information(RESULT.fit)
    sampler = Sampler(RESULT.fit, parts, 1.0)
    T = 2000
    rotation, settled = sampler.draw(np.random.default_rng(3), T)
    assert settled.all()
    d = so3.log(rotation @ np.swapaxes(RESULT.fit.state.rotation, -1, -2)).reshape(T, -1)
    C = estimate(RESULT.fit).uncertainty.covariance
    white = np.linalg.solve(np.linalg.cholesky(C), (d - d.mean(axis=0)).T)
    # Whitened sample covariance: its diagonal is χ²/(T−1), its trace too.
    for row in white:
        assert 1e-4 < stats.chi2.cdf(row @ row, T - 1) < 1 - 1e-4
    assert np.abs(np.corrcoef(white) - np.eye(9)).max() < stats.norm.ppf(1 - 1e-6) / np.sqrt(T)


def test_trials_of_the_weakest_rigs_are_finite() -> None:
    """10 N against 2 N: yaw to a radian. The iteration may not settle; it never breaks."""
    rig = simulation.reference_rig()
    options = Options(internal=10.0, postures=9, recorder=Recorder(mean_sd=2.0))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(3), 3)
    for k in range(3):
        result = fit_robust(rig, postures(rig, batch.dwells(k))).fit
        sampler = Sampler(result, information(result), 1.0)
        rotation, settled = sampler.draw(np.random.default_rng(k), 500)
        assert np.allclose(np.linalg.det(rotation), 1.0, rtol=0, atol=1e-9)
        assert settled.mean() > 0.9


def test_mass_barycentre_and_zeros_all_unknown_leave_the_angles_seen() -> None:
    """Theory, section 4: three directions are unseen, and they never reach the angles."""
    free = replace(
        simulation.reference_rig(),
        mass=UncertainValue(np.asarray(500.0), np.asarray(np.inf)),
        barycentre=UncertainValue(np.array([0, 0, 0.25]), np.full(3, np.inf)),
        zero=UncertainValue(np.zeros((3, 3)), np.full((3, 3), np.inf)),
    )
    batch = simulation.simulate_dwells(free, Options(squeeze=300.0), np.random.default_rng(6), 1)
    result = calibrated(batch, free, 0)
    assert len(information(result.fit).null) == 3
    assert 1e-4 < stats.chi2.cdf(distance(batch.truth.rotation[0], result), 9) < 1 - 1e-4
    assert np.isinf(result.uncertainty.parameter_std).any()
