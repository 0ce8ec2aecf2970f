"""Laws of the engine over observations of every kind: at rest, in motion, whatever is missing."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.estimation.fit import Priors, factored_information, information
from tdfscal.estimation.judged import ChangeSearch
from tdfscal.estimation.observation import eliminate, stated
from tdfscal.estimation.uncertainty import Estimate, estimate
from tdfscal.model.calibrated import free_constants
from tdfscal.model.parameters import prior_std, with_motions
from tdfscal.model.statics import postures
from tdfscal.motioncal import estimator as motion_trials
from tdfscal.motioncal.estimator import fit_moving
from tdfscal.motioncal.fit import MovingFit, MovingPriors
from tdfscal.records import Drift, Rig
from tdfscal.selfcal import monte_carlo
from tdfscal.selfcal.estimator import Fit, at_state, fit
from tdfscal.selfcal.mounting_search import best_start
from tdfscal.simulation import Options
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, played, true_state

SQUEEZED = Options(squeeze=100.0)


def at_rest(rig: Rig) -> Estimate[Fit]:
    batch = simulation.simulate_dwells(rig, SQUEEZED, np.random.default_rng(1), 1)
    seen = postures(rig, batch.dwells(0))
    return estimate(fit(rig, seen, best_start(rig, seen).state))


def without_an_axis() -> Estimate[Fit]:
    rig = simulation.reference_rig()
    axes = rig.axes.copy()
    axes[2, 1] = False
    return at_rest(replace(rig, axes=axes))


def moving() -> Estimate[MovingFit]:
    campaign, slow, cut = played(MovingOptions(rate=100.0, duration=40.0, slow_noise=0.3), 3)
    priors = MovingPriors(campaign.rig, slow, DELAY)
    return estimate(fit_moving(priors, cut, true_state(campaign)))


KINDS: dict[str, Callable[[], Estimate[Any]]] = {
    "three sensors": lambda: at_rest(simulation.reference_rig()),
    "four sensors": lambda: at_rest(simulation.make_rig(4)),
    "an axis missing": without_an_axis,
    "zeros that drift": lambda: at_rest(
        replace(simulation.reference_rig(), drift=Drift(time=1e-3))
    ),
    "in motion": moving,
}


@cache
def played_kind(name: str) -> Estimate[Any]:
    return KINDS[name]()


@pytest.fixture(params=list(KINDS))
def known(request: pytest.FixtureRequest) -> Estimate[Any]:
    return played_kind(request.param)


def test_slopes_by_free_parameters_are_the_jacobian(known: Estimate[Any]) -> None:
    slopes, (_, J) = known.fit.all_slopes(), known.fit.whitened()
    own = J[: len(slopes), : int(known.fit.active.sum())]
    assert np.allclose(slopes[:, known.fit.active], own, rtol=0, atol=1e-9 * np.abs(own).max())


def test_no_free_parameter_lowers_the_misfit(known: Estimate[Any]) -> None:
    """But for what noise in the columns seems to lower.

    In standard uncertainties; in motion a look ends within a hundredth of one per parameter.
    """
    residual, _ = known.fit.whitened()
    by_noise = np.zeros(len(known.parts.root))
    if isinstance(known.fit, Fit):
        by_noise = known.fit.noise_pull[known.fit.active]
    pull = np.linalg.norm(known.parts.left.T @ residual - known.parts.root.T @ by_noise)
    assert pull < 0.01 * np.sqrt(len(known.parts.values))
    assert known.fit.cost == pytest.approx(residual @ residual)


def test_shares_of_the_budget_are_the_variance(known: Estimate[Any]) -> None:
    shares = known.uncertainty.contributions
    assert np.allclose(sum(shares.values()), known.uncertainty.rpy_std**2, rtol=1e-9, atol=0)
    assert all((share >= -1e-30).all() for name, share in shares.items() if name != "noise")


def test_a_factor_says_what_all_rows_say(known: Estimate[Any]) -> None:
    roots = [parts.root for parts in (information(known.fit), factored_information(known.fit))]
    whole, factored = (root @ root.T for root in roots)
    scale = np.sqrt(np.diagonal(whole))
    assert np.allclose((whole - factored) / np.outer(scale, scale), 0, atol=1e-6)


def test_a_score_is_the_fall_of_chi_square(known: Estimate[Any]) -> None:
    """Rao's statistic of further columns, against least squares with and without them."""
    residual, J = known.fit.whitened()
    columns = np.random.default_rng(0).standard_normal((len(J), 2))
    search = ChangeSearch(known.parts.root, len(J), known.parts.left.T @ residual)
    sums = ((columns.T @ each)[None] for each in (J, columns, residual))
    asked = search.likeliest("zero", 0, *sums)
    left = []
    for rows in (J, np.concatenate([J, columns], axis=1)):
        size = np.linalg.norm(rows, axis=0)
        unit = rows / np.where(size > 0, size, 1.0)
        rest = residual - unit @ np.linalg.lstsq(unit, residual, rcond=1e-13)[0]
        left.append(float(rest @ rest))
    assert asked.unknowns == 2
    assert asked.statistic == pytest.approx(left[0] - left[1], rel=0.02, abs=1e-3)


def test_all_parameters_together_have_the_published_rotations(known: Estimate[Any]) -> None:
    turns = 4.0 * known.uncertainty.covariance
    found = known.calibrated_at(turns)
    n = 3 * known.fit.rig.n
    assert np.allclose(found.covariance[:n, :n], turns, rtol=1e-9, atol=0)
    scale = np.sqrt(np.diagonal(found.covariance))
    unit = found.covariance / np.outer(scale, scale).clip(1e-300)
    assert np.linalg.eigvalsh(unit).min() > -1e-9


@pytest.mark.parametrize("name", [name for name in KINDS if name != "in motion"])
def test_an_observation_and_what_is_stated_are_the_posterior(name: str) -> None:
    """Of the constants, whose own zeros are eliminated."""
    known = played_kind(name)
    of, reference = known.fit, with_motions(known.fit.still, 0)
    assert isinstance(of, Fit)
    own = eliminate(of, reference).information
    prior = stated(Priors(of.rig), reference)
    free = np.flatnonzero(of.active[: len(free_constants(of.rig))] & free_constants(of.rig))
    place = np.searchsorted(np.flatnonzero(of.active), free)
    posterior = known.parts.root @ known.parts.root.T
    expected = posterior[np.ix_(place, place)]
    scale = np.sqrt(np.diagonal(expected))
    # The furthest that anything can be off is a weak prior on what is not stated.
    together = (own + prior).covariance
    assert np.allclose((together - expected) / np.outer(scale, scale), 0, atol=1e-5)


def test_observations_add() -> None:
    """Where nothing is a campaign's own, two halves say what the whole does."""
    rig = simulation.reference_rig()
    rig = replace(rig, zero=replace(rig.zero, std=np.zeros((3, 3))))
    assert not (prior_std(rig) > 0)[9:18].any()
    whole = at_rest(rig).fit
    half = np.arange(len(whole.postures)) < len(whole.postures) // 2
    fits = [
        whole,
        *(
            at_state(rig, whole.postures.subset(some), whole.state, whole.weight[some])
            for some in (half, ~half)
        ),
    ]
    both, one, two = (eliminate(at, whole.state).information for at in fits)
    assert np.allclose((one + two).matrix, both.matrix, rtol=0, atol=1e-9 * both.matrix.max())
    size = np.abs(one.score).max()
    assert np.allclose((one + two).score, both.score, rtol=0, atol=1e-9 * size)


def test_trials_confirm_the_interval_and_refute_a_wrong_one(known: Estimate[Any]) -> None:
    """20,000 of them have the linear standard uncertainties, within five standard errors."""
    drawn = motion_trials.simulate if known.fit.moving else monte_carlo.simulate
    spread, whole = known.uncertainty, known.fit.rig.axes.all(axis=1)
    found = drawn(known, np.random.default_rng(4), 20_000, whole)
    assert found.trials == 20_000
    assert found.validated
    ratio = (found.std / spread.rpy_std)[whole]
    assert np.abs(ratio - 1).max() < 5 / np.sqrt(2 * 20_000)
    narrow = replace(spread, rpy_covariance=spread.rpy_covariance / 4)
    again = drawn(replace(known, uncertainty=narrow), np.random.default_rng(6), 10_000, whole)
    assert not again.validated
