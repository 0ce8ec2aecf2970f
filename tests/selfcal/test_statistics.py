"""Truth from the simulator: errors within what is stated, by the distributions themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal import simulation
from tdfscal.model.statics import postures
from tdfscal.records import DeclaredUncertainty
from tdfscal.selfcal.linear_method import (
    evaluate_linear,
    fit_linear,
)
from tdfscal.simulation import Options, Recorder
from tests.selfcal.campaigns import SQUEEZED, calibrated, study, turns

#: A test fails by chance once in this many times the number of its checks.
RARE = 1e-4


def within(value: float, distribution: stats.rv_continuous, *args: float) -> bool:
    """Both tails of the distribution are larger than RARE."""
    return bool(RARE < distribution.cdf(value, *args) < 1 - RARE)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "squeeze"), [(3, 0.0), (3, 200.0), (4, 50.0)])
def test_errors_are_as_large_as_stated(n: int, squeeze: float) -> None:
    rig, trials = simulation.make_rig(n), 40
    seen = study(rig, Options(squeeze=squeeze), seed=n, trials=trials)
    # Σ d² over independent campaigns of a 3n-vector is χ² with 3n·N degrees of freedom.
    assert within(float(seen.distance.sum()), stats.chi2, 3 * n * trials)
    inside = int(np.sum(np.abs(seen.error) < stats.norm.ppf(0.975) * seen.stated, axis=0).min())
    assert stats.binom.cdf(inside, trials, 0.95) > RARE
    # χ² of the fits: the stated noise is the noise that is there.
    chi2, dof = (sum(getattr(r.quality, name) for r in seen.results) for name in ("chi2", "dof"))
    assert within(chi2, stats.chi2, dof)
    assert not any(r.rejected or r.reasons for r in seen.results)


def test_an_undeclared_tilt_of_gravity_is_not_covered() -> None:
    """Negative control: the statistics above do fail when the rig is not what its file says."""
    rig = simulation.reference_rig()
    tilted = replace(rig, gravity_tilt_std=2e-3)
    batch = simulation.simulate_dwells(tilted, SQUEEZED, np.random.default_rng(1), 1)
    result = calibrated(batch, rig, 0)
    d = turns(batch.truth.rotation[0], result.fit.state.rotation)
    distance = d @ np.linalg.solve(result.uncertainty.covariance, d)
    assert distance > stats.chi2.ppf(1 - RARE, 9)


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
        fit = fit_linear(rig, postures(rig, batch.dwells(i)))
        C = evaluate_linear(fit, np.random.default_rng(i), trials).covariance
        d = turns(batch.truth.rotation[i], fit.state.rotation)
        # E[S⁻¹] = C⁻¹ (N − 1)/(N − p − 2) of a sample covariance S.
        total += float(d @ np.linalg.solve(C, d)) * (trials - 11) / (trials - 1)
    assert within(total, stats.chi2, 9 * runs)
