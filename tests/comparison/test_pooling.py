"""Several campaigns as one estimate: against one joint least squares, and against the truth."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import Pool, pool
from tdfscal.estimation.fit import Priors, information
from tdfscal.model.parameters import constants, layout, nominal, retract
from tdfscal.numerics import so3
from tdfscal.records import Drift, FloatArray, Rig
from tdfscal.selfcal.estimator import at_state, fit
from tdfscal.simulation import reference_rig
from tests.comparison.histories import alarms, history


def estimate(rig: Rig, pooled: Pool, index: int) -> tuple[FloatArray, FloatArray]:
    """Rotations and covariance of the rotations at one campaign: the others as its prior."""
    member, recorded = pooled.members[index], rig
    informed = replace(recorded, earlier=pooled.others(index))
    assert member.fit is not None
    result = fit(informed, member.fit.postures, member.fit.state, member.fit.weight)
    root = information(result).root
    free = np.flatnonzero(result.active) < 3 * rig.n
    return result.state.rotation, (root @ root.T)[np.ix_(free, free)]


def joint_least_squares(campaigns: list[Recorded], one_tare: bool) -> tuple[FloatArray, FloatArray]:
    """All campaigns in one Gauss–Newton: constants shared, zeros too where they have one tare."""
    rig = campaigns[0].rig
    priors = Priors(rig)
    everywhere = constants(rig.n)
    everywhere[layout(rig.n)["zero"]] = one_tare
    common = everywhere[priors.active]
    C, o, K = int(common.sum()), int((~common).sum()), len(campaigns)
    states = [nominal(rig)] * K
    for _ in range(12):
        rows, residuals, pull = [], [], np.zeros(C + K * o)
        for k, (item, state) in enumerate(zip(campaigns, states, strict=True)):
            assert item.postures is not None
            at = at_state(rig, item.postures, state, np.ones(len(item.postures)))
            J = (at.at.whitener @ at.jacobian).reshape(-1, C + o)
            r = (at.at.whitener @ at.residual[..., None]).ravel()
            own = np.abs(at.prior_jacobian[:, ~common]).any(axis=1)
            kept = np.flatnonzero(own | (k == 0))
            J = np.concatenate([J, at.prior_jacobian[kept]])
            wide = np.zeros((len(J), C + K * o))
            wide[:, :C], wide[:, C + k * o : C + (k + 1) * o] = J[:, common], J[:, ~common]
            rows.append(wide)
            residuals.append(np.concatenate([r, at.prior_residual[kept]]))
            by_noise = at.noise_pull[priors.active]
            pull[:C] += by_noise[common]
            pull[C + k * o : C + (k + 1) * o] += by_noise[~common]
        J, r = np.concatenate(rows), np.concatenate(residuals)
        scale = np.linalg.norm(J, axis=0)
        r = r - np.linalg.lstsq((J / scale).T, pull / scale, rcond=None)[0]
        move = -np.linalg.lstsq(J / scale, r, rcond=None)[0] / scale
        moved = []
        for k, state in enumerate(states):
            step, part = np.zeros(len(priors.active)), np.zeros(C + o)
            part[common], part[~common] = move[:C], move[C + k * o : C + (k + 1) * o]
            step[priors.active] = part
            moved.append(retract(state, step))
        states = moved
    covariance = np.linalg.inv((J / scale).T @ (J / scale)) / scale[:, None] / scale
    return states[0].rotation, covariance[: 3 * rig.n, : 3 * rig.n]


@pytest.mark.parametrize("one_tare", [False, True])
def test_pooled_is_the_joint_least_squares(one_tare: bool) -> None:
    """Zeros drawn anew every month, or the same: then the error of a tare counts once."""
    rig, sizes, zero = reference_rig(), [8, 5, 1, 5, 2], 0.0 if one_tare else 0.5
    rng = np.random.default_rng(1)
    campaigns, _ = history(rig, rng, months=5, postures_each=sizes, zero=zero)
    expected, covariance = joint_least_squares(campaigns, one_tare)
    pooled = pool(campaigns)
    assert pooled.common.tare == ((0,) * 5 if one_tare else (0, 1, 2, 3, 4))
    for index in (0, 2, 4):  # the last, the first and one of a single posture
        rotation, own = estimate(rig, pooled, index)
        away = so3.log(rotation @ np.swapaxes(expected, 1, 2)).ravel()
        assert np.abs(away / np.sqrt(np.diag(covariance))).max() < 1e-3
        np.testing.assert_allclose(np.diag(own), np.diag(covariance), rtol=1e-4)
    assert not alarms(pooled)


def test_unchanged_campaigns_fit_each_other() -> None:
    """Noise in its own column makes a score of the hinges' breathing; it is no misfit."""
    campaigns, _ = history(reference_rig(), np.random.default_rng(0), months=3, postures_each=24)
    assert not alarms(pool(campaigns))


def test_a_heavy_turn_is_one_sensors_in_one_campaign() -> None:
    rig, rng = reference_rig(), np.random.default_rng(1)
    turn = (0.0, 40e-3, 30e-3)
    campaigns, _ = history(rig, rng, months=4, postures_each=16, steps=[(3, 1, turn)])
    (found,) = alarms(pool(campaigns))
    assert (found.onset, found.sensor) == (3, 1)
    assert np.abs(found.turn - turn).max() < 1.5e-3


def test_a_walk_widens_what_old_campaigns_say() -> None:
    rig = replace(reference_rig(), drift=Drift(angle=1e-3))
    campaigns, truth = history(rig, np.random.default_rng(4), months=4, walk=1e-3)
    pooled = pool(campaigns)
    rotation, covariance = estimate(rig, pooled, 3)
    away = so3.log(truth[3] @ np.swapaxes(rotation, 1, 2)).ravel()
    still = replace(rig, drift=Drift())
    fixed = pool([replace(item, rig=still) for item in campaigns])
    assert not alarms(pooled)
    assert alarms(fixed)
    assert away @ np.linalg.solve(covariance, away) < 27.9  # χ²₉ at 0.1 %
    assert np.trace(covariance) > 2 * np.trace(estimate(still, fixed, 3)[1])
