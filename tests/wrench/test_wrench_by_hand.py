"""The contact wrench and its uncertainty where both can be written out; poses, streams, filters."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_coeffs

from tdfscal import simulation
from tdfscal.model.calibrated import Calibrated, independent
from tdfscal.model.parameters import gravity
from tdfscal.model.postures import register
from tdfscal.model.samples_in_motion import Tally, aligned, derivative_kernels
from tdfscal.records import DeclaredUncertainty, FloatArray, Log, Rig, Series, UncertainValue
from tdfscal.wrench.contact_wrench import at_rest, covariance, in_motion, wrenches
from tests.motioncal.campaigns import perfect_rig, played, quiet, true_state

from .held_out import HELD, RIG, world

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


def test_wrench_is_newtons_law_written_out() -> None:
    """Readings by which a gain and crosstalk went, too, which are undone before the rotation."""
    given, dwells = world(1).given[0], world(1).held(0)
    voigt = np.array([[0.01, -0.02, 0.015, 0.003, -0.004, 0.005]] * 3)
    given = replace(given, state=replace(given.state, sensitivity=voigt))
    xx, yy, zz, yz, xz, xy = voigt[0]
    gain = np.eye(3) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    s = given.state
    found = wrenches(given, dwells.start, dwells.position, dwells.force).value
    R, _ = register(s.hinge, dwells.position - s.datum)
    G = float(s.mass) * gravity(s, RIG.gravity)
    for k in range(HELD):
        load = np.linalg.solve(gain, (dwells.force[k] - s.zero).T).T
        L = [R[k].T @ s.rotation[i] @ load[i] for i in range(3)]
        weight = R[k].T @ G
        force = -np.sum(L, axis=0) - weight
        moment = -sum(np.cross(s.hinge[i], L[i]) for i in range(3)) - np.cross(s.barycentre, weight)
        # Poses are good to 1e-10 rad, and 5 kN turn with them.
        assert np.abs(found[k] - [*force, *moment]).max() < 5e-7


def test_open_zeros_leave_the_uncertainty_open() -> None:
    given, dwells = world(100).given[0], world(100).held(0)
    unknown = np.zeros_like(given.open)
    unknown[9:12] = True
    cov = covariance(replace(given, open=unknown), dwells.position, dwells.force)
    assert np.all(np.isinf(np.diagonal(cov, axis1=1, axis2=2)[:, :3]))


def test_in_motion_no_contact_is_left_of_what_the_mass_needs() -> None:
    """A terminal that swings, all of it known: taken as at rest it is touched by newtons."""
    options = quiet(duration=20.0, frequency=0.25, friction=0.0, delay=0.0)
    campaign, *_ = played(options, rig=perfect_rig())
    rig = replace(campaign.rig, inertia=UncertainValue.exact(campaign.inertia))
    given = replace(
        independent(rig, campaign.truth.rotation, 1e-12 * np.eye(9)),
        state=true_state(campaign).still,
    )
    rms = []
    for stage in (at_rest, in_motion):
        pieces = list(stage(given, aligned([campaign.log], Tally())))
        value = np.concatenate([piece.value for piece in pieces])
        rms.append(np.sqrt(np.mean(value[200:-200] ** 2, axis=0)))
    assert (rms[0] > [20.0, 20.0, 20.0, 5.0, 5.0, 5.0]).all()
    assert (rms[1] < 0.01 * rms[0]).all()
