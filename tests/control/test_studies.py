"""Free space and docking as studies: what a calibration does, and what hides it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.errors import UsageError
from tdfscal.model.calibrated import independent
from tdfscal.numerics import so3
from tdfscal.simulation import make_rig, reference_rig
from tdfscal.simulation.control.contact import GearPair
from tdfscal.simulation.control.runs import Controller
from tdfscal.simulation.control.sensors import Sensing
from tdfscal.studies import docking, free_space
from tdfscal.studies.compared_calibrations import Arms, given, simulated
from tdfscal.studies.ratios import ratio

RIG = reference_rig()
SILENT = Controller(sensing=Sensing(noise=0.0))


@pytest.fixture(scope="module")
def arms() -> Arms:
    return simulated(RIG, 3, np.random.default_rng(0), best=True)


def test_ratio_and_its_standard_error() -> None:
    """Against the scatter of many repetitions."""
    rng = np.random.default_rng(0)
    common = rng.normal(10.0, 2.0, (4000, 12))
    a, b = 0.5 * common + rng.normal(0, 0.5, common.shape), common
    found = [ratio(x, y) for x, y in zip(a, b, strict=True)]
    values = np.array([r.value for r in found])
    assert values.mean() == pytest.approx(0.5, abs=0.001)
    assert np.sqrt(np.mean([r.std**2 for r in found])) == pytest.approx(values.std(), rel=0.05)
    assert np.isnan(ratio(np.array([]), np.array([])).value)


def test_free_space_ranks_the_calibrations(arms: Arms) -> None:
    assert [arm.name for arm in arms.arms] == ["none", "tracker", "self", "perfect"]
    setup = free_space.Setup(
        RIG, controller=SILENT, moves=free_space.MOVES[[0, 3]], duration=2.0, rest=8.0
    )
    study = free_space.free_space(setup, arms, np.random.SeedSequence(1), 1)
    none, tracker, own, perfect = study.length.mean(axis=(1, 2))
    assert np.all(none > tracker)
    assert np.all(tracker > own)
    assert np.all(own > 1.5 * perfect)
    # What is left without noise: NCPs 10 µm off tilt the terminal by 17 µrad, and the weight's
    # compensation by 0.1 N.
    assert perfect[0] < 2e-5


def test_taring_hides_what_a_calibration_would_take_away(arms: Arms) -> None:
    """Along a straight line nothing but internal forces changes after the tare."""
    tracker = []
    for tare in (0.0, 0.5):
        setup = free_space.Setup(
            RIG,
            controller=replace(SILENT, tare=tare),
            moves=free_space.MOVES[:1],
            duration=2.0,
            rest=4.0,
        )
        study = free_space.free_space(setup, arms, np.random.SeedSequence(1), 1)
        tracker.append(study.length[1, ..., 0].mean())
    assert tracker[1] < 0.2 * tracker[0]


def test_docking_maxima_fall_with_the_calibration(arms: Arms) -> None:
    """Untared and without noise: a perfect calibration docks gears that fit without force."""
    setup = docking.Setup(
        replace(RIG, declared=replace(RIG.declared, positioner=0.0)),
        controller=SILENT,
        gears=GearPair(length=0.008),
        gap=5e-4,
        ramp=0.5,
    )
    study = docking.docking(setup, arms, np.random.SeedSequence(1), 1)
    assert study.seated[1:].all()
    _, tracker, own, perfect = study.average[..., 0]
    assert tracker.mean() > 2.0
    assert np.all(own < 0.1 * tracker.mean())
    assert np.all(perfect < 1e-3)
    found = study.ratio(0, "self", "tracker")
    assert found.value == pytest.approx(own.mean() / tracker.mean())
    # The controller sees its false force from the start, the gears only on contact.
    assert np.all(study.average_seen[1] > 0.5)
    assert study.ratio(0, "self", "tracker", seen=True).value < 0.5


def test_truth_of_given_calibrations_is_drawn_from_their_uncertainty() -> None:
    rig = reference_rig()
    X = so3.from_rpy(np.array([[0.01, 0.02, 0.3], [0.0, 0.0, 0.1], [-0.02, 0.01, 0.0]]))
    std = np.linspace(1e-3, 2e-3, 9)
    arms = given(
        rig,
        [("vague", independent(rig, X, np.eye(9))), ("good", independent(rig, X, np.diag(std**2)))],
        4000,
        np.random.default_rng(0),
    )
    d = so3.log(arms.truth.rotation @ np.swapaxes(X, -1, -2)).reshape(-1, 9)
    np.testing.assert_allclose(d.std(axis=0), std, rtol=0.05)
    assert [arm.name for arm in arms.arms] == ["none", "vague", "good"]


def test_calibrations_of_another_rig_and_travels_are_refused() -> None:
    other = make_rig(mass=400.0)
    calibration = independent(other, so3.from_rpy(other.nominal_rpy), 1e-6 * np.eye(9))
    with pytest.raises(UsageError, match="of another rig: the mass is 500 kg"):
        given(RIG, [("c.yaml", calibration)], 2, np.random.default_rng(0))
    own = independent(RIG, so3.from_rpy(RIG.nominal_rpy), 1e-6 * np.eye(9))
    arms = given(RIG, [("c", own)], 1, np.random.default_rng(0), best=True)
    assert [arm.name for arm in arms.arms] == ["none", "c", "perfect"]
    setup = replace(docking.Setup(RIG), travel=(0.25, 0.25, 0.3))
    with pytest.raises(UsageError, match="end posture of run 1"):
        docking.docking(setup, arms, np.random.SeedSequence(0), 0)
