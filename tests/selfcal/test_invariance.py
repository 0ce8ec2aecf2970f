"""What must not change the answer: order, names, origins, units, and how the BCS is turned."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tdfscal import simulation
from tdfscal.numerics import so3
from tdfscal.records import Dwells, FloatArray, IntArray, Rig, UncertainValue
from tdfscal.selfcal.pipeline import self_calibrate
from tests.selfcal.campaigns import SQUEEZED, distance, fitted

RIG = replace(
    simulation.reference_rig(),
    declared=replace(simulation.reference_rig().declared, force_sensitivity=1e-3, datum=2e-5),
)
BATCH = simulation.simulate_dwells(RIG, SQUEEZED, np.random.default_rng(21), 1)
DWELLS = BATCH.dwells(0)
CLOSE = 1e-9


def angles(rig: Rig, dwells: Dwells) -> FloatArray:
    result = fitted(rig, dwells)
    return so3.to_rpy(result.fit.state.rotation)


REFERENCE = angles(RIG, DWELLS)


def along(dwells: Dwells, index: IntArray | list[int], axis: int) -> Dwells:
    """Dwells with postures (axis 0) or supports (axis 1) in another order."""
    per_support = ("position", "position_cov", "force", "force_cov", "force_min", "force_max")
    names = (*per_support, "count", "effective") + (("start", "end") if axis == 0 else ())
    taken: dict[str, Any] = {n: np.take(getattr(dwells, n), index, axis=axis) for n in names}
    return replace(dwells, **taken)


def test_names_and_order_of_the_supports() -> None:
    order = [2, 0, 1]
    rig = replace(
        RIG,
        supports=("c", "a", "b"),
        hinge=RIG.hinge[order],
        zero=UncertainValue(RIG.zero.value[order], RIG.zero.std[order]),
        nominal_rpy=RIG.nominal_rpy[order],
        rpy_std=RIG.rpy_std[order],
        capacity=RIG.capacity[order],
    )
    dwells = replace(along(DWELLS, order, 1), supports=rig.supports)
    assert np.abs(angles(rig, dwells) - REFERENCE[order]).max() < CLOSE


def test_origin_of_the_lcs() -> None:
    shift = np.array([0.3, -0.7, 1.1])
    rig = replace(
        RIG,
        hinge=RIG.hinge + shift,
        barycentre=UncertainValue(RIG.barycentre.value + shift, RIG.barycentre.std),
    )
    assert np.abs(angles(rig, DWELLS) - REFERENCE).max() < CLOSE


def test_the_bcs_turned_about_gravity() -> None:
    """Positions turn, readings do not: every X_i turns with the BCS."""
    Q = so3.from_rpy(np.array([0.0, 0.0, -2.5]))
    turned = replace(
        DWELLS, position=DWELLS.position @ Q.T, position_cov=Q @ DWELLS.position_cov @ Q.T
    )
    rig = replace(RIG, nominal_rpy=so3.to_rpy(Q @ so3.from_rpy(RIG.nominal_rpy)))
    expected = so3.to_rpy(Q @ so3.from_rpy(REFERENCE))
    assert np.abs(angles(rig, turned) - expected).max() < CLOSE


def test_units_of_force() -> None:
    """All forces, the mass and their uncertainties in units ten times as large."""
    tenth, declared = 0.1, RIG.declared
    rig = replace(
        RIG,
        mass=UncertainValue(tenth * RIG.mass.value, tenth * RIG.mass.std),
        zero=UncertainValue(tenth * RIG.zero.value, tenth * RIG.zero.std),
        declared=replace(declared, force_noise=tenth * declared.force_noise),
    )
    dwells = replace(
        DWELLS,
        force=tenth * DWELLS.force,
        force_cov=tenth**2 * DWELLS.force_cov,
        force_min=tenth * DWELLS.force_min,
        force_max=tenth * DWELLS.force_max,
    )
    assert np.abs(angles(rig, dwells) - REFERENCE).max() < CLOSE


@pytest.mark.parametrize("mounting", [[0, 0, np.pi / 2], [np.pi, 0, 0]])
def test_an_unstated_mounting_is_found(mounting: list[float]) -> None:
    """The second sensor stands a quarter or half turn off, and rig.yaml does not say so."""
    rpy = np.random.default_rng(3).normal(scale=0.02, size=(3, 3))
    rpy[1] += mounting
    options = replace(SQUEEZED, rpy=rpy)
    rig = simulation.reference_rig()
    batch = simulation.simulate_dwells(rig, options, np.random.default_rng(5), 1)
    result = fitted(rig, batch.dwells(0))
    off = so3.log(batch.truth.rotation[0] @ np.swapaxes(result.fit.state.rotation, 1, 2))
    assert np.abs(off).max() < 5 * result.uncertainty.rpy_std.max()
    assert not result.reasons


def test_a_pitch_of_a_right_angle_is_as_good_as_any() -> None:
    """Roll and yaw are one turn there; the gate judges turns about the axes of the BCS."""
    rig, pitch = simulation.reference_rig(), -np.pi / 2
    rig = replace(rig, nominal_rpy=np.array([[0.3, pitch, 0.2], [0, 0, 0], [0.1, pitch, 0]]))
    batch = simulation.simulate_dwells(
        replace(rig, rpy_std=np.full((3, 3), 1e-3)), SQUEEZED, np.random.default_rng(8), 2
    )
    total = 0.0
    for i in range(2):
        result = self_calibrate(rig, batch.dwells(i), rng=np.random.default_rng(0), max_trials=500)
        assert not result.reasons
        total += distance(batch.truth.rotation[i], result)
        assert result.monte_carlo is not None
        # A finite scatter also where the angles themselves run over the whole circle.
        ratio = result.monte_carlo.std / result.uncertainty.rpy_std
        assert np.abs(ratio - 1).max() < 5 / np.sqrt(2 * 500)
    assert stats.chi2.ppf(1e-4, 18) < total < stats.chi2.ppf(1 - 1e-4, 18)
