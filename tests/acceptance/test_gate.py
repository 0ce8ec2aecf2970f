"""Which results the gate accepts, at its limits and on either side of them."""

from dataclasses import replace

import numpy as np
import pytest

from tdfscal import simulation
from tdfscal.acceptance import judge
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rotations

RIG = replace(
    simulation.make_rig(),
    acceptance=replace(simulation.make_rig().acceptance, angle_std=2e-3, birge_max=1.5),
)
LEVEL = np.tile(np.eye(3), (3, 1, 1))


def rotations(std: FloatArray) -> Rotations:
    return Rotations(RIG.supports, LEVEL, np.diag(std.ravel() ** 2))


FINE = rotations(np.full((3, 3), 1e-3))


def test_a_result_at_its_limits_is_accepted() -> None:
    at_limit = rotations(np.full((3, 3), 2e-3 * (1 - 1e-15)))
    assert judge(RIG, at_limit, 1.5, used=9, rejected=1) == ()


def test_each_turn_above_its_limit_is_a_reason_with_its_support() -> None:
    std = np.full((3, 3), 1e-3)
    std[0, 2] = std[2, 1] = 2.1e-3
    first, second = judge(RIG, rotations(std), 1.0)
    assert (first.values["angle"], first.subject) == ("yaw", RIG.supports[:1])
    assert first.size == pytest.approx(2.1e-3)
    assert (second.values["angle"], second.subject) == ("pitch", RIG.supports[2:])


def test_an_unknown_uncertainty_is_above_every_limit() -> None:
    std = np.full((3, 3), 1e-3)
    std[1, 0] = np.inf
    with np.errstate(invalid="ignore"):
        assert len(judge(RIG, rotations(std), 1.0)) == 1
    std[1, 0] = np.nan
    assert len(judge(RIG, rotations(std), 1.0)) == 1


def test_sensors_that_are_not_determined_are_not_judged() -> None:
    std = np.full((3, 3), 1e-3)
    std[1] = 1.0
    determined = np.array([True, False, True])
    assert judge(RIG, rotations(std), 1.0, determined=determined) == ()
    assert len(judge(RIG, rotations(std), 1.0, determined=~determined)) == 3


@pytest.mark.parametrize(
    ("birge", "used", "rejected", "reasons"),
    [(1.51, 10, 0, 1), (0.3, 8, 1, 1), (1.0, 18, 2, 0), (1.6, 10, 5, 2), (1.0, 0, 0, 0)],
)
def test_residuals_and_postures(birge: float, used: int, rejected: int, reasons: int) -> None:
    assert len(judge(RIG, FINE, birge, used=used, rejected=rejected)) == reasons


def test_turned_sensors_are_judged_about_the_axes_of_the_base() -> None:
    """A yaw of 90° swaps what roll and pitch turn about; the covariance stands in the base."""
    std = np.full((3, 3), 1e-3)
    std[0, 0] = 3e-3
    turned = replace(rotations(std), rotation=so3.from_rpy(np.diag([0, 0, np.pi / 2])[::-1]))
    (reason,) = judge(RIG, turned, 1.0)
    assert (reason.values["angle"], reason.subject) == ("turn about X", RIG.supports[:1])
