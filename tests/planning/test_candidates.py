"""Candidates keep every limit, and their forces are those of a terminal at rest."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.commands.plan import travel_limits
from tdfscal.errors import UsageError
from tdfscal.planning.candidates import displacement, draw
from tdfscal.records import DeclaredUncertainty
from tdfscal.simulation import Options, make_rig, reference_rig, simulate_dwells

from .limits import limits

RNG = np.random.default_rng


def test_forces_are_those_of_the_simulated_machine() -> None:
    exact = make_rig(mass_std=0.0, barycentre_std=0.0, zero_std=0.0, declared=DeclaredUncertainty())
    rig = replace(exact, rpy_std=np.zeros((3, 3)))
    stiffness = 2e9  # so stiff that the terminal does not sink
    pool = draw(rig, limits(rig, stiffness=stiffness), 20, RNG(2))
    command = pool.place + pool.squeeze / stiffness
    options = Options(command=command, stiffness=stiffness)
    force = simulate_dwells(rig, options, RNG(3), 1).true_force[0]
    # What the terminal sinks by, 1 µm of 0.6 m, turns no force by more.
    assert np.abs(force - pool.force).max() < 2e-6 * np.abs(force).max()


def test_every_limit_is_kept() -> None:
    rig = make_rig(4, declared=DeclaredUncertainty(positioner=1e-5, force_noise=0.1))
    rig = replace(rig, capacity=np.full((4, 3), [300.0, 300.0, 1800.0]))
    bounds = limits(rig, squeeze=400.0, travel=0.04, force=1500.0, stiffness=2e6)
    pool = draw(rig, bounds, 400, RNG(4))
    assert len(pool) > 200
    margin = 3 * 2e6 * 1e-5
    assert np.linalg.norm(pool.squeeze, axis=2).max() <= 400.0 * (1 + 1e-12)
    assert np.linalg.norm(pool.force, axis=2).max() <= (1500.0 - margin) * (1 + 1e-12)
    assert np.abs(displacement(rig, bounds, pool.rotation)).max() <= 0.04
    assert (np.abs(pool.force) + margin <= 0.9 * rig.capacity[0] * (1 + 1e-12)).all()
    lean = np.arccos(pool.rotation[:, 2, 2])
    assert lean.max() <= bounds.tilt * (1 + 1e-9)
    # The limits are used, not only kept.
    assert np.abs(displacement(rig, bounds, pool.rotation)).max() > 0.0399
    assert (np.abs(pool.force) + margin).max(axis=(0, 1))[0] > 0.9 * 300.0 * 0.99


def test_travel_by_support() -> None:
    rig = reference_rig()
    travel = travel_limits(rig, ["ncp2=0.1,0.2,0.3", 0.05])
    assert travel.tolist() == [[0.05] * 3, [0.1, 0.2, 0.3], [0.05] * 3]
    with pytest.raises(UsageError, match=r"no support 'ncp9'.*ncp1, ncp2, ncp3"):
        travel_limits(rig, "ncp9=0.1")
    with pytest.raises(UsageError, match="2 ranges"):
        travel_limits(rig, "0.1,0.2")
    with pytest.raises(UsageError, match="negative"):
        travel_limits(rig, -0.1)
