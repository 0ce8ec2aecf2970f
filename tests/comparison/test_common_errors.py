"""What all campaigns take as exact: foretold moves of the pool against months with that error."""

from dataclasses import replace

import numpy as np

from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import pool
from tdfscal.estimation.exact_quantities import UNMOVED, exact_quantities, with_unmoved
from tdfscal.estimation.fit import information
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, Drift, ExactMoves, FloatArray, Rig
from tdfscal.selfcal.estimator import Fit, fit
from tdfscal.simulation import make_rig
from tests.comparison.histories import history

QUIET = DeclaredUncertainty(positioner=1e-5, force_noise=0.05)
SIZES = [12, 4, 1, 8]


def months(rig: Rig, tilt: tuple[float, float] = (0.0, 0.0)) -> list[Recorded]:
    """Campaigns alike to the last draw but for the direction of gravity."""
    rng = np.random.default_rng(3)
    return history(rig, rng, months=len(SIZES), postures_each=SIZES, zero=0.5, tilt=tilt)[0]


def pooled(campaigns: list[Recorded], index: int) -> Fit:
    """The estimate at one campaign, with the others as its prior."""
    together, rig = pool(campaigns), campaigns[index].rig
    own = together.members[index].fit
    assert own is not None
    informed = replace(rig, earlier=together.others(index))
    return fit(informed, own.postures, own.state, own.weight)


def moved(wrong: Fit, right: Fit) -> FloatArray:
    """Turns (3n,), rad, BCS, from one estimate to the other."""
    back = np.swapaxes(right.state.rotation, 1, 2)
    return np.asarray(so3.log(wrong.state.rotation @ back).ravel())


def quantity(of: Fit, name: str) -> ExactMoves:
    (found,) = (one for one in exact_quantities(of, information(of)) if one.name == name)
    return found


def test_a_level_that_all_campaigns_have_wrong_moves_the_pool() -> None:
    walk, index = 1e-4, 1
    rig = replace(make_rig(zero_std=0.5, declared=QUIET), drift=Drift(angle=walk))
    right = pooled(months(rig), index)
    tilt = np.array([1e-3, -5e-4])
    wrong = pooled(months(rig, (1e-3, -5e-4)), index)
    by_level = quantity(right, "base level")
    predicted = by_level.turns(3) @ tilt / by_level.error
    assert np.abs(predicted).max() > 1e-4
    np.testing.assert_allclose(moved(wrong, right), predicted, atol=0.05 * np.abs(predicted).max())


def test_a_tare_is_each_campaigns_own() -> None:
    """As good as exact, and wrong in one month: the others' tares have no part in it."""
    rig = make_rig(zero_std=0.1, declared=QUIET)
    campaigns, off = months(rig), np.array([1.0, -0.5, 0.0])
    right = pooled(campaigns, 3)
    found = quantity(right, "zeros")
    assert found.turns(3).shape == (9, 9 * len(SIZES))
    for month, item in enumerate(campaigns):
        assert item.postures is not None
        force = item.postures.force.copy()
        force[:, 1] += off
        there = replace(item, postures=replace(item.postures, force=force))
        wrong = moved(pooled([*campaigns[:month], there, *campaigns[month + 1 :]], 3), right)
        # Its own come first, then those of the other months.
        first = 9 * ((month + 1) % len(SIZES)) + 3
        predicted = found.turns(3)[:, first : first + 3] @ off
        assert np.abs(predicted).max() > 1e-6
        np.testing.assert_allclose(wrong, predicted, atol=0.05 * np.abs(predicted).max())


def test_a_turn_before_the_last_campaign_counts_as_exact() -> None:
    """What the earlier campaigns say of one sensor's pitch is off by as much as it turned."""
    rig, index, size = make_rig(zero_std=0.5, declared=QUIET), len(SIZES) - 1, 1e-3
    plain = months(rig)
    right = pooled(plain, index)
    nobody = np.full((3, 3), 1e-12)
    nobody[1, 1] = size
    prior = with_unmoved(pool(plain).others(index), nobody)
    own = fit(replace(rig, earlier=prior), right.postures, right.state, right.weight)
    step = np.linalg.inv(so3.rpy_jacobian(right.state.rotation))[1, :, 1] * size
    rng = np.random.default_rng(3)
    turned = history(
        rig,
        rng,
        months=index + 1,
        postures_each=SIZES,
        zero=0.5,
        steps=[(index, 1, (step[0], step[1], step[2]))],
    )[0]
    missed = moved(pooled(turned, index), right)
    missed[3:6] -= step
    predicted = -quantity(own, UNMOVED).turns(3)[:, 4]
    assert np.abs(predicted).max() > 1e-4
    np.testing.assert_allclose(missed, predicted, atol=0.05 * size)
