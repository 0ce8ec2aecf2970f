"""A campaign without a stop: d'Alembert's forces on a terminal that rides on elastic carriages.

The carriages are stiff enough (natural frequencies of tens of hertz) that the terminal follows
them quasi-statically: at every instant springs, weight, inertia and friction balance.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import FloatArray, Log, Rig
from tdfscal.simulation import faults, rotations
from tdfscal.simulation.equilibrium import Load, Pose, inertial, internal_part, reading, settle
from tdfscal.simulation.options import MovingOptions, Timeline, minimum_jerk
from tdfscal.simulation.truth import Truth, draw_inertia, draw_truths

#: Rate at which the equilibrium is computed, Hz; between its instants splines run.
_SOLVED = 40.0
#: Time in which a touch comes and goes, s.
_TOUCH = 0.05
#: Friction is Coulomb's above this angular speed, rad/s, and viscous well below it.
_STICK = 1.0e-4
#: Waves that make one component of a field.
_WAVES = 64
#: Lines of each coordinate's multisine.
_LINES = 4
#: Length of a rest and of a move between rests, s.
_REST, _MOVE = 6.0, 4.0
#: Time in which a motion starts and ends, s.
_START = 3.0


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


@record
class Trajectory:
    """A commanded motion.

    pose : t (N,) in s → poses (N,) of the nominal terminal. squeeze : t (N,) → (N, 3n − 6), N,
    internal force of each orthonormal mode. servo : t (N,) → (N, n, 3), m, BCS, what the NCPs are
    sent to where that is given, squeezes included; None: what pose and squeeze ask for.
    """

    pose: Callable[[FloatArray], Pose]
    squeeze: Callable[[FloatArray], FloatArray]
    servo: Callable[[FloatArray], FloatArray] | None = None


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
    drawn = draw_inertia(rig, truth, inertia_rng)
    inertia = drawn if options.inertia is None else options.inertia
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
    rest, felt = settle(truth, where, load, pose).force, stamp - options.delay
    force = CubicSpline(knots, rest)(felt)
    for touch in options.touches:
        wrench = np.stack([np.asarray(touch.force), np.asarray(touch.moment)])
        pressed = Load(load.contact + wrench @ pose.rotation, load.friction)
        change = settle(truth, where, pressed, pose).force - rest
        share = np.clip((felt - touch.begin) / _TOUCH, 0, 1)
        share = share * np.clip((touch.end - felt) / _TOUCH, 0, 1)
        force += share[:, None, None] * CubicSpline(knots, change)(felt)

    noise_rng, slow_rng, encoder_rng = record_rng.spawn(3)
    signal = reading(truth, force)
    signal = signal + options.noise * noise_rng.standard_normal(signal.shape)
    if options.slow_noise > 0.0:
        white = slow_rng.standard_normal(signal.shape)
        slow = _correlated(white, options.slow_time, options.rate)
        signal = signal + options.slow_noise * slow
    place = faults.Place(np.zeros(count), stamp / options.duration)
    signal = signal + faults.zero_offset(options.faults, rig.n, place)
    shown = CubicSpline(knots, servo)(stamp)
    shown = shown + options.encoder * encoder_rng.standard_normal(shown.shape)
    if options.quantum > 0.0:
        shown = options.quantum * np.round(shown / options.quantum)
    log = Log(
        supports=rig.supports,
        position=faults.streams(stamp, shown),
        force=faults.streams(stamp, signal),
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


def _correlated(white: FloatArray, time: float, rate: float) -> FloatArray:
    """Stationary AR(1) noise of unit variance, from white (N, ...); correlation time, s."""
    from scipy.signal import lfilter  # slow to import, rarely needed

    phi = np.exp(-1.0 / (rate * time))
    white[1:] *= np.sqrt(1.0 - phi**2)  # the first value is already stationary
    return np.asarray(lfilter([1.0], [1.0, -phi], white, axis=0))


def draw_trajectory(options: MovingOptions, n: int, rng: np.random.Generator) -> Trajectory:
    """Draw the motion of one campaign on n supports."""
    if options.drive == "stops":
        way, squeeze = _stops(options, 6, rng), _stops(options, 3 * n - 6, rng)
    else:
        straight = options.drive == "approach"
        way = _approach(options, rng) if straight else _multisine(options, 6, rng)
        squeeze = _multisine(options, 3 * n - 6, rng)
    turns = 0.0 if options.drive == "approach" else options.tilt
    home = np.asarray(options.home)

    def pose(time: FloatArray) -> Pose:
        course = way(time)
        return Pose(rotations.exp(turns * course[:, 3:]), home + options.travel * course[:, :3])

    return Trajectory(pose, lambda time: options.squeeze * squeeze(time))


def _multisine(
    options: MovingOptions, size: int, rng: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """`size` coordinates, each a sum of sines with a largest value of 1, from rest to rest."""
    line = options.frequency * rng.uniform(0.4, 1.6, (_LINES, size))
    phase = rng.uniform(-np.pi, np.pi, (_LINES, size))
    grid = np.linspace(0.0, options.duration, 2048)

    def raw(time: FloatArray) -> FloatArray:
        wave = np.sin(2 * np.pi * line * time[:, None, None] + phase).sum(axis=1)
        return np.asarray(wave * _envelope(time, options.duration)[:, None])

    top = np.abs(raw(grid)).max(axis=0)
    return lambda time: raw(time) / top


def _stops(
    options: MovingOptions, size: int, rng: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """`size` coordinates that rest at random values up to 1, with quintic moves between them."""
    count = 1 + np.ceil(options.duration / (_REST + _MOVE))
    start = (_REST + _MOVE) * np.arange(count, dtype=np.float64)
    value = rng.uniform(-1.0, 1.0, (len(start), size))
    timeline = Timeline(start, start + _REST)
    return lambda time: timeline.at(np.clip(time, 0.0, options.duration)).blend(value)


def _approach(
    options: MovingOptions, rng: np.random.Generator
) -> Callable[[FloatArray], FloatArray]:
    """A straight way of length 1 in a random direction near the BCS's −x, at constant speed."""
    direction = np.array([-1.0, *rng.uniform(-0.3, 0.3, 2)])
    direction /= np.linalg.norm(direction)
    fine = np.linspace(0.0, options.duration, 4001)
    speed = _envelope(fine, options.duration)
    share = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    share /= share[-1]

    def course(time: FloatArray) -> FloatArray:
        from scipy.interpolate import CubicSpline  # slow to import, rarely needed

        out = np.zeros((len(time), 6))
        out[:, :3] = CubicSpline(fine, share)(time)[:, None] * direction
        return out

    return course


def _envelope(time: FloatArray, duration: float) -> FloatArray:
    """0 at both ends of the campaign, 1 after the start, twice smooth."""
    u = np.clip(np.minimum(time, duration - time) / min(_START, duration / 3), 0.0, 1.0)
    return minimum_jerk(u)
