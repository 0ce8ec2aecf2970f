"""A motion that could be commanded: turns and squeezes as smooth functions of time.

Every coordinate, three translations along and three turns about the BCS's axes and 3n − 6 internal
forces, follows one line of a multisine: a sine has the largest effect of all signals within a limit
of its size. All start and end at rest. A translation shows nothing of the sensors by itself, but
takes stiff positioners through their errors, which squeeze; without a stated travel there is none.
"""

from __future__ import annotations

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.frozen import record
from tdfscal.model.statics import internal_modes, internal_part
from tdfscal.numerics import so3
from tdfscal.planning.candidates import Candidates, Limits, displacement, hanging, room
from tdfscal.records import FloatArray, IntArray, Rig

#: Time in which a motion starts and ends, s, and at most as a share of it.
_RAMP, _RAMP_SHARE = 3.0, 0.2
#: Instants per second at which the limits are held.
_FINE = 10.0
#: Rounds in which the angles, which act almost linearly, are brought to their limits.
_ROUNDS = 6


@record
class Lines:
    """What each of C = 3n coordinates does: size · sin(2π line t / duration + phase).

    line, phase, size : (C,), translations, turns, squeezes; sizes, at most 1, count within each.
    """

    line: IntArray
    phase: FloatArray
    size: FloatArray


@record
class Trajectory:
    """Lines brought to the limits: way (3,), m, turn, rad, and force, N, are those of size 1."""

    rig: Rig
    limits: Limits
    duration: float
    lines: Lines
    way: FloatArray
    turn: float
    force: float

    def at(self, time: FloatArray) -> Candidates:
        """What is driven at times (N,), s."""
        signal = _signals(self.lines, self.duration, time)
        R = so3.exp(self.turn * signal[:, 3:6]) @ self.limits.level
        arm, carried = hanging(self.rig, R)
        middle = self.limits.at_home(self.rig).mean(axis=0) + self.way * signal[:, :3]
        spoke = (self.rig.hinge - self.rig.hinge.mean(axis=0)) @ np.swapaxes(R, 1, 2)
        squeeze = self.force * _internal(self.rig, self.limits, arm, signal[:, 6:])
        return Candidates(R, middle[:, None] + spoke, carried, squeeze)


def brought_to_limits(
    rig: Rig, limits: Limits, duration: float, speed: float, lines: Lines
) -> Trajectory:
    """Return the largest motion of these lines within the limits; speed : m/s, of any hinge.

    Raises UsageError where the weight alone is beyond a limit of the forces.
    """
    time = np.linspace(0.0, duration, max(60, int(_FINE * duration)) + 1)
    signal = _signals(lines, duration, time)
    turn, way = _turn(limits, signal[:, 3:6]), _way(limits, signal[:, :3])
    share = 1.0
    for _ in range(_ROUNDS):  # both act almost linearly on way and speed
        R = so3.exp(share * turn * signal[:, 3:6]) @ limits.level
        use = _use(rig, limits, speed, R, share * way * signal[:, :3], time)
        if use <= 1.0:
            break
        share /= use * (1 + 1e-9)
    turn, way = share * turn, share * way
    R = so3.exp(turn * signal[:, 3:6]) @ limits.level
    arm, carried = hanging(rig, R)
    unit = _internal(rig, limits, arm, signal[:, 6:])
    largest = float(np.linalg.norm(unit, axis=2).max())
    force = 0.0 if largest == 0.0 else limits.squeeze / largest
    left = float(room(rig, limits, carried, force * unit).min())
    if left < 0.0:
        raise UsageError(
            "the weight alone takes the NCPs or the sensors to their limit of force",
            hint="raise the force limit, tilt less, or correct the capacities that are stated",
        )
    return Trajectory(rig, limits, duration, lines, way, turn, force * min(left, 1.0))


def _signals(lines: Lines, duration: float, time: FloatArray) -> FloatArray:
    """Coordinates (N, C), from rest to rest."""
    ramp = min(_RAMP, _RAMP_SHARE * duration)
    u = np.clip(np.minimum(time, duration - time) / ramp, 0.0, 1.0)
    envelope = u**3 * (10.0 + u * (6.0 * u - 15.0))
    inside = np.clip(time, 0.0, duration)[:, None]
    wave = np.sin(2 * np.pi * lines.line * inside / duration + lines.phase)
    return np.asarray(lines.size * wave * envelope[:, None])


def _internal(rig: Rig, limits: Limits, arm: FloatArray, share: FloatArray) -> FloatArray:
    """Internal forces (N, n, 3) of shares (N, 3n − 6) in the modes at home."""
    modes = internal_modes((rig.hinge - rig.barycentre.value) @ limits.level.T)
    return internal_part(arm, np.tensordot(share, modes, axes=1))


def _turn(limits: Limits, signal: FloatArray) -> float:
    """Size, rad, of turns (N, 3) whose largest lean or twist is the limit."""
    turn = limits.tilt
    if turn == 0.0 or not np.any(signal):
        return 0.0
    for _ in range(_ROUNDS):
        R = so3.exp(turn * signal)
        lean = np.arccos(np.clip(R[:, 2, 2], -1.0, 1.0))
        twist = np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1])
        turn *= limits.tilt / max(float(lean.max()), float(np.abs(twist).max()))
    return turn


def _way(limits: Limits, signal: FloatArray) -> FloatArray:
    """Size (3,), m, of translations (N, 3) that end with the travel; 0 where none is stated."""
    room = limits.travel.min(axis=0)
    largest = np.abs(signal).max(axis=0)
    return np.where(np.isfinite(room) & (largest > 0), room / np.where(largest > 0, largest, 1), 0)


def _use(
    rig: Rig,
    limits: Limits,
    speed: float,
    R: FloatArray,
    shift: FloatArray,
    time: FloatArray,
) -> float:
    """Largest share that is used of travel and speed; above 1 is beyond it."""
    way = displacement(rig, limits, R) + shift[:, None]
    moving = np.linalg.norm(np.diff(way, axis=0), axis=2).max(axis=1) / np.diff(time)
    with np.errstate(divide="ignore", invalid="ignore"):
        used = np.where(np.abs(way) > 1e-9, np.abs(way) / limits.travel, 0.0)
    return float(max(used.max(), moving.max() / speed))
