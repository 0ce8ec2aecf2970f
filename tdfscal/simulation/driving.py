"""How a campaign is driven: dwells, smooth moves between them and what they shake, motions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import FloatArray, IntArray, Series
from tdfscal.simulation import rotations
from tdfscal.simulation.equilibrium import Pose, Postures, internal_part
from tdfscal.simulation.faults import Place
from tdfscal.simulation.options import MovingOptions, Recorder


@record
class Moment:
    """Instants of a campaign, (N,) each.

    index : the dwell last entered. share : of the move that follows it, 0 in the dwell, 1 at the
    next. speed : 0 at rest, 1 at the top speed of the move.
    """

    index: IntArray
    share: FloatArray
    speed: FloatArray

    def blend(self, value: FloatArray) -> FloatArray:
        """Values per posture (K, ...) carried over from posture to posture, (N, ...)."""
        after = np.minimum(self.index + 1, len(value) - 1)
        share = self.share.reshape(-1, *(1,) * (value.ndim - 1))
        here = value[self.index]
        return np.asarray(here + share * (value[after] - here), dtype=np.float64)


@record
class Timeline:
    """start, end : (K,), s, of the dwells; the campaign runs from start[0] to end[-1]."""

    start: FloatArray
    end: FloatArray

    def at(self, time: FloatArray) -> Moment:
        """Where the campaign is at times (N,), s; moves are quintic, of minimum jerk."""
        index = np.clip(np.searchsorted(self.start, time, side="right") - 1, 0, None)
        onward = np.append(self.start[1:], np.inf)[index]
        u = np.clip((time - self.end[index]) / (onward - self.end[index]), 0.0, 1.0)
        share = u**3 * (10.0 + u * (6.0 * u - 15.0))
        return Moment(index.astype(np.int64), share, 16.0 * (u * (1.0 - u)) ** 2)

    def place(self, time: FloatArray) -> Place:
        """The same, as faults count it."""
        moment = self.at(time)
        return Place(moment.index + moment.share, time / self.end[-1])

    def samples(self, rate: float) -> FloatArray:
        """Sampling times at `rate` (Hz) over the whole campaign, s."""
        count = int(np.floor(self.end[-1] * rate * (1.0 + 1e-12))) + 1
        return np.arange(count) / rate


def draw_timeline(recorder: Recorder, postures: int, rng: np.random.Generator) -> Timeline:
    """Dwells and moves of random lengths, the first dwell from time 0."""
    dwell = rng.uniform(*recorder.dwell, postures)
    move = rng.uniform(*recorder.move, postures - 1)
    start = np.concatenate([[0.0], np.cumsum(dwell[:-1] + move)])
    return Timeline(start, start + dwell)


def between(postures: Postures, moment: Moment) -> Postures:
    """Commands along the moves, (N,), from those of the postures, (K,).

    The terminal turns about a fixed axis from pose to pose, so that a move does not strain it.
    """
    R = postures.pose.rotation
    after = np.append(R[1:], R[-1:], axis=0)
    way = rotations.log(np.swapaxes(R, -1, -2) @ after)
    turn = rotations.exp(moment.share[:, None] * way[moment.index])
    pose = Pose(R[moment.index] @ turn, moment.blend(postures.pose.translation))
    return Postures(pose, moment.blend(postures.displacement))


def shaking(
    recorder: Recorder,
    timeline: Timeline,
    time: FloatArray,
    hinge: FloatArray,
    way: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Vibration in the moves and settling after them, (N, n, 3), N, to be added to the forces.

    Settling: a relaxation and an oscillation of equal size, both falling to 5 % in
    `recorder.settling`. The relaxation builds up during the move before the stop; of internal
    forces at every place on the way, since nothing else could hold it in balance.

    hinge : (K, n, 3), m, BCS, at the stops; way : (N, n, 3), at these times.
    """
    shape = hinge.shape
    K, n = shape[:2]
    moment = timeline.at(time)
    hum_rate, hum_phase = rng.uniform(8.0, 25.0, shape), rng.uniform(-np.pi, np.pi, shape)
    ring_rate = rng.uniform(5.0, 12.0, shape)
    relax, ring = recorder.settling_force * rng.standard_normal((2, *shape)) / np.sqrt(2.0)
    relax = internal_part(hinge, relax) * np.sqrt(3 * n / (3 * n - 6))  # as large as drawn
    relax[0] = ring[0] = 0.0  # the first dwell follows no move
    k = moment.index
    since = (time - timeline.start[k])[:, None, None]
    hum = np.sin(2.0 * np.pi * hum_rate[k] * since + hum_phase[k])
    out = recorder.vibration * moment.speed[:, None, None] * hum
    if recorder.settling > 0.0:
        decay = np.exp(-since * np.log(20.0) / recorder.settling)
        out += decay * (relax[k] + ring[k] * np.sin(2.0 * np.pi * ring_rate[k] * since))
        after = np.minimum(k + 1, K - 1)
        out += moment.share[:, None, None] * internal_part(way, relax[after])
    return np.asarray(out, dtype=np.float64)


def streams(time: FloatArray, value: FloatArray) -> tuple[Series, ...]:
    """What is logged at times (N,), s: a stream per support of value (N, n, 3)."""
    return tuple(Series(time, np.ascontiguousarray(value[:, i])) for i in range(value.shape[1]))


def correlated(white: FloatArray, time: float, rate: float) -> FloatArray:
    """Stationary AR(1) noise of unit variance, from white (N, ...); correlation time, s."""
    from scipy.signal import lfilter  # slow to import, rarely needed

    phi = np.exp(-1.0 / (rate * time))
    white[1:] *= np.sqrt(1.0 - phi**2)  # the first value is already stationary
    return np.asarray(lfilter([1.0], [1.0, -phi], white, axis=0))


#: Lines of each coordinate's multisine.
_LINES = 4
#: Length of a rest and of a move between rests, s.
_REST, _MOVE = 6.0, 4.0
#: Time in which a motion starts and ends, s.
_START = 3.0


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
    count = 1 + int(np.ceil(options.duration / (_REST + _MOVE)))
    value = rng.uniform(-1.0, 1.0, (count, size))

    def course(time: FloatArray) -> FloatArray:
        inside = np.clip(time, 0.0, options.duration)
        here = np.minimum((inside // (_REST + _MOVE)).astype(np.int64), count - 2)
        u = np.clip((inside - here * (_REST + _MOVE) - _REST) / _MOVE, 0.0, 1.0)[:, None]
        share = u**3 * (10.0 + u * (6.0 * u - 15.0))
        return np.asarray(value[here] + share * (value[here + 1] - value[here]))

    return course


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
    return np.asarray(u**3 * (10.0 + u * (6.0 * u - 15.0)))
