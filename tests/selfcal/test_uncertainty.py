"""Covariance, budget and Monte Carlo against each other and against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal import simulation
from tdfscal.errors import NotIdentifiableError
from tdfscal.estimation.fit import Priors, information
from tdfscal.model.statics import balance, features_jacobian, postures
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import spectrum
from tdfscal.numerics.rotation_fits import descend
from tdfscal.records import DeclaredUncertainty, FloatArray, UncertainValue
from tdfscal.selfcal.estimator import Fit, estimate, evaluate
from tdfscal.selfcal.monte_carlo import Sampler, simulate
from tdfscal.selfcal.mounting_search import profile
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
    rotation, settled = sampler.solve(sampler.draw(np.random.default_rng(3), T))
    assert settled.all()
    d = so3.log(rotation @ np.swapaxes(RESULT.fit.state.rotation, -1, -2)).reshape(T, -1)
    C = evaluate(RESULT.fit, parts, 1.0).covariance
    white = np.linalg.solve(np.linalg.cholesky(C), (d - d.mean(axis=0)).T)
    # Whitened sample covariance: its diagonal is χ²/(T−1), its trace too.
    for row in white:
        assert 1e-4 < stats.chi2.cdf(row @ row, T - 1) < 1 - 1e-4
    assert np.abs(np.corrcoef(white) - np.eye(9)).max() < stats.norm.ppf(1 - 1e-6) / np.sqrt(T)


def test_trials_are_solved_to_the_end() -> None:
    parts = information(RESULT.fit)
    sampler = Sampler(RESULT.fit, parts, 1.0)
    drawn = sampler.draw(np.random.default_rng(4), 200)
    rotation, _ = sampler.solve(drawn)
    whole = sampler.roots(drawn, np.arange(200))
    start = np.broadcast_to(RESULT.fit.state.rotation, rotation.shape)
    best = descend(whole, start, iterations=100, tolerance=1e-6, curved=True).rotation
    std = np.sqrt(np.diagonal(evaluate(RESULT.fit, parts, 1.0).covariance))
    off = so3.log(rotation @ np.swapaxes(best, -1, -2)).reshape(200, -1)
    assert np.abs(off / std).max() < 1e-3  # single precision, and the last step


def redrawn(result: Fit, rng: np.random.Generator) -> FloatArray:
    """Rotations (n, 3, 3) of one campaign whose readings, poses and priors are drawn anew."""
    seen, at, rig = result.at.seen, result.at, result.rig
    root = np.linalg.cholesky(seen.force_cov)
    noisy = seen.force + (root @ rng.standard_normal((*seen.force.shape, 1)))[..., 0]
    again = balance(replace(seen, force=noisy), result.state, at.centre, rig.gravity)
    # The estimate's own weights and lever arms; only the columns of the readings are drawn anew.
    design = at.design.copy()
    design[:, :, : 9 * rig.n] = again.design[:, :, : 9 * rig.n]
    turn = np.linalg.cholesky(at.turn_cov) @ rng.standard_normal((len(seen), 3, 1))
    # A constant in every posture: its column of the statistic belongs to y's last entry.
    shift = (at.whitener @ at.noise_turn @ turn)[..., 0].ravel()
    priors = Priors(rig)
    rows = (at.whitener @ design).reshape(-1, design.shape[2])
    given = profile(rig, at, rows, result.state, priors)
    constant = np.zeros((len(rows), 9 * rig.n + 1))
    constant[:, -1] = shift
    offset = np.zeros((len(given.prior), 9 * rig.n + 1))
    offset[:, -1] = rng.standard_normal(len(given.prior))
    other = np.flatnonzero(priors.active) >= 3 * rig.n
    slopes = features_jacobian(result.state, at, rig.gravity)[:, priors.active]
    both = np.concatenate([rows @ slopes, priors(result.state)[1]])[:, other]
    explained = spectrum(both).left
    new = np.concatenate([constant, offset])
    new -= explained @ (explained.T @ new)
    whole = np.concatenate([rows @ given.features, given.prior]) + new
    start = result.state.rotation[None]
    return np.asarray(
        descend(whole, start, iterations=100, tolerance=1e-6, curved=True).rotation[0]
    )


@pytest.mark.parametrize("internal", [200.0, 12.0])
def test_trials_on_the_statistic_are_those_of_the_readings(internal: float) -> None:
    """Strong and weak rigs: mean and scatter of the angles as if every reading were drawn."""
    rig, many = simulation.reference_rig(), 60
    options = Options(internal=internal, recorder=Recorder(mean_sd=1.0))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(2), 1)
    result = fit_robust(rig, postures(rig, batch.dwells(0))).fit
    rng, base = np.random.default_rng(5), np.swapaxes(result.state.rotation, 1, 2)
    slow = so3.log(np.stack([redrawn(result, rng) for _ in range(many)]) @ base)
    sampler = Sampler(result, information(result), 1.0)
    fast = so3.log(sampler.solve(sampler.draw(rng, 4000))[0] @ base)
    std = fast.std(axis=0)
    off = (slow.mean(axis=0) - fast.mean(axis=0)) / std * np.sqrt(many)
    assert np.abs(off).max() < stats.norm.ppf(1 - 1e-4 / 18)
    scatter = np.sum((slow - slow.mean(axis=0)) ** 2, axis=0) / std**2
    assert stats.chi2.ppf(1e-4 / 18, many - 1) < scatter.min()
    assert scatter.max() < stats.chi2.ppf(1 - 1e-4 / 18, many - 1)


def test_trials_of_the_weakest_rigs_are_finite() -> None:
    """10 N against 2 N: yaw to a radian. The iteration may not settle; it never breaks."""
    rig = simulation.reference_rig()
    options = Options(internal=10.0, postures=9, recorder=Recorder(mean_sd=2.0))
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(3), 3)
    for k in range(3):
        result = fit_robust(rig, postures(rig, batch.dwells(k))).fit
        sampler = Sampler(result, information(result), 1.0)
        rotation, settled = sampler.solve(sampler.draw(np.random.default_rng(k), 500))
        assert np.allclose(np.linalg.det(rotation), 1.0, rtol=0, atol=1e-9)
        assert settled.mean() > 0.9


def test_adaptive_stop_and_validation() -> None:
    known, every = estimate(RESULT.fit), np.ones(3, dtype=np.bool_)
    spread = known.uncertainty
    found = simulate(known, np.random.default_rng(0), 20_000, every)
    assert found.trials == 20_000
    assert found.validated
    assert np.abs(found.std / spread.rpy_std - 1).max() < 5 / np.sqrt(2 * 20_000)
    narrow = replace(spread, rpy_covariance=spread.rpy_covariance / 4)
    narrowed = replace(known, uncertainty=narrow)
    again = simulate(narrowed, np.random.default_rng(0), 10_000, every)
    assert not again.validated


def test_vertical_loads_show_no_yaw_however_many_postures() -> None:
    """Only noise would seem to know the yaw, and it is not believed."""
    soft = replace(RIG, declared=DeclaredUncertainty(force_noise=0.1))
    options = Options(postures=60, stiffness=1.0, recorder=Recorder(mean_sd=0.5))
    options = replace(options, stiffness=np.diag([1e3, 1e3, 1e9]), travel=0.0)
    batch = simulation.simulate_dwells(soft, options, np.random.default_rng(0), 1)
    with pytest.raises(NotIdentifiableError) as caught:
        calibrated(batch, soft, 0)
    assert caught.value.finding.values["angles"] == [f"yaw of ncp{i}" for i in (1, 2, 3)]


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
