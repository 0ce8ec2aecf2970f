"""Sensors tared between a calibration and its validation: zeros are no change of the rig."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tdfscal.records import Dwells, FloatArray
from tdfscal.simulation import make_rig
from tdfscal.validation.residual_wrench import Validation, validate

from .held_out import RIG, simulated, turned, world

TRIALS, RUNS = 100, 5


def tared(dwells: Dwells, trial: int) -> tuple[Dwells, FloatArray]:
    """Dwells with zeros drawn anew from what the rig file states, and by how much they moved."""
    new = np.random.default_rng(100 + trial).normal(RIG.zero.value, RIG.zero.std)
    shift = new - world(TRIALS).batch.truth.zero[trial]
    return replace(dwells, force=dwells.force + shift), shift


def verdict(trial: int, dwells: Dwells) -> Validation:
    return validate(world(TRIALS).given[trial], dwells)


@pytest.mark.parametrize("turn", [0.0, 8e-3])
def test_a_tare_is_told_with_its_size(turn: float) -> None:
    """A turn of 8 mrad moves readings by newtons, as zeros would: it is no part of theirs."""
    squares, moved = [], 0
    for t in range(RUNS):
        still = turned(world(TRIALS), t, 1, np.array([0.0, turn, 0.0])) if turn else None
        dwells, shift = tared(still or world(TRIALS).held(t), t)
        v = verdict(t, dwells)
        assert v.holds is not bool(turn)
        moved += v.zeros.moved
        squares.append(((v.zeros.change - shift) / v.zeros.change_std) ** 2)
    assert moved >= RUNS - (not turn)
    total = np.sum(squares, axis=0)
    assert np.all(stats.chi2.cdf(total, RUNS) < 1 - 1e-4)
    assert np.all(stats.chi2.cdf(total, RUNS) > 1e-4)


def test_a_zero_that_moved_is_told_as_it_moved_and_as_surely_as_said() -> None:
    """By what the log shows alone: what is stated, half a newton, draws nothing towards none."""
    seen = 0
    for t in range(RUNS):
        held = world(TRIALS).held(t)
        before = verdict(t, held).zeros
        for size in (2.0, before.detectable[0, 0]):
            shift = np.zeros((3, 3))
            shift[0, 0] = size
            v = verdict(t, replace(held, force=held.force + shift))
            assert v.zeros.change - before.change == pytest.approx(shift, abs=1e-2 * size)
            seen += v.zeros.moved or not v.holds
    assert seen >= 2 * RUNS - 2


def test_another_weighing_is_of_this_log_alone() -> None:
    """A load that the log's rig file states anew is no change where that is true of it."""
    held, given = world(TRIALS).held(0), world(TRIALS).given[0]
    loaded = make_rig(mass=504.0)
    heavier = replace(world(TRIALS), batch=simulated(TRIALS, None, 504.0)).held(0)
    assert validate(given, held).holds
    assert not validate(given, heavier).holds
    assert validate(given, heavier, rig=loaded).holds
