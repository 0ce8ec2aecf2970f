"""The estimator's sums of squares by brute force, its priors row by row, its answers by oracles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal import simulation
from tdfscal.estimation.fit import Priors, information
from tdfscal.estimation.uncertainty import quality
from tdfscal.model.calibrated import joint_prior
from tdfscal.model.parameters import constants, nominal, parameter_count, prior_std, retract
from tdfscal.model.postures import ZeroMotion, postures
from tdfscal.model.statics import balance, features
from tdfscal.numerics import so3
from tdfscal.numerics.information import Information
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig
from tdfscal.selfcal.estimator import at_state, fit, statistic
from tdfscal.simulation import Options

RNG = np.random.default_rng(41)
RIG = replace(
    simulation.reference_rig(),
    declared=DeclaredUncertainty(1e-5, 2e-5, 5e-5, 0.1, 1e-3, 0.05),
    gravity_tilt_std=2e-4,
)
BATCH = simulation.simulate_dwells(RIG, Options(squeeze=100.0), RNG, 1)
SEEN = postures(RIG, BATCH.dwells(0))
SIZE = parameter_count(3)


@pytest.fixture(scope="module")
def off() -> FloatArray:
    """A step away from the nominal state, of some standard deviations."""
    std = prior_std(RIG)
    scale = np.where(np.isfinite(std), std, 0.01)
    return np.asarray(scale * np.random.default_rng(2).normal(size=SIZE))


def test_rows_of_the_priors_are_deviations_over_their_std(off: FloatArray) -> None:
    std = prior_std(RIG)
    state = retract(nominal(RIG), off)
    priors = Priors(RIG)
    residual, rows = priors(state)
    held = np.isfinite(std) & (std > 0)
    assert np.array_equal(priors.active, std > 0)
    assert np.allclose(residual, (off / np.where(held, std, 1.0))[held], rtol=1e-9, atol=0)
    for j, unit in enumerate(np.eye(SIZE)[priors.active]):
        more, less = (priors(retract(state, s * 1e-6 * unit))[0] for s in (1, -1))
        assert np.allclose((more - less) / 2e-6, rows[:, j], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2])
def test_a_prior_on_angles_is_about_the_nominal_mounting(pitch: float) -> None:
    """Where roll and yaw are one turn it is on the turns about the axes of the base."""
    rpy_std = np.full((3, 3), np.inf)
    rpy_std[0], rpy_std[1, 1] = 0.02, 0.05
    mounted = np.array([[0.1, pitch, -0.2], [0.2, 0.1, 0.4], [0.0, 0.0, 0.0]])
    rig = replace(RIG, rpy_std=rpy_std, nominal_rpy=mounted)
    step = np.zeros(SIZE)
    step[:9] = turn = 0.01 * np.random.default_rng(5).normal(size=9)
    state = retract(nominal(rig), step)
    priors = Priors(rig)
    residual, rows = priors(state)
    angles = so3.to_rpy(state.rotation) - mounted
    first = turn[:3] if pitch > 1 else angles[0]
    assert np.allclose(residual[-4:-1], first / 0.02, rtol=1e-6, atol=1e-9)
    assert residual[-1] == pytest.approx(angles[1, 1] / 0.05, rel=1e-9)
    h = 1e-6
    for j in range(9):
        unit = h * np.eye(SIZE)[j]
        more, less = (priors(retract(state, s * unit))[0][-4:] for s in (1, -1))
        # A turn after a turn adds to the first order in both.
        assert np.allclose((more - less) / (2 * h), rows[-4:, j], rtol=1e-4, atol=0.4)


def earlier() -> tuple[Rig, FloatArray, FloatArray]:
    """A rig with knowledge of its constants: estimate's step, information matrix."""
    free = constants(3) & (prior_std(RIG) > 0)
    size = int(free.sum())
    scale = np.where(np.isfinite(prior_std(RIG)), prior_std(RIG), 1e-3)[free]
    mix = np.eye(size) + 0.1 * np.random.default_rng(8).normal(size=(size, size))
    matrix = (mix @ mix.T) / np.outer(scale, scale)
    mean = scale * np.random.default_rng(9).normal(size=size)
    prior = joint_prior(RIG, nominal(RIG), Information(matrix, matrix @ mean), 30.0, 25)
    step = np.zeros(SIZE)
    step[free] = mean
    return replace(RIG, earlier=prior), step, matrix


def test_earlier_campaigns_weigh_with_all_their_information(off: FloatArray) -> None:
    rig, step, matrix = earlier()
    estimate = retract(nominal(RIG), step)
    priors = Priors(rig)
    free = constants(3) & (prior_std(RIG) > 0)
    away = np.where(free, off, 0.0)
    state = retract(estimate, away)
    residual, rows = priors(state)
    own = len(priors.held)
    assert residual[own:] @ residual[own:] == pytest.approx(away[free] @ matrix @ away[free])
    assert len(residual) - own == int(free.sum())
    for j, unit in enumerate(np.eye(SIZE)[priors.active]):
        h = 1e-7
        more, less = (priors(retract(state, s * h * unit))[0] for s in (1, -1))
        scale = max(1.0, float(np.abs(rows[:, j]).max()))
        assert np.abs((more - less) / (2 * h) - rows[:, j]).max() < 1e-5 * scale


def test_zeros_that_move_do_not_belong_to_earlier_campaigns() -> None:
    rig, _, _ = earlier()
    motion = ZeroMotion(("time",), np.zeros((5, 3, 1)), np.array([0.1]))
    priors = Priors(rig, motion)
    state = replace(nominal(rig, 1), drift=np.full((1, 3, 3), 0.2))
    moved, _ = priors(state)
    still, _ = priors(replace(state, drift=np.zeros((1, 3, 3))))
    change = moved - still
    assert np.allclose(change[np.abs(change) > 0], 2.0, rtol=1e-12, atol=0)
    assert np.count_nonzero(change) == 9


def test_statistic_is_the_weighted_sum_of_squares(off: FloatArray) -> None:
    """|S ψ|² = Σ_k w_k e_kᵀ C_k⁻¹ e_k, posture by posture."""
    state = retract(nominal(RIG), off)
    at = balance(SEEN, state, RIG.barycentre.value, RIG.gravity)
    weight = np.random.default_rng(1).uniform(0, 1, len(SEEN))
    weight[2] = 0.0
    psi = features(state, at, RIG.gravity)
    e = at.design @ psi
    each = np.array([e[k] @ np.linalg.solve(at.cov[k], e[k]) for k in range(len(SEEN))])
    compressed = statistic(at, weight) @ psi
    assert compressed @ compressed == pytest.approx(weight @ each, rel=1e-9)
    found = at_state(RIG, SEEN, state, weight)
    assert np.allclose(found.distance, each, rtol=1e-8, atol=0)
    prior = found.prior_residual
    assert found.cost == pytest.approx(weight @ each + prior @ prior, rel=1e-9)
    used = len(SEEN) - 1
    assert found.rows == 6 * used
    assert found.dof == 6 * used + len(prior) - int((prior_std(RIG) > 0).sum())
    stated = quality(found, information(found))
    assert stated.dof == found.dof
    assert stated.chi2 == found.cost
    assert stated.p_value == pytest.approx(stats.chi2.sf(found.cost, found.dof), abs=1e-12)
    assert stated.birge == pytest.approx(np.sqrt(found.cost / found.dof))
    kept = e[weight > 0]
    assert stated.rms_force == pytest.approx(np.sqrt((kept[:, :3] ** 2).sum(axis=1).mean()))
    assert stated.rms_moment == pytest.approx(np.sqrt((kept[:, 3:] ** 2).sum(axis=1).mean()))


def test_postures_of_weight_zero_do_not_count() -> None:
    weight = np.ones(len(SEEN))
    weight[3:6] = 0.0
    spoilt = replace(SEEN, force=SEEN.force.copy())
    spoilt.force[3:6] += 500.0
    left = fit(RIG, spoilt, nominal(RIG), weight)
    none = fit(RIG, SEEN.subset(weight > 0), nominal(RIG))
    turn = so3.log(left.state.rotation @ np.swapaxes(none.state.rotation, 1, 2))
    assert np.abs(turn).max() < 1e-8
    assert left.rows == none.rows
    assert left.dof == none.dof
    assert quality(left, information(left)).rms_force == pytest.approx(
        quality(none, information(none)).rms_force, rel=1e-6
    )
