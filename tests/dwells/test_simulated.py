"""Dwells of simulated campaigns: the simulator's truth, its own settling, vibration and moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2, poisson

from tdfscal.dwells import find_dwells
from tdfscal.dwells.field import segment
from tdfscal.dwells.noise_level import Signals
from tdfscal.records import FloatArray
from tdfscal.significance import LEVEL_CHANGES_PER_LOG
from tdfscal.simulation import Options, Recorder, reference_rig, run, simulate_campaign

CASES = {
    "as it comes": Recorder(),
    "slow rate": Recorder(force_rate=50.0, position_rate=50.0),
    "fast rate": Recorder(force_rate=1000.0, position_rate=250.0, dwell=(1.5, 2.5)),
    "short stops": Recorder(dwell=(1.0, 1.4), force_rate=200.0, settling=0.2),
    "long settling": Recorder(settling=1.0, settling_force=15.0),
    "correlated noise": Recorder(noise_correlation=0.05, dwell=(4.0, 8.0)),
}


@dataclass(frozen=True)
class Score:
    """true : dwells driven. hit : found. astray : not within a true dwell. z : of mean forces."""

    true: int
    hit: int
    astray: int
    z: FloatArray


def score(recorder: Recorder, seeds: range, postures: int) -> Score:
    rig = reference_rig()
    options = Options(postures=postures, recorder=recorder)
    true = hit = astray = 0
    z = []
    for seed in seeds:
        campaign = simulate_campaign(rig, options, np.random.default_rng(seed))
        dwells = find_dwells(campaign.log)
        # The same campaign without noise: what a perfect sensor reads at rest, at the end of it.
        quiet = replace(recorder, force_sd=(0.0, 0.0), settling=0.0, vibration=0.0)
        still = replace(options, recorder=quiet)
        clean = simulate_campaign(rig, still, np.random.default_rng(seed))
        true += len(campaign.start)
        for k in range(len(dwells)):
            j = int(np.argmax(np.minimum(campaign.end, dwells.end[k])
                              - np.maximum(campaign.start, dwells.start[k])))  # fmt: skip
            edge = 1.01 / min(recorder.force_rate, recorder.position_rate) + 0.02
            inside = (dwells.start[k] > campaign.start[j] - edge) and (
                dwells.end[k] < campaign.end[j] + edge
            )
            astray += not inside
            hit += inside
            middle = 0.5 * (clean.start[j] + clean.end[j])
            level = np.stack([s.value[np.searchsorted(s.time, middle)] for s in clean.log.force])
            sd = np.sqrt(np.diagonal(dwells.force_cov[k], axis1=1, axis2=2))
            z.append((dwells.force[k] - level) / sd)
    return Score(true, hit, astray, np.array(z))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_true_dwells_are_found_and_their_means_are_right(name: str) -> None:
    found = score(CASES[name], range(12), 24)
    assert found.hit >= 0.99 * found.true
    assert found.astray == 0
    # Mean z per axis, chance included (0.3 of 12 dwells): well below one standard error.
    bias = found.z.mean(axis=0)
    assert np.sqrt((bias**2).mean()) < 0.6
    total = float((found.z**2).sum())
    low, high = chi2.ppf([1e-4, 1 - 1e-4], found.z.size)
    assert 0.85 * low < total < 1.2 * high


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
