"""Where a moving terminal is sent: pose and squeeze as smooth functions of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdfscal.records import FloatArray
from tdfscal.simulation import rotations
from tdfscal.simulation.equilibrium import Pose
from tdfscal.simulation.moving_options import MovingOptions

#: Lines of each coordinate's multisine.
_LINES = 4
#: Length of a rest and of a move between rests, s.
_REST, _MOVE = 6.0, 4.0
#: Time in which a motion starts and ends, s.
_START = 3.0


@dataclass(frozen=True, slots=True)
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
