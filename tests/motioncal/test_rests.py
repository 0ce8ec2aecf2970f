"""Rests within a motion: what stands still there averages to nothing."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.motioncal.blocks import rests_of
from tdfscal.motioncal.estimator import at_state
from tdfscal.motioncal.fit import MovingPriors
from tdfscal.simulation.options import MovingOptions
from tests.motioncal.campaigns import DELAY, played, true_state

STOPS = replace(MovingOptions.stops(), rate=100.0, stiffness=(2e8, 2e8, 2e8), duration=76.0)


@pytest.mark.parametrize("way_off", ["place", "force"])
def test_what_is_off_at_a_rest_is_an_unknown_of_its_own(way_off: str) -> None:
    """One NCP stands 20 µm off at one posture, or its sensor reads 0.2 N more: the unknowns of that
    rest take it up, no other."""
    campaign, slow, cut = played(STOPS, 7)
    rig, state = campaign.rig, true_state(campaign)
    plain = at_state(MovingPriors(rig, slow, DELAY), cut, state, None)
    run = rests_of(slow, cut)[0][3]
    way = np.linalg.norm(slow.position - slow.position[run].mean(axis=0), axis=2).max(axis=1)
    near = np.exp(-0.5 * (way / 0.01) ** 2)
    near[: run.start - 40] = near[run.stop + 40 :] = 0.0
    position, force = slow.position.copy(), slow.force.copy()
    if way_off == "place":
        position[:, 1] += 2.0e-5 * near[:, None] * np.array([0.6, -0.5, 0.62])
    else:
        force[:, 1] += 0.2 * near[:, None] * np.array([0.6, -0.5, 0.62])
    there = replace(slow, position=position, force=force)
    moved = at_state(MovingPriors(rig, there, DELAY), cut, state, plain.noise)
    # Below 1 Hz: as it comes and goes, 20 µm in half a second shake the mass a little.
    slow_part = cut[0].frequency < 1.0
    rows = slice(3, 6) if way_off == "place" else slice(0, 6)
    change = (moved.wrenches()[0] - plain.wrenches()[0])[slow_part, rows].ravel()
    columns = plain.designs[0].rests[slow_part, rows].reshape(len(change), 8, 9)
    columns = np.split(columns, [3], axis=2)[way_off == "force"]
    own = columns[:, 3]
    both = np.concatenate([own.real, own.imag])
    amount, *_ = np.linalg.lstsq(both, np.concatenate([change.real, change.imag]), rcond=None)
    left = change - own @ amount
    assert np.linalg.norm(left) < 0.05 * np.linalg.norm(change)
    # In units of the prior: 20 µm, 0.2 N, where the rig file states 10 µm and 0.1 N per axis of
    # three NCPs.
    assert 0.5 < np.linalg.norm(amount) < 4.0
    others = np.delete(columns, 3, axis=1).reshape(len(change), -1)
    part, *_ = np.linalg.lstsq(others, change, rcond=None)
    assert np.linalg.norm(change - others @ part) > 0.8 * np.linalg.norm(change)
