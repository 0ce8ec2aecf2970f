"""One weighing counts once; a load stated otherwise is a campaign's own, a changed one is named."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.comparison.compatibility import stated_alike
from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import pool
from tdfscal.estimation.uncertainty import estimate
from tdfscal.model.parameters import nominal
from tdfscal.numerics import so3
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
from tdfscal.selfcal.estimator import fit
from tdfscal.simulation import make_rig, reference_rig
from tests.comparison.histories import alarms, history


def weighed(rig: Rig, mass: float) -> Rig:
    return replace(rig, mass=replace(rig.mass, value=np.array(mass)))


def campaigns(months: int, heavier: FloatArray | None = None) -> tuple[Rig, list[Recorded]]:
    """Campaigns of ten postures; from some month on the terminal is so much heavier, kg."""
    rig = reference_rig()
    heavy = np.zeros(months) if heavier is None else heavier
    rng = np.random.default_rng(5)
    found, _ = history(rig, rng, months=months, postures_each=10, heavier=heavy)
    return rig, found


def test_two_calibrations_move_alike_with_what_both_take_from_one_weighing() -> None:
    """The covariance of their turns is the product of what a heavier terminal does to each."""
    exact = UncertainValue(np.array([0.0, 0.0, 0.25]), np.zeros(3))
    quiet = DeclaredUncertainty(positioner=1e-5, force_noise=0.05)
    rig = replace(make_rig(zero_std=0.5, declared=quiet), barycentre=exact)
    found, _ = history(rig, np.random.default_rng(5), months=2, postures_each=10)
    known, moves = [], []
    for item in found:
        assert item.postures is not None
        both = (rig, weighed(rig, 501.0))
        own, heavier = (fit(each, item.postures, nominal(each)) for each in both)
        back = np.swapaxes(own.state.rotation, 1, 2)
        moves.append(so3.log(heavier.state.rotation @ back).ravel())
        stated = estimate(own)
        linear = (stated.parts.root @ stated.parts.root.T)[:9, :9]
        known.append(stated.calibrated_at(linear))
    expected = rig.mass.std**2 * np.outer(*moves)
    together = stated_alike(*known)
    np.testing.assert_allclose(together, expected, atol=0.02 * np.abs(expected).max())


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
