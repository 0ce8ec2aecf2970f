"""Free space and docking as studies: what a calibration does, and what hides it."""

import numpy as np
import pytest

from studies import docking, free_space
from studies.arms import KNOWS, MOUNTED, TARED, Arm, simulated
from studies.campaigns import Setting
from studies.control.contact import GearPair
from studies.control.machine import Sensing
from studies.control.runs import Controller
from tdfscal.errors import UsageError
from tdfscal.simulation import SurveyOptions, reference_rig

RIG = reference_rig()
SILENT = Controller(sensing=Sensing(noise=0.0))


@pytest.fixture(scope="module")
def compared() -> tuple[Arm, ...]:
    return simulated(RIG, SurveyOptions(), 3, np.random.default_rng(0), Setting())


def test_arms_differ_in_their_angles_alone(compared: tuple[Arm, ...]) -> None:
    names = [arm.name for arm in compared]
    assert names == [*KNOWS, *(f"{name}, tared" for name in TARED)]
    none = compared[0].assumed
    for arm in compared:
        for part in ("zero", "sensitivity", "mass", "barycentre", "hinge", "gravity"):
            np.testing.assert_array_equal(getattr(arm.assumed, part), getattr(none, part))
        assert arm.tared == arm.name.endswith("tared")
    off = {arm.name: arm.angle_error for arm in compared}
    # Mounted as `simulate` draws it: 20, 20, 50 mrad.
    assert 0.02 < off["none"] < 0.06
    for name, std in MOUNTED.items():
        rms = float(np.sqrt(np.mean(np.square(std))))
        assert 0.5 * rms < off[name] < 1.5 * rms
    assert off["Eq. 24"] > off["tracker"] > off["ML"] > off["true angles"] == 0.0


def test_a_way_beyond_the_travel_is_refused(compared: tuple[Arm, ...]) -> None:
    setup = docking.Setup(RIG, SILENT, GearPair(length=0.9))
    with pytest.raises(UsageError, match="end posture of run 1"):
        docking.simulate(setup, compared, np.random.SeedSequence(0))
    far = free_space.MOVES[:1].copy()
    far[0, 0, 3] = 0.4
    setup_far = free_space.Setup(RIG, SILENT, far)
    with pytest.raises(UsageError, match="initial posture of move 1"):
        free_space.simulate(setup_far, compared, np.random.SeedSequence(0))
