"""Gains and other parameters where nothing is wrong but readings and positions are noisy."""

import numpy as np
import pytest

from tdfscal.estimation.observability import noise_pull
from tdfscal.estimation.uncertainty import estimate
from tdfscal.frozen import replace
from tdfscal.model.parameters import deviation, layout
from tdfscal.model.statics import balance, postures
from tdfscal.records import DeclaredUncertainty
from tdfscal.selfcal.estimator import fit
from tdfscal.selfcal.score_tests import best_variance, suspicions
from tdfscal.simulation import Options, Recorder, make_rig, reference_rig, simulate_dwells
from tests.selfcal.test_statics import true_state


@pytest.mark.parametrize(
    ("noise", "positioner"), [(2.0, 1.0e-5), (0.02, 3.0e-5)], ids=["forces", "positions"]
)
def test_noise_makes_no_gain_however_many_the_postures(noise: float, positioner: float) -> None:
    declared = DeclaredUncertainty(
        positioner=positioner,
        hinge=2.0e-5,
        force_noise=0.01,
        force_sensitivity=5.0e-3,
        compliance_lateral=5.0e-8,  # what gives in the simulator
        compliance_vertical=5.0e-8,
    )
    rig = make_rig(declared=declared)
    options = Options(postures=3000, squeeze=200.0, recorder=Recorder(mean_sd=noise))
    batch = simulate_dwells(rig, options, np.random.default_rng(3), 1)
    truth, seen = true_state(rig, batch.truth.trial(0)), postures(rig, batch.dwells(0))
    known = estimate(fit(rig, seen, truth))
    std = known.uncertainty.parameter_std
    free = std > 0
    off = deviation(known.fit.state, truth)[free] / std[free]
    assert np.abs(off).max() < 4.0
    assert known.quality.p_value > 1e-3
    assert not suspicions(known, np.arange(len(seen), dtype=np.float64))
    # Negative control: so far would noise have pulled the gains.
    root, pull = known.parts.root, known.fit.noise_pull[free]
    shift = np.zeros(len(std))
    shift[free] = root @ (root.T @ pull) / std[free]
    assert np.abs(shift[layout(3)["sensitivity"]]).max() > 4.5


def test_the_pull_of_noise_is_what_small_changes_of_readings_and_positions_make() -> None:
    """Σ (∂Φ/∂ν)ᵀ W cov(ν) (∂e/∂ν) by differences, reading by reading and position by position."""
    rig, rng = reference_rig(), np.random.default_rng(1)
    options = Options(postures=12, squeeze=50.0, recorder=Recorder(mean_sd=1.0))
    batch = simulate_dwells(rig, options, rng, 1)
    seen, state = postures(rig, batch.dwells(0)), true_state(rig, batch.truth.trial(0))
    at, weight = balance(seen, state, rig.barycentre.value, rig.gravity), rng.uniform(0.5, 1, 12)
    W, expected = at.information * weight[:, None, None], 0.0
    by_place = (at.noise_turn[:, None] @ at.turn) @ seen.position_cov
    for name, step, gain in (
        ("force", 1.0, at.noise_force @ seen.force_cov),
        ("position", 1e-5, by_place),
    ):
        for i, a in np.ndindex(rig.n, 3):
            designs = []
            for sign in (step, -step):
                moved = getattr(seen, name).copy()
                moved[:, i, a] += sign
                other = replace(seen, **{name: moved})
                designs.append(balance(other, state, at.centre, rig.gravity).design)
            slope = (designs[0] - designs[1]) / (2 * step)
            expected = expected + np.einsum("kaq,kab,kb->q", slope, W, gain[:, i, :, a])
    found = noise_pull(at, state, W)
    scale = np.linalg.norm(at.whitener @ at.design, axis=(0, 1))
    assert np.allclose(
        found / scale, expected / scale, rtol=0, atol=1e-7 * np.abs(found / scale).max()
    )


def test_what_the_parameters_follow_asks_for_no_variance() -> None:
    """Of nine columns the parameters follow eight: the ninth alone speaks, by a closed form."""
    square = 6.25
    white = np.array([[0.0] * 8 + [np.sqrt(square), 0.0, 0.0, 0.0]])
    theta, gain = best_variance(np.eye(12, 9)[None], white, np.eye(12, 8)[None])
    assert theta == pytest.approx(square - 1, rel=1e-3)
    assert gain == pytest.approx(square - 1 - np.log(square), rel=1e-6)
