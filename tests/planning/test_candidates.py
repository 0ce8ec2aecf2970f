"""Candidates keep every limit; what a posture tells: against random draws and Eq. 9."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.commands.plan import travel_limits
from tdfscal.errors import UsageError
from tdfscal.model.parameters import layout
from tdfscal.model.statics import internal_modes
from tdfscal.numerics import so3
from tdfscal.planning.candidates import displacement, draw, hanging
from tdfscal.planning.predicted_information import Sight, wrench_rows
from tdfscal.records import DeclaredUncertainty, FloatArray, Rig, UncertainValue
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


def test_scatter_is_the_expectation_over_random_internal_forces() -> None:
    rig = make_rig(declared=DeclaredUncertainty(positioner=1e-5, force_noise=0.1))
    bounds = limits(rig, stiffness=2e7)
    sight = Sight.of(rig, 1.0)
    pool = draw(rig, bounds, 1, RNG(0))
    J = sight.rows(pool)
    expected = (np.einsum("kmp,kmq->pq", J, J) + sight.scatter(pool, bounds)[0])[:9, :9]
    arm, _ = hanging(rig, pool.rotation)
    size, draws = bounds.repeatability_force(rig), 4000
    unplanned = size * np.einsum(
        "td,dna->tna", RNG(1).standard_normal((draws, 3)), internal_modes(arm)[0]
    )
    many = replace(pool.take(np.zeros(draws, dtype=np.int64)), squeeze=pool.squeeze[0] + unplanned)
    rows = sight.rows(many)[:, :, :9]
    each = np.swapaxes(rows, 1, 2) @ rows
    error = each.std(axis=0) / np.sqrt(draws)
    # 45 different entries: 4.5 standard errors.
    assert (np.abs(each.mean(axis=0) - expected) < 4.5 * error + 1e-3 * np.abs(expected)).all()


def contact(rig: Rig, R: FloatArray, load: FloatArray, X: FloatArray, z: FloatArray) -> FloatArray:
    """Eq. 9 at rest, corrected: contact wrench in the LCS about its origin."""
    F = np.einsum("nab,nb->na", X, load - z) @ R
    G = R.T @ np.array([0.0, 0.0, -rig.mass.value * rig.gravity])
    moment = np.cross(rig.hinge, F).sum(axis=0) + np.cross(rig.barycentre.value, G)
    return -np.concatenate([F.sum(axis=0) + G, moment])


def test_wrench_rows_are_the_derivative_of_the_contact_wrench() -> None:
    rig = replace(reference_rig(), nominal_rpy=np.array([[0, 0, 1.57], [0.1, 0, -2], [0, 0.2, 0]]))
    rpy = (0.08, -0.05, 0.3)
    sight = Sight.of(rig, 1.0)
    W, place = wrench_rows(sight, rpy), layout(3)
    R, X = so3.from_rpy(np.array(rpy)), so3.from_rpy(rig.nominal_rpy)
    load = np.einsum("nba,nb->na", X, hanging(rig, R[None])[1][0])
    z = np.zeros((3, 3))
    base = contact(rig, R, load, X, z)
    assert np.abs(base).max() < 1e-9  # at rest, without contact
    step = 1e-6
    column = {group: int(np.sum(sight.active[: at.start])) for group, at in place.items()}
    for i in range(3):
        for j in range(3):
            turned = X.copy()
            turned[i] = so3.exp(step * np.eye(3)[j]) @ X[i]
            slope = (contact(rig, R, load, turned, z) - base) / step
            assert np.allclose(-W[:, 3 * i + j], slope, atol=2e-3)  # of 1600 N, step² left out
            off = z.copy()
            off[i, j] = step
            slope = (contact(rig, R, load, X, off) - base) / step
            assert np.allclose(-W[:, column["zero"] + 3 * i + j], slope, atol=1e-6)
    heavier = replace(rig, mass=UncertainValue(rig.mass.value + step, rig.mass.std))
    slope = (contact(heavier, R, load, X, z) - base) / step
    assert np.allclose(-W[:, column["mass"]], slope, atol=1e-5)
