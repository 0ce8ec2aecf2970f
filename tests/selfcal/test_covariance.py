"""Covariance and its sources by propagating each, what noise fakes by drawing it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal.estimation.fit import information
from tdfscal.estimation.uncertainty import (
    EARLIER,
    NOISE,
    Uncertainty,
    evaluate,
    quality,
    without_faked,
)
from tdfscal.model.parameters import EVEN_TURN, layout, nominal, prior_std, retract
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.selfcal.estimator import Fit, fit

from .test_estimator import RIG, RNG, SEEN, SIZE, earlier


def close(found: FloatArray, expected: FloatArray) -> bool:
    return np.allclose(found, expected, rtol=1e-6, atol=0)


def spread(result: Fit, birge: float = 1.0) -> Uncertainty:
    """Uncertainty of a fit, were its residuals so large."""
    parts = information(result)
    return evaluate(result, parts, replace(quality(result, parts), birge=birge)).uncertainty


def test_covariance_sources_by_propagating_each() -> None:
    """Gain times each source's covariance, written out; together the posterior covariance."""
    result = fit(RIG, SEEN, nominal(RIG))
    parts = information(result)
    at, posterior = result.at, parts.root @ parts.root.T
    gain = [
        posterior @ J.T @ np.linalg.inv(C) for J, C in zip(result.jacobian, at.cov, strict=True)
    ]
    moment = np.diag([0, 0, 0, 1, 1, 1]) * RIG.declared.hinge_moment**2
    by_moment = sum(g @ moment @ g.T for g in gain)[:9, :9]
    R = result.state.rotation
    spreads = spread(result)
    assert close(spreads.contributions["hinge friction"], so3.rpy_variance(R, by_moment))
    by_place = sum(
        g @ B @ C @ B.T @ g.T for g, B, C in zip(gain, at.noise_turn, at.turn_cov, strict=True)
    )[:9, :9]
    assert close(spreads.contributions["positioner"], so3.rpy_variance(R, by_place))
    rows = prior_std(RIG)[result.active]
    inside = np.zeros(SIZE, dtype=bool)
    inside[layout(3)["zero"]] = True
    zero = posterior[:9, inside[result.active]] / rows[inside[result.active]]
    assert close(spreads.contributions["zero"], so3.rpy_variance(R, zero @ zero.T))
    assert not spreads.contributions[EARLIER].any()
    assert close(spreads.coverage_factor, stats.norm.ppf(0.975))


def test_degrees_of_freedom_of_a_scaled_noise_are_welch_satterthwaites() -> None:
    result = fit(RIG, SEEN, nominal(RIG))
    parts = information(result)
    dof = quality(result, parts).dof
    for birge, own in ((2.0, False), (1.0, True)):
        seen = replace(result.postures, noise_from_residuals=own)
        spreads = spread(replace(result, postures=seen), birge)
        total = spreads.rpy_std**2
        noise = sum(spreads.contributions[name] for name in NOISE)
        expected = dof / (noise / total) ** 2
        assert close(spreads.coverage_factor, stats.t.ppf(0.975, expected))


def test_an_earlier_campaign_adds_its_degrees_and_its_share() -> None:
    rig, step, _ = earlier()
    result = fit(rig, SEEN, retract(nominal(RIG), step))
    parts = information(result)
    own = quality(result, parts)
    assert own.chi2 == result.cost
    assert own.dof == result.rows + len(result.prior_residual) - len(parts.values)
    assert own.birge == pytest.approx(np.sqrt((result.cost + 30.0) / (own.dof + 25)))
    spreads = spread(result, 2.0)
    assert (spreads.contributions[EARLIER] > 0).all()
    noise = sum(spreads.contributions[name] for name in NOISE)
    expected = (own.dof + 25) / (noise / spreads.rpy_std**2) ** 2
    assert close(spreads.coverage_factor, stats.t.ppf(0.975, expected))
    assert np.allclose(sum(spreads.contributions.values()), spreads.rpy_std**2, rtol=1e-9, atol=0)


def test_faked_information_is_the_mean_of_what_noise_alone_shows() -> None:
    """Σ [n]×ᵀ Bᵀ W B [n]× of drawn noise n, averaged."""
    result = fit(RIG, SEEN, nominal(RIG))
    result = replace(result, weight=np.where(np.arange(len(SEEN)) < 4, 0.0, 1.0))
    W = result.at.information * result.weight[:, None, None]
    draws, rng = 3000, np.random.default_rng(3)
    total = np.zeros((draws, 9, 9))
    S = result.state
    for k in range(len(SEEN)):
        for i in range(3):
            X = S.rotation[i] @ np.linalg.inv(
                np.eye(3) + S.sensitivity[i][[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
            )
            n = rng.multivariate_normal(np.zeros(3), SEEN.force_cov[k, i], size=draws) @ X.T
            B = np.concatenate([np.eye(3), so3.hat(result.at.arm[k, i])])
            lever = B @ so3.hat(n)
            block = np.swapaxes(lever, 1, 2) @ W[k] @ lever
            total[:, 3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += block
    found = result.faked_information()
    scale = np.sqrt(np.outer(np.diagonal(found), np.diagonal(found)))
    error = np.abs(total.mean(axis=0) - found) / scale
    assert error.max() < 5 * (total.std(axis=0) / scale).max() / np.sqrt(draws)


def test_covariance_without_the_faked_information() -> None:
    """(Λ − N)⁻¹ Λ (Λ − N)⁻¹, and never more than a turn spread over the circle."""
    A = RNG.normal(size=(9, 9))
    information = 1e6 * (A @ A.T + np.eye(9))
    faked = 0.3 * information[0, 0] * np.diag([0, 0, 0.01, 0, 0.001, 0, 0, 0, 0])
    C = np.asarray(np.linalg.inv(information), dtype=np.float64)
    none = np.zeros((0, 9))
    left = np.linalg.inv(information - faked)
    expected = left @ information @ left
    assert np.allclose(without_faked(C, faked, none), expected, rtol=1e-8, atol=1e-14)
    assert np.allclose(without_faked(C, 0 * faked, none), C, rtol=1e-8, atol=1e-16)
    everything = without_faked(C, 2 * information, none)
    assert np.allclose(everything, EVEN_TURN**2 * np.eye(9), rtol=1e-6, atol=1e-6)
    blind = np.zeros((1, 9))
    blind[0, 5] = 1.0
    found = without_faked(C, 0 * faked, blind)
    assert found[5, 5] == pytest.approx(EVEN_TURN**2, rel=1e-4)


def test_a_birge_ratio_scales_what_averages_out_and_nothing_else() -> None:
    result = fit(RIG, SEEN, nominal(RIG))
    one, three, less = (spread(result, b).contributions for b in (1.0, 3.0, 0.3))
    for name, share in one.items():
        factor = 9.0 if name in NOISE else 1.0
        # What noise fakes belongs to the noise and grows with all of it: a few per mille here.
        close = 0.02 if name == "noise" else 1e-9
        assert np.allclose(three[name], factor * share, rtol=close, atol=1e-20), name
        assert np.array_equal(less[name], share)
