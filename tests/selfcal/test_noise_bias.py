"""Scores of gains and compliance where nothing is wrong but the readings are noisy."""

import numpy as np
import pytest

from tdfscal.estimation.fit import information
from tdfscal.model.parameters import layout
from tdfscal.selfcal.score_tests import noise_scores
from tdfscal.simulation import Options, Recorder, reference_rig, simulate_dwells
from tests.selfcal.campaigns import fitted

RUNS = 24


@pytest.mark.slow
def test_scores_have_the_mean_that_noise_gives_them() -> None:
    rig = reference_rig()
    options = Options(squeeze=20.0, postures=120, recorder=Recorder(mean_sd=6.0))
    batch = simulate_dwells(rig, options, np.random.default_rng(5), RUNS)
    place = layout(rig.n)
    asked = np.r_[place["sensitivity"], place["compliance"]]
    raw, corrected = [], []
    for run in range(RUNS):
        dwells = batch.dwells(run)
        fit = fitted(rig, dwells).fit
        columns = fit.slopes.reshape(-1, len(fit.active))[:, asked]
        left = information(fit).left[: len(columns)]
        apart = columns - left @ (left.T @ columns)
        score = apart.T @ fit.white[: len(columns)]
        std = np.linalg.norm(apart, axis=0)
        raw.append(score / std)
        corrected.append((score - noise_scores(fit)[asked]) / std)
    # The mean of RUNS numbers of standard deviation 1; of 20 components the largest.
    limit = 3.7 / np.sqrt(RUNS)
    assert np.abs(np.mean(corrected, axis=0)).max() < limit
    # Negative control: the vertical compliance leans by more than a standard deviation.
    assert np.mean(raw, axis=0)[-1] < -0.9
