"""The score that noise in the readings makes, against its mean over many draws."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.model.parameters import layout
from tdfscal.motioncal.estimator import at_state
from tdfscal.motioncal.fit import MovingPriors
from tdfscal.records import FloatArray
from tests.motioncal.campaigns import DELAY, perfect_rig, played, quiet, true_state

#: Noise of a reading at the slow rate, N, and draws of it.
NOISE, DRAWS = 20.0, 80


@pytest.mark.slow
def test_the_score_of_gains_and_compliance_is_what_noise_makes_of_it() -> None:
    campaign, slow, cut = played(quiet(duration=20.0, rate=100.0), rig=perfect_rig())
    rig, state = campaign.rig, true_state(campaign)
    flat = at_state(MovingPriors(rig, slow, DELAY), cut, state, None).noise
    H = len(flat.knot)
    density = np.concatenate([np.full(H, np.log(NOISE**2 * slow.step)), np.full(H, -60.0)])
    model = replace(flat, log_density=density)
    rng = np.random.default_rng(2)
    scores: list[FloatArray] = []
    expected: list[FloatArray] = []
    for _ in range(DRAWS):
        force = slow.force + NOISE * rng.standard_normal(slow.force.shape)
        fit = at_state(MovingPriors(rig, replace(slow, force=force), DELAY), cut, state, model)
        slope = fit.slope_at(state)
        columns = fit.data.design @ slope
        both = np.concatenate([fit.residual[:, None], columns], axis=1)
        real = fit.data.weighted(both, model.variance(fit.data.bins))
        scores.append(real[:, 1:].T @ real[:, 0])
        if len(expected) < 3:
            expected.append(fit.noise_pull)
    place = layout(3)
    for group in ("sensitivity", "compliance", "rotation"):
        drawn = np.array(scores)[:, place[group]]
        mean, spread = drawn.mean(axis=0), drawn.std(axis=0) / np.sqrt(DRAWS)
        far = (mean - np.mean(expected, axis=0)[place[group]]) / spread
        assert np.all(np.abs(far) < 4.0), group
        if group == "sensitivity":  # without the correction it would be far off
            assert np.abs(mean / spread).max() > 8.0
