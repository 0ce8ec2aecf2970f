"""Axes that no sensor measures, in motion: the balance across their forces."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.errors import DataError
from tdfscal.estimation.uncertainty import estimate
from tdfscal.model import statics
from tdfscal.motioncal import preparation as checks
from tdfscal.motioncal.blocks import Block, across
from tdfscal.motioncal.design import instants
from tdfscal.motioncal.estimator import fit_moving
from tdfscal.motioncal.fit import MovingPriors
from tdfscal.motioncal.pipeline import calibrate_moving
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import Rig
from tdfscal.simulation.moving_campaign import MovingCampaign
from tdfscal.simulation.options import MovingOptions
from tdfscal.simulation.truth import make_rig
from tests.motioncal.campaigns import DELAY, distance, played, true_state
from tests.words import in_words

#: What a channel reads that is not connected, N.
_DEAD = 7.3


def lacking(rig: Rig, slow: Slow, *missing: tuple[int, int]) -> tuple[Rig, Slow]:
    """Rig and streams without some axes (support, axis)."""
    axes = rig.axes.copy()
    for support, axis in missing:
        axes[support, axis] = False
    return replace(rig, axes=axes), replace(slow, force=np.where(axes, slow.force, _DEAD))


@pytest.fixture(scope="module")
def half_minute() -> tuple[MovingCampaign, Slow, tuple[Block, ...]]:
    return played(MovingOptions(duration=30.0, frequency=0.12), 3)


@pytest.fixture(scope="module")
def four() -> tuple[MovingCampaign, Slow, tuple[Block, ...]]:
    return played(MovingOptions(duration=40.0, frequency=0.09), 4, make_rig(4))


@pytest.mark.parametrize("missing", [((2, 1),), ((2, 0), (2, 1)), ((2, 0), (2, 1), (3, 0), (3, 1))])
def test_no_free_force_is_left_and_white_noise_stays_white(
    four: tuple[MovingCampaign, Slow, tuple[Block, ...]], missing: tuple[tuple[int, int], ...]
) -> None:
    campaign, slow, (block, *_) = four
    rig, slow = lacking(campaign.rig, slow, *missing)
    state = true_state(campaign).still
    at = statics.balance(
        instants(rig, slow, slow.position[block.index], block.index),
        state,
        state.barycentre,
        rig.gravity,
    )
    found = across(block, at, rig.axes)
    assert found.seen.shape == (6 - len(missing), 6)
    assert np.abs(found.wrench(at.free)).max() < 1e-9
    K = np.einsum("knra,knsa->rs", at.wrench, at.wrench) / len(at.arm)
    assert found.course is not None
    rows = found.seen @ found.course
    whole = rows @ K @ np.swapaxes(rows, 1, 2)
    assert whole == pytest.approx(np.broadcast_to(np.eye(len(found.seen)), whole.shape), abs=1e-9)


def test_a_dead_channel(half_minute: tuple[MovingCampaign, Slow, tuple[Block, ...]]) -> None:
    campaign, slow, cut = half_minute
    priors = MovingPriors(campaign.rig, slow, DELAY)
    whole = estimate(fit_moving(priors, cut, true_state(campaign))).uncertainty
    rig, dead = lacking(campaign.rig, slow, (2, 1))
    fit = fit_moving(MovingPriors(rig, dead, DELAY), cut, true_state(campaign))
    known = estimate(fit).uncertainty
    assert fit.converged
    away = distance(campaign, fit.state.still.rotation, known.covariance)
    assert chi2_quantile(1e-3, 9) < away < chi2_quantile(1 - 1e-3, 9)
    more = np.sqrt(np.diag(known.covariance) / np.diag(whole.covariance))
    assert 1.0 < np.sqrt(np.mean(more**2)) < 2.0
    assert np.isfinite(known.parameter_std[: 3 * rig.n]).all()


@pytest.mark.parametrize("cells", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_load_cells(four: tuple[MovingCampaign, Slow, tuple[Block, ...]], cells: int) -> None:
    """Of two, a push along their joining line turns with the terminal, and hardly shows."""
    campaign, slow, _ = four
    known = 4 - cells
    missing = ((support, axis) for support in range(known, 4) for axis in (0, 1))
    rig, slow = lacking(campaign.rig, slow, *missing)
    found = calibrate_moving(rig, slow, DELAY)
    assert found.observability.undetermined == rig.supports[known:]
    covariance = found.uncertainty.covariance[: 3 * known, : 3 * known]
    away = distance(campaign, found.fit.state.still.rotation, covariance)
    assert chi2_quantile(1e-3, 3 * known) < away < chi2_quantile(1 - 1e-3, 3 * known)
    if cells == 1:
        assert not found.reasons
        assert any(rig.supports[3] in text for text in in_words(found.findings))
        assert found.residual.after[:, 0].max() < 3.0  # N; the free forces are hundreds


def test_a_dead_axis_is_to_be_declared(
    half_minute: tuple[MovingCampaign, Slow, tuple[Block, ...]],
) -> None:
    campaign, slow, _ = half_minute
    rig, dead = lacking(campaign.rig, slow, (2, 1))
    with pytest.raises(DataError, match=r"write `axes: \[x, z\]` for ncp3"):
        checks.check_stream(campaign.rig, dead)
    checks.check_stream(rig, dead)
