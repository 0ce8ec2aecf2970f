"""Free space and docking as studies: what a calibration does, and what hides it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from studies.control.contact import GearPair
from studies.control.runs import Controller
from studies.control.sensors import Sensing
from studies.runs import docking, free_space, lanes
from studies.runs.compared_calibrations import KNOWS, Arms, given, simulated
from studies.runs.ratios import ratio, share
from tdfscal.errors import UsageError
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.numerics import so3
from tdfscal.records import FloatArray
from tdfscal.simulation import make_rig, reference_rig

RIG = reference_rig()
SILENT = Controller(sensing=Sensing(noise=0.0))


@pytest.fixture(scope="module")
def arms() -> Arms:
    return simulated(RIG, 3, np.random.default_rng(0))


def at(study: docking.DockingStudy | free_space.FreeSpaceStudy, name: str) -> int:
    return study.names.index(name)


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


def test_arms_differ_in_their_angles_alone(arms: Arms) -> None:
    assert arms.names == tuple(KNOWS)
    known = {arm.name: arm.assumed for arm in arms.arms}
    for name in ("tracker", "linear", "self", "tracker-tared", "perfect-angles"):
        for part in ("zero", "sensitivity", "mass", "barycentre", "hinge", "gravity"):
            np.testing.assert_array_equal(getattr(known[name], part), getattr(known["none"], part))
    np.testing.assert_array_equal(known["self"].rotation, known["self-all"].rotation)
    np.testing.assert_array_equal(known["perfect-angles"].rotation, arms.truth.rotation)
    errors = {arm.name: arm.angle_error for arm in arms.arms}
    # Mounted as `simulate` draws it: 20, 20, 50 mrad.
    assert 0.02 < errors["none"] < 0.06
    assert errors["linear"] > errors["tracker"] > errors["self"] > errors["perfect"] == 0.0
    assert [arm.tared for arm in arms.arms].count(True) == 1


@pytest.mark.slow
def test_free_space_ranks_the_calibrations(arms: Arms) -> None:
    setup = free_space.Setup(
        RIG, controller=SILENT, moves=free_space.MOVES[[0, 3]], duration=2.0, rest=25.0
    )
    study = free_space.free_space(setup, arms, np.random.SeedSequence(1), 1)
    means = dict(zip(study.names, study.length.mean(axis=(1, 2)), strict=True))
    assert np.all(means["none"] > means["tracker"])
    assert np.all(means["linear"] > means["tracker"])
    # With angles alone, zeros, mass and barycentre decide; with all of them nothing is left.
    assert np.all(means["self"] > 0.5 * means["perfect-angles"])
    assert np.all(means["self-all"] < 0.2 * means["self"])
    # What is left without noise: NCPs 10 µm off tilt the terminal by 17 µrad, and the weight's
    # compensation by 0.1 N.
    assert means["perfect"][0] < 2e-5


def test_taring_hides_what_a_calibration_would_take_away(arms: Arms) -> None:
    """Along a straight line nothing but internal forces changes after the tare."""
    setup = free_space.Setup(
        RIG, controller=SILENT, moves=free_space.MOVES[:1], duration=2.0, rest=20.0
    )
    study = free_space.free_space(setup, arms, np.random.SeedSequence(1), 1)
    tracker, tared = (
        study.length[at(study, name), ..., 0].mean() for name in ("tracker", "tracker-tared")
    )
    assert tared < 0.2 * tracker


@pytest.mark.slow
def test_docking_maxima_fall_with_what_is_known(arms: Arms) -> None:
    """Without noise: who knows the truth docks gears that fit without force."""
    exact = replace(RIG, declared=replace(RIG.declared, positioner=0.0))
    setup = docking.Setup(
        exact, controller=SILENT, gears=GearPair(length=0.008), gap=0.02, ramp=0.5
    )
    study = docking.docking(setup, arms, np.random.SeedSequence(1), 1)
    assert study.seated[at(study, "perfect")].all()
    force = study.sample(0)
    tracker = force[at(study, "tracker")].mean()
    assert tracker > 2.0
    assert np.all(force[at(study, "self-all")] < 0.1 * tracker)
    # The survey of the outer gear, 15 µm and 0.2 mrad, may use its play up.
    assert np.all(force[at(study, "perfect")] < 0.02 * tracker)
    found = study.ratio(0, "self-all", "tracker")
    assert found.value == pytest.approx(force[at(study, "self-all")].mean() / tracker)
    # Success: seated, and no true force beyond its limit.
    best = study.success(at(study, "perfect"))
    assert (best.count, best.runs, best.high) == (3, 3, 1.0)
    limits = np.array(SILENT.thresholds)
    beyond = np.any(study.peak[..., :3] > limits, axis=-1)
    np.testing.assert_array_equal(study.succeeded, study.seated & ~beyond)


def test_lanes_on_several_cores_are_the_same(arms: Arms, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes, "_WORTH", 1)
    setup = free_space.Setup(RIG, moves=free_space.MOVES[:1], duration=0.2, rest=0.1)
    one, two = (
        free_space.free_space(setup, arms, np.random.SeedSequence(1), 1, workers=workers)
        for workers in (1, 2)
    )
    np.testing.assert_array_equal(one.deviation, two.deviation)
    np.testing.assert_array_equal(one.result.traces.measured, two.result.traces.measured)


def test_interval_of_a_share() -> None:
    """Clopper and Pearson: at its ends a result as extreme has half of 5 %."""
    found = share(np.arange(40) < 31)
    k = np.arange(41)
    choose = np.array([math.comb(40, int(i)) for i in k], dtype=float)
    for p, tail in ((found.low, k >= 31), (found.high, k <= 31)):
        chance = (choose * p**k * (1 - p) ** (40 - k))[tail].sum()
        assert chance == pytest.approx(0.025, rel=1e-6)
    assert share(np.zeros(10, dtype=np.bool_)).high == pytest.approx(1 - 0.025**0.1)


def angles(std: FloatArray, shift: float = 0.0) -> Calibrated:
    X = so3.from_rpy(np.array([[0.01, 0.02, 0.3], [0.0, 0.0, 0.1], [-0.02, 0.01, 0.0]]))
    return independent(RIG, so3.exp(np.full((3, 3), shift)) @ X, np.diag(std**2))


def test_truth_is_drawn_from_the_combination_and_no_file_judges_itself() -> None:
    """Weighted by information: (2σ)⁻² and σ⁻² give 1/5 and 4/5, and σ √(4/5)."""
    std = np.linspace(1e-3, 2e-3, 9)
    one, other = angles(std), angles(2.0 * std, 5e-4)
    arms = given(RIG, [("one", one), ("other", other)], 4000, np.random.default_rng(0))
    d = so3.log(arms.truth.rotation @ np.swapaxes(one.state.rotation, -1, -2)).reshape(-1, 9)
    np.testing.assert_allclose(d.std(axis=0), std * np.sqrt(0.8), rtol=0.05)
    np.testing.assert_allclose(d.mean(axis=0), 1e-4, atol=4 * 2e-3 / np.sqrt(4000))
    assert arms.names == ("none", "one", "other", "perfect-angles", "perfect")
    # The order of the files does not matter, nor does one that claims too much win.
    bold = angles(0.01 * std, 1e-2)
    for pair in ([("a", one), ("b", bold)], [("b", bold), ("a", one)]):
        drawn = given(RIG, pair, 4000, np.random.default_rng(0)).truth.rotation
        d = so3.log(drawn @ np.swapaxes(bold.state.rotation, -1, -2))
        assert d.std() > 3 * 0.01 * std.mean()
    by_file = given(RIG, [("one", one)], 10, np.random.default_rng(0), truth=("other", other))
    assert "truth drawn from other" in by_file.origin
    with pytest.raises(UsageError, match="cannot be its own judge"):
        given(RIG, [("one", one)], 10, np.random.default_rng(0), truth=("copy", one))
    alone = given(RIG, [("one", one)], 10, np.random.default_rng(0))
    assert "does not judge it" in alone.origin


def test_what_the_given_calibrations_know_exactly_stays_so() -> None:
    """Correlated zeros, mass and angles of two files; sensitivities are exact in both."""
    rng, uncertain = np.random.default_rng(0), np.r_[0:18, 36:45]
    files = []
    for name in ("one", "other"):
        given_angles = angles(np.full(9, 1e-3))
        covariance = np.zeros_like(given_angles.covariance)
        half = 1e-3 * rng.normal(size=(uncertain.size, uncertain.size))
        covariance[np.ix_(uncertain, uncertain)] = half @ half.T
        files.append((name, replace(given_angles, covariance=covariance)))
    truth = given(RIG, files, 20, rng).truth
    assert not truth.sensitivity.any()
    assert np.abs(truth.zero).max() < 0.1


def test_calibrations_of_another_rig_and_travels_are_refused() -> None:
    other = make_rig(mass=400.0)
    calibration = independent(other, so3.from_rpy(other.nominal_rpy), 1e-6 * np.eye(9))
    with pytest.raises(UsageError, match="of another rig: the mass is 500 kg"):
        given(RIG, [("c.yaml", calibration)], 2, np.random.default_rng(0))
    own = independent(RIG, so3.from_rpy(RIG.nominal_rpy), 1e-6 * np.eye(9))
    arms = given(RIG, [("c", own)], 1, np.random.default_rng(0), best=False)
    assert arms.names == ("none", "c")
    setup = replace(docking.Setup(RIG), travel=(0.25, 0.25, 0.3))
    with pytest.raises(UsageError, match="end posture of run 1"):
        docking.docking(setup, arms, np.random.SeedSequence(0), 0)
