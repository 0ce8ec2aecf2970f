"""Covariance of a dwell's mean against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import poisson

from tdfscal.dwells import find_dwells
from tdfscal.dwells.field import segment
from tdfscal.dwells.noise_level import Signals
from tdfscal.records import Dwells
from tdfscal.significance import LEVEL_CHANGES_PER_LOG
from tdfscal.simulation import Options, Recorder, reference_rig, run
from tests.words import in_words

from .rig_log import Recipe, Recorded, record


def force_variance(dwells: Dwells) -> np.ndarray:
    return np.asarray(np.diagonal(dwells.force_cov, axis1=2, axis2=3))


def squared_z(recorded: Recorded, dwells: Dwells) -> np.ndarray:
    """Mahalanobis distance squared of each mean force from the truth, (K, n)."""
    assert len(dwells) == len(recorded.stops)
    error = dwells.force - recorded.force
    precision = np.linalg.inv(dwells.force_cov)
    return np.asarray(np.einsum("kni,knij,knj->kn", error, precision, error))


@pytest.mark.parametrize(("tau", "rate", "stop"), [(0.0, 50, 4.0), (0.05, 200, 3.0)])
def test_noise_averages_as_its_closed_form(tau: float, rate: float, stop: float) -> None:
    sigma = 1.7
    recipe = Recipe(rate=rate, stops=(stop,) * 25, force_noise=sigma, force_tau=tau)
    dwells_of = [find_dwells(record(replace(recipe, seed=seed)).log) for seed in (1, 2)]
    phi = np.exp(-1 / (rate * tau)) if tau else 0.0
    n = np.concatenate([d.count for d in dwells_of])[:, :, None]
    # Var(mean of n) of a first-order autoregression, exact; of white noise 1/n.
    truth = (1 + phi) / (1 - phi) / n - 2 * phi * (1 - phi**n) / ((1 - phi) * n) ** 2
    ratio = np.concatenate([force_variance(d) for d in dwells_of]) / truth / sigma**2
    # Nine independent axes, each estimated from many ordinates; below 40 of them in no case.
    assert np.all(np.abs(ratio - 1) < 5 * np.sqrt(2 / 40))
    assert abs(ratio.mean() - 1) < 0.15
    effective = np.concatenate([d.effective for d in dwells_of])
    assert np.all(effective <= n[..., 0])
    assert 0.5 < (effective[..., None] * truth).mean() < 1.5


def test_noise_as_slow_as_the_stops_is_stated_alike_in_all_axes() -> None:
    """0.3 N of noise slow as 2 s under 1.1 N of white noise at 100 Hz, stops of 5 s."""
    tau, rate, total, spread, dof = 2.0, 100, 0.0, [], 0
    phi = np.exp(-1 / (rate * tau))
    for seed in range(4):
        recorded = record(Recipe(rate=rate, stops=(5.0,) * 15, force_noise=1.1, seed=seed))
        white = np.random.default_rng(seed).standard_normal((len(recorded.log.force[0].time), 9))
        white[1:] *= np.sqrt(1 - phi**2)
        slow = 0.3 * lfilter([1.0], [1.0, -phi], white, axis=0)
        for i, series in enumerate(recorded.log.force):
            series.value[:] += slow[:, 3 * i : 3 * i + 3]
        dwells = find_dwells(recorded.log)
        z2 = squared_z(recorded, dwells)
        total, dof = total + z2.sum(), dof + 3 * z2.size
        std = np.sqrt(force_variance(dwells).mean(axis=0))
        spread.append(std.max() / std.min())
    # What noise slower than a stop does to its mean is extrapolated: within a factor of two.
    assert 0.5 < total / dof < 2.0
    # Each axis by itself would be taken for white or for red as chance has it: a factor of four.
    assert np.median(spread) < 1.3


def test_noise_shared_by_two_axes_is_seen_as_correlation() -> None:
    recorded = record(Recipe(stops=(3.0,) * 20, seed=3))
    common = np.random.default_rng(0).standard_normal(len(recorded.log.force[0].time))
    recorded.log.force[0].value[:, 0] += common
    recorded.log.force[0].value[:, 1] += common
    cov = find_dwells(recorded.log).force_cov[:, 0]
    correlation = cov[:, 0, 1] / np.sqrt(cov[:, 0, 0] * cov[:, 1, 1])
    # Half the variance is common; the sample correlation of 40 pairs and more.
    assert np.all(np.abs(correlation - 0.5) < 4 * 0.75 / np.sqrt(40))
    assert np.all(np.linalg.eigvalsh(cov) > 0)


def test_a_louder_dwell_keeps_its_own_scatter_and_the_others_theirs() -> None:
    recorded = record(Recipe(rate=500, stops=(3.0,) * 12, seed=4))
    loud, factor = 5, 2.0
    begin, end = recorded.stops[loud]
    rng = np.random.default_rng(9)
    for series in recorded.log.force:
        inside = (series.time >= begin) & (series.time <= end)
        extra = rng.standard_normal((inside.sum(), 3)) * np.sqrt(factor**2 - 1)
        series.value[inside] += extra
    dwells = find_dwells(recorded.log)
    sd = np.sqrt(force_variance(dwells) * dwells.count[:, :, None])
    others = np.delete(sd, loud, axis=0)
    np.testing.assert_allclose(sd[loud] / others.mean(axis=0), factor, rtol=0.1)
    assert np.ptp(others, axis=0).max() < 1e-9


def test_rounded_constant_positions_state_their_resolution() -> None:
    quantum = 1e-6
    recorded = record(Recipe(position_noise=0.0, quantum=quantum, stops=(3.0,) * 20))
    dwells = find_dwells(recorded.log)
    assert len(dwells) == 20
    variance = np.diagonal(dwells.position_cov, axis1=2, axis2=3)
    np.testing.assert_allclose(variance, quantum**2 / 12, rtol=0.02)
    error = dwells.position - recorded.position
    assert np.abs(error).max() < 0.51 * quantum


def test_drift_is_flagged_with_its_time_and_does_not_widen_the_noise() -> None:
    recipe = Recipe(rate=200, drift=0.5, stops=(4.0,) * 12, seed=2)
    dwells = find_dwells(record(recipe).log)
    assert len(dwells) == 12
    assert any(f"{dwells.start[3]:.2f}" in w and "drifts" in w for w in in_words(dwells.findings))
    ratio = force_variance(dwells) * dwells.count[:, :, None]
    assert np.all(np.abs(ratio - 1) < 5 * np.sqrt(2 / 40))
    quiet = find_dwells(record(Recipe(rate=200, stops=(4.0,) * 12, seed=2)).log)
    assert not in_words(quiet.findings)


def test_a_change_of_level_that_no_reading_shows_is_none() -> None:
    """Windows as long as half a stop differ here by chance, by more than their noise as found."""
    recorder = Recorder(force_rate=30.0, position_rate=30.0)
    options = Options(postures=16, squeeze=200.0, recorder=recorder)
    played = run(reference_rig(), "self", options, np.random.default_rng(21)).campaign
    assert played is not None
    dwells = find_dwells(played.log)
    assert len(dwells) == 16
    assert not dwells.left_out
    assert not dwells.findings


@pytest.mark.parametrize(("stops", "length"), [(4, 68), (8, 66)])
def test_noise_of_which_a_log_shows_little_is_no_change_of_level(stops: int, length: int) -> None:
    """White noise of stops hardly longer than the two longest windows, in bins."""
    base = np.tile(np.arange(length + 4) >= length, stops)
    false = 0
    for seed in range(100):
        value = np.random.default_rng(seed).standard_normal((9, len(base)))
        marked, _ = segment(Signals(value, base, np.zeros(9)), base, 0.02)
        false += bool((marked & ~base).any())
    assert false <= poisson.ppf(0.999, 100 * LEVEL_CHANGES_PER_LOG)
