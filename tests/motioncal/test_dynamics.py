"""The model of motion against the simulator's physics, which was written apart from it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tdfscal.model import dynamics
from tdfscal.model.dynamics import Moving
from tdfscal.model.parameters import retract
from tdfscal.motioncal.estimator import at_state
from tdfscal.motioncal.fit import MovingPriors
from tdfscal.records import FloatArray
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, perfect_rig, played, quiet, true_state

FAST = quiet(duration=20.0, frequency=0.25)


def residual(options: MovingOptions, change: Callable[[Moving], Moving] = lambda m: m) -> float:
    """Root mean square of the residual's coefficients at the truth, times what is changed."""
    campaign, slow, cut = played(options, rig=perfect_rig())
    state = true_state(campaign)
    state = replace(state, moving=change(state.moving))
    fit = at_state(MovingPriors(campaign.rig, slow, DELAY), cut, state, None)
    return float(np.sqrt(np.mean(np.abs(fit.residual) ** 2)))


def test_the_balance_closes_at_the_truth() -> None:
    """What is left are micrometres of bending; each term of the motion is far above that."""
    left = residual(FAST)
    assert residual(FAST, lambda m: replace(m, friction=0.0)) > 10 * left
    assert residual(FAST, lambda m: replace(m, delay=0.0)) > 10 * left
    assert residual(FAST, lambda m: replace(m, inertia=1.1 * m.inertia)) > 10 * left


def test_features_and_their_jacobian_agree() -> None:
    campaign, *_ = played(replace(FAST, duration=10.0))
    still = true_state(campaign).still
    rng = np.random.default_rng(1)
    moving = Moving.of(rng.standard_normal(dynamics.PARAMETERS))
    centre = still.barycentre + 0.1
    jac = dynamics.features_jacobian(still, centre)
    cut = jac.shape[1] - dynamics.PARAMETERS
    for _ in range(5):
        step = np.asarray(rng.standard_normal(jac.shape[1]))
        h = 1e-6

        def at(size: float, step: FloatArray) -> FloatArray:
            return dynamics.features(
                retract(still, size * step[:cut]),
                Moving.of(moving.vector + size * step[cut:]),
                centre,
                Moving.of(np.zeros(dynamics.PARAMETERS)),
            )

        numeric = (at(h, step) - at(-h, step)) / (2 * h)
        assert jac @ step == pytest.approx(numeric, rel=1e-6, abs=1e-4)
