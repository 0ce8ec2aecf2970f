"""One weighing counts once; a load stated otherwise is a campaign's own, a changed one is named."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import pool
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import reference_rig
from tests.comparison.histories import alarms, history

MASS = 9  # place of the mass among the constants: after nine turns, no gains


def weighed(rig: Rig, mass: float) -> Rig:
    return replace(rig, mass=replace(rig.mass, value=np.array(mass)))


def campaigns(months: int, heavier: FloatArray | None = None) -> tuple[Rig, list[Recorded]]:
    """Campaigns of ten postures; from some month on the terminal is so much heavier, kg."""
    rig = reference_rig()
    heavy = np.zeros(months) if heavier is None else heavier
    rng = np.random.default_rng(5)
    found, _ = history(rig, rng, months=months, postures_each=10, heavier=heavy)
    return rig, found


def test_one_weighing_is_one_realisation_in_all_campaigns() -> None:
    rig, found = campaigns(6)
    pooled = pool(found)
    std = np.sqrt(np.diagonal(pooled.posterior(5).covariance))
    assert pooled.common.size == len(std) == 9 + 4 + 9
    alone = pool(found[:2]).posterior(1).covariance[MASS, MASS] ** 0.5
    assert std[MASS] < alone < rig.mass.std
    states = [m.state for m in pooled.members]
    assert len({float(s.mass) for s in states if s is not None}) == 1


def test_a_load_stated_otherwise_is_each_its_own() -> None:
    heavier = np.array([0.0, 0.0, 30.0, 0.0])
    rig, found = campaigns(4, heavier)
    found[2] = replace(found[2], rig=weighed(rig, 530.0))
    pooled = pool(found)
    assert pooled.common.size == 9 + 4 + 9 + 4
    assert pooled.common.terminal == (0, 0, 2, 0)
    masses = [float(m.state.mass) for m in pooled.members if m.state is not None]
    assert masses == pytest.approx([500.0, 500.0, 530.0, 500.0], abs=0.6)
    assert masses[0] == masses[1] == masses[3]
    assert not alarms(pooled)


def test_a_changed_load_is_named() -> None:
    _, found = campaigns(5, np.array([0.0, 0.0, 0.0, 0.0, 4.0]))
    pooled = pool(found)
    assert [(a.kind, a.sensor, a.onset) for a in alarms(pooled)] == [("load", None, 4)]
