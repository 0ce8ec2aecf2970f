"""A campaign without a stop: d'Alembert's forces on a terminal that rides on elastic carriages.

The carriages are stiff enough (natural frequencies of tens of hertz) that the terminal follows
them quasi-statically: at every instant springs, weight, inertia and friction balance.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import FloatArray, Log, Rig
from tdfscal.simulation import faults
from tdfscal.simulation.driving import Trajectory, correlated, draw_trajectory, streams
from tdfscal.simulation.equilibrium import Load, Pose, inertial, internal_part, reading, settle
from tdfscal.simulation.options import MovingOptions
from tdfscal.simulation.truth import Truth, draw_inertia, draw_truths

#: Rate at which the equilibrium is computed, Hz; between its instants splines run.
_SOLVED = 40.0
#: Time in which a touch comes and goes, s.
_TOUCH = 0.05
#: Friction is Coulomb's above this angular speed, rad/s, and viscous well below it.
_STICK = 1.0e-4
#: Waves that make one component of a field.
_WAVES = 64


@record
class MovingCampaign:
    """What is known, what is true, what was recorded.

    rig : as stated. inertia : (3, 3), true, kg m² about the LCS origin. time : (N,), s, instants
    of the force samples. force : (N, n, 3), N, BCS, true forces at the recorded force stamps.
    """

    rig: Rig
    options: MovingOptions
    truth: Truth
    inertia: FloatArray
    log: Log
    time: FloatArray
    force: FloatArray


def simulate_moving(
    rig: Rig,
    options: MovingOptions,
    rng: np.random.Generator,
    truth: Truth | None = None,
    way: Trajectory | None = None,
) -> MovingCampaign:
    """Drive and record one campaign in motion.

    truth : of the machine, where it was driven before; else it is drawn. way : what is driven,
    in place of a drawn trajectory.
    Truth, trajectory, error fields and recorder draw from streams of their own.

    Raises NotConvergedError where the carriages cannot hold the terminal.
    """
    from scipy.interpolate import CubicSpline  # slow to import, rarely needed

    truth_rng, way_rng, field_rng, record_rng, inertia_rng = rng.spawn(5)
    truth = truth or draw_truths(rig, options.machine, truth_rng, 1).trial(0)
    inertia = options.inertia
    if inertia is None:
        inertia = draw_inertia(rig, truth, inertia_rng)
    way = way or draw_trajectory(options, rig.n, way_rng)
    field = draw_field(rig.n, rig.declared.positioner, options.field_correlation, field_rng)

    count = int(np.floor(options.duration * options.rate * (1 + 1e-12))) + 1
    stamp = np.arange(count) / options.rate
    lead = max(abs(options.delay), 0.05) + 0.1
    knots = np.arange(-lead, options.duration + lead, 1 / _SOLVED)
    servo = _servo(rig, truth, way, knots)
    where = servo + truth.datum + field(servo)
    pose, (push, turning) = way.pose(knots), inertial(way.pose, truth, inertia, knots)
    load = Load(push, _hinge_friction(options.friction, truth, turning))
    force = CubicSpline(knots, settle(truth, where, load, pose).force)(stamp - options.delay)
    force = force + _touched(options, truth, where, load, pose, knots, stamp - options.delay)

    noise_rng, slow_rng, encoder_rng = record_rng.spawn(3)
    signal = reading(truth, force)
    signal = signal + options.noise * noise_rng.standard_normal(signal.shape)
    if options.slow_noise > 0.0:
        white = slow_rng.standard_normal(signal.shape)
        slow = correlated(white, options.slow_time, options.rate)
        signal = signal + options.slow_noise * slow
    place = faults.Place(np.zeros(count), stamp / options.duration)
    signal = signal + faults.zero_offset(options.faults, rig.n, place)
    shown = CubicSpline(knots, servo)(stamp)
    shown = shown + options.encoder * encoder_rng.standard_normal(shown.shape)
    if options.quantum > 0.0:
        shown = options.quantum * np.round(shown / options.quantum)
    log = Log(
        supports=rig.supports,
        position=streams(stamp, shown),
        force=streams(stamp, signal),
        temperature=faults.thermometer(options.faults, stamp, place),
    )
    return MovingCampaign(rig, options, truth, inertia, log, stamp, force)


def _servo(rig: Rig, truth: Truth, way: Trajectory, time: FloatArray) -> FloatArray:
    """Servo coordinates (N, n, 3), m, BCS, that make the pose and the squeeze."""
    if way.servo is not None:
        return way.servo(time)
    place = way.pose(time).place(rig.hinge)
    n = rig.n
    # An orthonormal basis of the internal forces at the middle of the travel, (3n, 3n − 6).
    middle = place.mean(axis=0)
    projector = internal_part(
        np.broadcast_to(middle, (3 * n, n, 3)), np.eye(3 * n).reshape(-1, n, 3)
    )
    modes = np.linalg.eigh(projector.reshape(3 * n, 3 * n))[1][:, 6:]
    force = internal_part(place, (way.squeeze(time) @ modes.T).reshape(-1, n, 3))
    give = np.linalg.inv(truth.stiffness)
    return np.asarray(place + np.einsum("nij,knj->kni", give, force) - truth.datum)


def _hinge_friction(friction: float, truth: Truth, turning: FloatArray) -> FloatArray:
    """Coulomb's moment (N, 3), N·m, BCS; friction : N·m of each hinge. turning : (N, 3), rad/s."""
    speed = np.sqrt(np.sum(turning**2, axis=1) + _STICK**2)[:, None]
    return np.asarray(-friction * truth.hinge.shape[0] * turning / speed)


def _touched(
    options: MovingOptions,
    truth: Truth,
    where: FloatArray,
    load: Load,
    pose: Pose,
    knots: FloatArray,
    time: FloatArray,
) -> FloatArray:
    """What the touches add to the forces, (N, n, 3), N, BCS, at times (N,)."""
    from scipy.interpolate import CubicSpline

    out = np.zeros((len(time), *where.shape[1:]))
    if not options.touches:
        return out
    plain = settle(truth, where, load, pose).force
    for touch in options.touches:
        wrench = np.stack([np.asarray(touch.force), np.asarray(touch.moment)])
        pressed = Load(load.contact + wrench @ pose.rotation, load.friction)
        change = settle(truth, where, pressed, pose).force - plain
        share = np.clip((time - touch.begin) / _TOUCH, 0, 1)
        share = share * np.clip((touch.end - time) / _TOUCH, 0, 1)
        out += share[:, None, None] * CubicSpline(knots, change)(time)
    return out


def draw_field(
    n: int, std: float, correlation: float, rng: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """Draw stationary Gaussian fields, one per support and axis, by random waves.

    Takes servo coordinates (N, n, 3), m, to errors of this standard deviation, m, with correlation
    exp(−d²/2ℓ²) over the distance d, ℓ = correlation in m.
    """
    wave = rng.standard_normal((n, 3, _WAVES, 3)) / correlation
    phase = rng.uniform(-np.pi, np.pi, (n, 3, _WAVES))

    def error(servo: FloatArray) -> FloatArray:
        out = np.empty(servo.shape)
        for i, a in np.ndindex(n, 3):
            out[:, i, a] = np.cos(servo[:, i] @ wave[i, a].T + phase[i, a]).sum(axis=1)
        return np.asarray(std * np.sqrt(2.0 / _WAVES) * out)

    return error
