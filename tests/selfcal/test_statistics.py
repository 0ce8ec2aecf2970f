"""Truth from the simulator: errors within what is stated, by the distributions themselves."""

from dataclasses import replace

import numpy as np
from scipy import stats

from tdfscal import simulation
from tdfscal.model.statics import postures
from tdfscal.records import DeclaredUncertainty
from tdfscal.selfcal.linear_method import evaluate_linear, fit_linear
from tdfscal.selfcal.pipeline import self_calibrate
from tdfscal.simulation import Options, Recorder
from tests.selfcal.campaigns import SQUEEZED, calibrated, distance, turns

#: A test fails by chance once in this many times the number of its checks.
RARE = 1e-4


def within(value: float, distribution: stats.rv_continuous, *args: float) -> bool:
    """Both tails of the distribution are larger than RARE."""
    return bool(RARE < distribution.cdf(value, *args) < 1 - RARE)


def test_an_undeclared_tilt_of_gravity_is_not_covered() -> None:
    """Negative control: the statistics above do fail when the rig is not what its file says."""
    rig = simulation.reference_rig()
    tilted = replace(rig, gravity_tilt_std=2e-3)
    batch = simulation.simulate_dwells(tilted, SQUEEZED, np.random.default_rng(1), 1)
    result = calibrated(batch, rig, 0)
    assert distance(batch.truth.rotation[0], result) > stats.chi2.ppf(1 - RARE, 9)


def test_the_linear_method_states_every_declared_input() -> None:
    """Hinges, datums, gain, friction, level and compliance together, each larger than the noise."""
    declared = DeclaredUncertainty(
        positioner=1e-7, force_noise=0.02, hinge=2e-4, datum=2e-4, force_sensitivity=2e-3,
        hinge_moment=0.05, compliance_vertical=1e-7,
    )  # fmt: skip
    rig = simulation.make_rig(
        3, mass_std=1e-6, barycentre_std=1e-9, zero_std=1e-6, declared=declared
    )
    rig = replace(rig, gravity_tilt_std=1e-3)
    recorder = Recorder(mean_sd=0.05)
    options = Options(postures=40, tilt=np.radians(8.0), squeeze=300.0, recorder=recorder)
    runs, trials, total = 12, 200, 0.0
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(1), runs)
    for i in range(runs):
        fit = fit_linear(rig, postures(rig, batch.dwells(i)), np.ones(options.postures))
        C = evaluate_linear(fit, np.random.default_rng(i), trials).covariance
        d = turns(batch.truth.rotation[i], fit.state.rotation)
        # E[S⁻¹] = C⁻¹ (N − 1)/(N − p − 2) of a sample covariance S.
        total += float(d @ np.linalg.solve(C, d)) * (trials - 11) / (trials - 1)
    assert within(total, stats.chi2, 9 * runs)


def test_the_linear_method_is_judged_by_its_angles_and_the_data_by_the_likeliest() -> None:
    """Its own errors are no fault of a sound log; a zero that it takes as stated and is not, is."""
    recorder = Recorder(mean_sd=0.02)
    options = Options(postures=40, tilt=np.radians(8.0), squeeze=300.0, recorder=recorder)
    rig = simulation.make_rig(3)
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(2), 1)
    unknown = replace(rig.zero, value=rig.zero.value + 5.0, std=np.full((3, 3), np.inf))
    for given, apart in ((rig, False), (replace(rig, zero=unknown), True)):
        dwells, rng = batch.dwells(0), np.random.default_rng(0)
        result = self_calibrate(given, dwells, rng=rng, estimator="linear", max_trials=200)
        assert result.quality.birge < given.acceptance.birge_max
        assert any(found.code == "linear-apart" for found in result.reasons) is apart
        assert apart or distance(batch.truth.rotation[0], result) < stats.chi2.ppf(1 - RARE, 9)
