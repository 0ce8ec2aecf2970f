"""The closed loop against closed forms and the static simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdfscal.errors import UsageError
from tdfscal.simulation import Load, Pose, rotations, settle
from tdfscal.simulation.control.contact import Bore, GearPair
from tdfscal.simulation.control.impedance import (
    Impedance,
    contact_radius,
    require_stable,
    transition,
)
from tdfscal.simulation.control.loop import simulate
from tdfscal.simulation.control.reference import Reference, require_within
from tdfscal.simulation.control.runs import Controller, Docking, Machines
from tdfscal.simulation.control.sensors import Sensing, WrenchObserver, perfect, uncalibrated
from tdfscal.simulation.control.servo import Servo, draw_errors
from tdfscal.simulation.control.terminal import Terminal
from tdfscal.wrench.filtering import Causal, Walk
from tests.control.benches import HOME, IDEAL, SHORT, dock, poses, truths
from tests.simulation.rigs import exact_rig, loose_rig


def still(seconds: float, lanes: int, step: float) -> Reference:
    zero = np.zeros(round(seconds / step))
    return Reference(poses(lanes), poses(lanes), zero, zero, zero)


def test_transition_is_exact() -> None:
    """Against the oscillator's closed form, over- and underdamped."""
    impedance = Impedance(damping=(8e3, 100.0, 2 * np.sqrt(80 * 1e4), 2400.0, 2400.0, 2400.0))
    t = 0.03
    found = transition(impedance, t)
    M, B, K = (np.array(v)[:2] for v in (impedance.mass, impedance.damping, impedance.stiffness))
    root = np.sqrt(((B / M) ** 2 - 4 * K / M).astype(complex))
    a, b = (-B / M + root) / 2, (-B / M - root) / 2
    to_rest = (a * np.exp(b * t) - b * np.exp(a * t)) / (a - b)
    np.testing.assert_allclose(found.state[:2, 0, 0], to_rest.real, rtol=1e-12)
    np.testing.assert_allclose(found.drive[:2, 0], ((1 - to_rest) / K).real, rtol=1e-9)
    # The same from many small steps, also at critical damping.
    fine = transition(impedance, t / 64)
    d = np.tile([[1.0, 0.2]], (1, 6, 1))
    g = np.ones((1, 6))
    whole = found.step(d, g)
    for _ in range(64):
        d = fine.step(d, g)
    np.testing.assert_allclose(d, whole, rtol=1e-10)


def test_rest_is_the_static_simulators() -> None:
    """Carriages wander and a contact pushes: the terminal ends where `settle` puts it."""
    lanes, rng = 4, np.random.default_rng(1)
    truth = truths(lanes)
    start = poses(lanes)
    stand = start.place(truth.hinge)
    terminal = Terminal(truth, stand, start)
    goal = Pose(
        rotations.exp(rng.normal(0, 0.02, (lanes, 3))), HOME + rng.normal(0, 0.01, (lanes, 3))
    ).place(truth.hinge) + rng.normal(0, 1e-5, stand.shape)
    wrench = np.concatenate([rng.normal(0, 20, (lanes, 3)), rng.normal(0, 5, (lanes, 3))], axis=1)
    for share in np.linspace(0.0, 1.0, 400):
        terminal.move(stand + share * (goal - stand), share * wrench)
    for _ in range(30):
        terminal.move(goal, wrench)
    R = terminal.rotation
    lcs = (wrench.reshape(lanes, 2, 3) @ R)[:, None]
    rest = settle(
        truth,
        goal[:, None],
        Load(lcs, np.zeros((lanes, 1, 3))),
        Pose(start.rotation[:, None], start.translation[:, None]),
    )
    np.testing.assert_allclose(terminal.force, rest.force[:, 0], atol=1e-4)
    np.testing.assert_allclose(terminal.translation, rest.pose.translation[:, 0], atol=1e-11)
    np.testing.assert_allclose(R, rest.pose.rotation[:, 0], atol=1e-11)


def test_forces_balance_in_motion() -> None:
    """At every step of a docking the wrench of a controller that knows the truth is the contact."""
    result = dock(truths(2), IDEAL, shift=(2e-4, -1e-4))
    traces = result.traces
    lag = np.abs(traces.measured - traces.contact)[-1].max(axis=-1)
    assert np.abs(traces.contact).max() > 10.0
    assert np.all(result.seated)
    # Smoothing over 0.1 s delays a force that rises by K v = 15 N/s by 1.5 N.
    assert lag.max() < 1.05 * (15.0 * (0.1 + 2 * IDEAL.step)) + 0.1


def test_docked_position_is_the_geometric_one() -> None:
    """No friction, noise or angle errors: play used up, shoulder pressed by the threshold."""
    gears = replace(SHORT, friction=0.0)
    off = 4e-4
    result = dock(truths(3), IDEAL, gears=gears, shift=(off, 0.0))
    assert np.all(result.seated)
    x, y, depth, tilt_x, tilt_y, psi = result.q.T
    force = result.traces.contact[-1]
    pressed = -force[:, 2] / gears.seat_stiffness
    np.testing.assert_allclose(depth, gears.length + pressed, atol=2e-7)
    # Between wall and plan: the tip lies beyond its play by its force over a tooth's stiffness.
    beyond = x - gears.clearance
    assert np.all(beyond > 0.0)
    assert np.all(beyond < IDEAL.impedance.stiffness[0] * off / gears.stiffness)
    assert np.abs(y).max() <= gears.clearance
    assert np.abs(psi).max() <= gears.twist
    # Wall and mouth share the load: what tilt is left is the impedance's answer to a few N·mm.
    assert np.hypot(tilt_x, tilt_y).max() < gears.tilt


def test_halving_the_step_changes_maxima_little() -> None:
    truth = truths(3, seed=4)
    wrong = uncalibrated(loose_rig(), truth.rotation @ rotations.exp(np.full(3, 2e-3)), 3)
    runs = [
        dock(
            truth,
            replace(IDEAL, step=step),
            shift=(3e-4, 2e-4),
            assumed=wrong,
            repeat=1e-5,
            beyond=0.0,
        )
        for step in (4e-3, 2e-3)
    ]
    coarse, fine = (r.peak_length[1:3].max(axis=0) for r in runs)
    assert fine.min() > 0.5
    np.testing.assert_allclose(coarse, fine, rtol=0.02)


def test_energy_does_not_grow_in_passive_contact() -> None:
    """Released while pressed on the wall: virtual springs, virtual mass and contact lose energy."""
    gears = GearPair(length=0.05, friction=0.0)
    controller = Controller(
        servo=Servo(bandwidth=np.inf, resolution=0.0),
        sensing=Sensing(rate=2000.0, noise=0.0),
        tare=0.0,
        thresholds=(1e6, 1e6, 1e6),
        step=5e-4,
        trace_rate=2000.0,
    )
    truth = truths(1, loose=False)
    mouth = HOME + np.array([-2e-4, 0.0, gears.tip[2] - 0.03])
    bore = Bore(np.eye(3)[None], mouth[None])
    rig = exact_rig()
    errors = draw_errors(controller.servo, 0.0, 1, 3, np.random.default_rng(0))
    machines = Machines(rig, truth, errors, perfect(truth), 1, np.random.SeedSequence(0))
    reference = still(0.25, 1, controller.step)
    traces = simulate(machines, controller, reference, Docking(gears, bore, 1.0)).traces
    d = traces.deviation[:, 0]
    rate = np.gradient(d, traces.time, axis=0)
    angle = 2 * np.pi * np.arange(8) / 8
    x = d[:, 0] + 2e-4
    back = 0.03 - gears.chamfer
    stored = np.zeros(len(d))
    for place in (x, x - back * d[:, 4]):  # tip and mouth
        stored += np.sum(np.maximum(np.outer(place, np.cos(angle)) - 5e-5, 0.0) ** 2, axis=1)
    energy = 0.5 * gears.stiffness * stored
    impedance = controller.impedance
    energy += 0.5 * (rate**2 @ np.array(impedance.mass) + d**2 @ np.array(impedance.stiffness))
    energy = energy[2:-2]
    assert energy[0] > 1e-3
    assert energy[-1] < 0.7 * energy[0]
    assert np.diff(energy).max() < 1e-4 * energy[0]


def test_perfect_calibration_leaves_only_noise() -> None:
    """The deviation's scatter is that of white noise through the impedance, in closed form."""
    lanes = 60
    rig = exact_rig()
    truth = truths(lanes, loose=False)
    controller = Controller(tare=0.0, servo=Servo(resolution=0.0))
    machines = Machines(
        rig,
        truth,
        draw_errors(controller.servo, 0.0, lanes, rig.n, np.random.default_rng(0)),
        perfect(truth),
        lanes,
        np.random.SeedSequence(5),
    )
    result = simulate(machines, controller, still(5.0, lanes, controller.step))
    d = result.traces.deviation[-1]
    # Wrench noise of the observer itself, by linearity; then the lag of the impedance.
    observer = WrenchObserver(perfect(truth), np.array(controller.impedance.centre))
    unit = np.eye(9).reshape(9, 1, 3, 3)
    base = observer.wrench(np.zeros((lanes, 3, 3)) + truth.zero, np.tile(np.eye(3), (lanes, 1, 1)))
    columns = [
        observer.wrench(truth.zero + u, np.tile(np.eye(3), (lanes, 1, 1))) - base for u in unit
    ]
    gain = np.stack(columns, axis=-1)  # (L, 6, 9)
    variance = controller.sensing.noise**2 * np.einsum("lac,lac->la", gain, gain)
    one = transition(controller.impedance, controller.step)
    P = np.zeros((6, 2, 2))
    for _ in range(1250):
        P = (
            one.state @ P @ np.swapaxes(one.state, -1, -2)
            + one.drive[:, :, None] * one.drive[:, None]
        )
    standardised = d / np.sqrt(variance * P[:, 0, 0])
    chi2 = float(np.sum(standardised[:, :3] ** 2))  # forces along x, y, z are independent
    assert abs(chi2 - 3 * lanes) < 3.3 * np.sqrt(2 * 3 * lanes)
    assert np.abs(d[:, :3]).max() < 1e-4


def test_false_force_displaces_by_its_stiffness() -> None:
    """Free space, untared: K (x − x_d) = false wrench."""
    truth = truths(2)
    controller = replace(IDEAL, tare=0.0)
    rig = loose_rig()
    wrong = replace(perfect(truth), zero=truth.zero + np.array([1.0, -2.0, 0.5]))
    machines = Machines(
        rig, truth, draw_errors(controller.servo, 0.0, 2, 3, np.random.default_rng(0)), wrong, 2,
        np.random.SeedSequence(0),
    )  # fmt: skip
    result = simulate(machines, controller, still(10.0, 2, controller.step))
    K = np.array(controller.impedance.stiffness)
    np.testing.assert_allclose(result.traces.deviation[-1] * K, result.traces.measured[-1]
                               - np.concatenate([np.zeros((2, 3)), np.cross(
                                   np.array(controller.impedance.centre),
                                   result.traces.measured[-1][:, :3])], axis=1),
                               rtol=1e-3, atol=1e-4)  # fmt: skip
    assert np.abs(result.traces.deviation[-1][:, :3]).max() > 1e-4


def test_same_seed_same_numbers_and_other_noise_other_numbers() -> None:
    truth = truths(2)
    controller = replace(IDEAL, sensing=Sensing(noise=1.75))
    first, again, other = (
        dock(truth, controller, noise=seed, shift=(2e-4, 0.0), beyond=0.0) for seed in (1, 1, 2)
    )
    assert first.peak.max() > 1.0
    np.testing.assert_array_equal(first.peak, again.peak)
    assert not np.array_equal(first.peak, other.peak)


def test_jamming_is_recognised() -> None:
    """Beyond the lead-in's reach the shaft lands on the face."""
    result = dock(truths(1), IDEAL, shift=(SHORT.capture + 1.5e-3, 0.0))
    assert result.jammed.all()
    assert not result.seated.any()
    assert result.q[0, 2] < SHORT.length / 2


def test_unstable_impedance_is_refused() -> None:
    soft = Impedance(damping=(200.0,) * 3 + (60.0,) * 3)
    with pytest.raises(UsageError, match="unstable"):
        dock(truths(1), replace(IDEAL, impedance=soft))
    gears = GearPair()
    K = gears.stiffness_at_mouth_and_tip(soft.centre)
    assert contact_radius(soft, K, Servo().lag, 4e-3, 1) > 1.0
    assert contact_radius(Impedance(), K, Servo().lag, 4e-3, 1) < 1.0


def test_a_filter_that_is_late_makes_contact_unstable() -> None:
    """Damping that is just enough without a filter is not with one that is 35 ms late."""
    edge = Impedance(damping=tuple(0.25 * b for b in Impedance().damping))
    late = Walk.of(3.0, 1.75, 4e-3)
    assert late.delay == pytest.approx(0.035, rel=0.01)
    K = GearPair().stiffness_at_mouth_and_tip(edge.centre)
    assert contact_radius(edge, K, Servo().lag, 4e-3, 1) < 1.0
    assert contact_radius(edge, K, Servo().lag, 4e-3, 1, late.gain) > 1.0
    with pytest.raises(UsageError, match=r"filtered with a gain of 0\.1, and servos"):
        require_stable(edge, K, Servo().lag, 4e-3, 1, late.gain)


def test_the_loop_filters_as_the_causal_filter_does() -> None:
    """What the controller makes of its readings is `filtering.Causal` of them."""
    walk = Walk.of(3.0, 1.75, 4e-3)
    truth = truths(1, loose=False)
    sensing = Sensing(gain=walk.gain, watch=1e-9)  # records are not smoothed
    controller = Controller(sensing=sensing, servo=Servo(resolution=0.0), trace_rate=250.0)
    assert sensing.delay == pytest.approx(walk.delay, rel=1e-12)
    rig = exact_rig()
    machines = Machines(
        rig,
        truth,
        draw_errors(controller.servo, 0.0, 1, rig.n, np.random.default_rng(0)),
        perfect(truth),
        1,
        np.random.SeedSequence(5),
    )
    traces = simulate(machines, controller, still(0.4, 1, controller.step)).traces
    reading = Causal(walk)(traces.reading)[:, 0]
    centre = np.array(controller.impedance.centre)
    for k in (0, 30, 99):
        # One sample is taken with the posture of the step before, microradians away.
        seen = WrenchObserver(perfect(truth), centre).wrench(reading[None, k], np.eye(3)[None])
        np.testing.assert_allclose(traces.measured[k, 0, :3], seen[0, :3], atol=0.05)
    raw = WrenchObserver(perfect(truth), centre).wrench(traces.reading[99], np.eye(3)[None])
    assert np.abs(raw[0, :3] - traces.measured[99, 0, :3]).max() > 0.5


def test_step_must_divide_the_sample() -> None:
    with pytest.raises(UsageError, match="does not divide"):
        dock(truths(1), replace(IDEAL, step=3e-3))


def test_posture_outside_the_travel_is_refused() -> None:
    with pytest.raises(UsageError, match="ncp1 would have to move 300 mm"):
        require_within(
            exact_rig(), poses(1, np.array([0.3, 0, 0])), tuple(HOME), (0.25, 0.25, 0.5), "posture"
        )
