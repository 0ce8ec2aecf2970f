"""The contact wrench and its uncertainty where both can be written out; poses, streams, filters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_coeffs

from tdfscal import simulation
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.model.samples_in_motion import Tally, aligned, derivative_kernels
from tdfscal.records import DeclaredUncertainty, FloatArray, Log, Rig, Series, UncertainValue
from tdfscal.wrench.contact_wrench import wrenches

LEVEL = np.tile(np.eye(3), (3, 1, 1))
STD = 1e-3


def exact(declared: DeclaredUncertainty | None = None) -> Rig:
    """Only the angles, and what is declared per posture, are uncertain."""
    rig = simulation.make_rig()
    return replace(
        rig,
        declared=declared or DeclaredUncertainty(),
        zero=UncertainValue.exact(np.zeros((3, 3))),
        mass=UncertainValue.exact(rig.mass.value),
        barycentre=UncertainValue.exact(rig.barycentre.value),
        gravity_tilt_std=0.0,
    )


def given(declared: DeclaredUncertainty | None = None, std: float = STD) -> Calibrated:
    return independent(exact(declared), LEVEL, std**2 * np.eye(9))


def standing(count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, positions and readings of a level terminal whose weight its sensors share."""
    rig = exact()
    share = float(rig.mass.value) * rig.gravity / 3
    force = np.tile([0.0, 0.0, share], (count, 3, 1))
    return 0.01 * np.arange(float(count)), np.tile(rig.hinge, (count, 1, 1)), force


def test_what_is_declared_per_posture_adds_to_a_samples_uncertainty() -> None:
    rig = exact()
    noise = wrenches(given(DeclaredUncertainty(force_noise=0.7), 0.0), *standing(3))
    moment = np.zeros(6)
    for hinge in rig.hinge:
        for f in 0.7 * np.eye(3):
            moment += np.concatenate([f, np.cross(hinge, f)]) ** 2
    assert np.allclose(noise.std, np.sqrt(moment), rtol=1e-9, atol=0)
    assert not noise.calibration_std.any()
    friction = wrenches(given(DeclaredUncertainty(hinge_moment=0.2), 0.0), *standing(3))
    # As declared per axis, and as friction whose direction is any: n τ / √3 = 0.2 once more.
    expected = [0, 0, 0, *[np.hypot(0.2, 0.2)] * 3]
    assert np.allclose(friction.std, expected, rtol=1e-9, atol=0)
    twice = wrenches(given(DeclaredUncertainty(positioner=2e-5), 0.0), *standing(3)).std
    once = wrenches(given(DeclaredUncertainty(positioner=1e-5), 0.0), *standing(3)).std
    assert np.allclose(twice, 2 * once, rtol=1e-9, atol=0)
    assert (once[:, 3:5] > 0).all()


def test_an_unmeasured_axis_leaves_open_what_it_reaches() -> None:
    """A vertical component at (x, y): fz, and moments about x and y where its arm is not 0."""
    axes = np.ones((3, 3), dtype=np.bool_)
    axes[0, 2] = False
    calibrated = replace(given(), rig=replace(exact(), axes=axes))
    time, position, force = standing(2)
    force[:, 0, 2] = 1e5  # whatever stands there
    found = wrenches(calibrated, time, position, force)
    hinge = exact().hinge[0]
    reach = np.concatenate([[0, 0, 1], np.cross(hinge, [0, 0, 1])])
    assert np.array_equal(np.isinf(found.std[0]), np.abs(reach) > 1e-6)
    weight = float(exact().mass.value) * exact().gravity
    assert found.value[0, 2] == pytest.approx(weight / 3, rel=1e-12)


@pytest.mark.parametrize("half", [2, 5, 40])
def test_kernels_are_savitzky_and_golays(half: int) -> None:
    found = derivative_kernels(half)
    for order in range(3):
        oracle = savgol_coeffs(2 * half + 1, 3, deriv=order, use="dot")
        assert np.allclose(found[order], oracle, rtol=1e-8, atol=1e-12)


# Streams.


def streams(position: FloatArray, force: FloatArray) -> Log:
    """Straight lines in time, one support of three with its own clock of positions."""
    lines = [Series(t, np.outer(t, [1.0, 2.0, 3.0]) + k) for k, t in enumerate([position] * 3)]
    loads = [Series(force, np.outer(force, [-1.0, 4.0, 2.0]) + 10 * k) for k in range(3)]
    return Log(("a", "b", "c"), tuple(lines), tuple(loads))


def test_gaps_of_another_stream_are_left_out_and_counted() -> None:
    """20 intervals or a tenth of a second may be bridged; a longer gap may not."""
    base = np.arange(0.0, 4.0, 0.01)
    position = np.arange(0.0, 4.0, 0.02)
    short = position[(position < 1.0) | (position > 1.35)]
    tally = Tally()
    out = list(aligned([streams(short, base)], tally))
    assert tally.used == sum(s.time.size for s in out)
    assert tally.uncovered == int((base > position[-1] + 1e-9).sum())
    long = position[(position < 1.0) | (position > 1.5)]
    tally = Tally()
    out = list(aligned([streams(long, base)], tally))
    time = np.concatenate([s.time for s in out])
    inside = (base > long[long < 1.0][-1] + 1e-9) & (base < long[long > 1.0][0] - 1e-9)
    late = base > position[-1] + 1e-9
    assert np.allclose(time, base[~inside & ~late], rtol=0, atol=1e-12)
    assert tally.uncovered == int((inside | late).sum())
    for s in out:
        assert np.allclose(s.position[:, 1], np.outer(s.time, [1.0, 2.0, 3.0]) + 1, atol=1e-9)
        assert np.allclose(s.force[:, 2], np.outer(s.time, [-1.0, 4.0, 2.0]) + 20, atol=1e-9)


@pytest.mark.parametrize("together", [True, False])
def test_readings_that_are_no_numbers_are_left_out_and_counted(together: bool) -> None:
    base = np.arange(0.0, 1.0, 0.01)
    log = streams(base if together else np.arange(0.0, 1.01, 0.05), base)
    log.force[1].value[7, 2] = np.nan
    log.force[2].value[50] = np.inf
    tally = Tally()
    time = np.concatenate([s.time for s in aligned([log, streams(base[:0], base[:0])], tally)])
    assert 7 not in np.round(100 * time).astype(int)
    assert 50 not in np.round(100 * time).astype(int)
    assert tally.unreadable == 2
    assert tally.used == len(time) == 98
