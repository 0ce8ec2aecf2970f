"""What may go wrong in a campaign; each fault is optional and none is drawn at random.

Sensors and postures are counted from 0. The `Place` of a reading says where in the campaign it
was taken, so that the same code serves a time series and the means of dwells.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tdfscal.frozen import record
from tdfscal.records import FloatArray, Rig, Series
from tdfscal.simulation import rotations

Vector = tuple[float, float, float]


@record
class ZeroShift:
    """The zero of a sensor jumps by `change` (N, its frame) half way to posture `posture`."""

    sensor: int
    posture: int
    change: Vector


@record
class Slip:
    """A sensor turns in its mounting by `turn` (rad, BCS) half way to posture `posture`."""

    sensor: int
    posture: int
    turn: Vector


@record
class Drift:
    """The zero of a sensor creeps by `change` (N, its frame) in proportion to time."""

    sensor: int
    change: Vector


@record
class Gain:
    """Relative gain errors of a sensor's axes, and symmetric crosstalk (xy, xz, yz).

    Added to its true sensitivity error.
    """

    sensor: int
    relative: Vector = (0.0, 0.0, 0.0)
    crosstalk: Vector = (0.0, 0.0, 0.0)


@record
class Contact:
    """A contact at one posture: the wrench that the surroundings exert on the terminal.

    force (N) and moment (N·m, about the LCS origin), components in the LCS.
    """

    posture: int
    force: Vector
    moment: Vector = (0.0, 0.0, 0.0)


@record
class Jolt:
    """A half-sine blow on the terminal within a dwell.

    force : N at its peak, LCS, through the LCS origin. duration : s.
    at : middle of the blow, as a fraction of the dwell.
    """

    posture: int
    force: Vector
    duration: float = 0.1
    at: float = 0.5


@record
class DeadAxis:
    """One axis (0, 1, 2) of a sensor repeats its last reading from half way to `posture` on."""

    sensor: int
    axis: int
    posture: int = 0


@record
class Walk:
    """Each channel of a sensor walks at random by `size` (N, standard deviation) to the end."""

    sensor: int
    size: float


@record
class Warming:
    """The hall warms up by `rise` (K) over the campaign, and zeros follow by `slope` (N/K).

    The temperature rises as 1 − exp(−3 t) does, t from 0 to 1. slope : (n, 3).
    """

    rise: float
    slope: npt.ArrayLike


@record
class Frame:
    """A positioner logs its travel in a frame that is turned and scaled.

    turn (rad, rotation vector), scale (relative, per axis).
    """

    sensor: int
    turn: Vector = (0.0, 0.0, 0.0)
    scale: Vector = (0.0, 0.0, 0.0)

    @property
    def matrix(self) -> FloatArray:
        """What the logged coordinates add to the true ones, per metre of travel, (3, 3)."""
        return np.asarray(rotations.hat(np.asarray(self.turn)) + np.diag(self.scale))


@record
class Faults:
    """All faults of one campaign. saturated: readings are cut off at the rig's capacity.

    swapped : pairs of sensors whose channels are exchanged in the log.
    """

    zero_shifts: tuple[ZeroShift, ...] = ()
    slips: tuple[Slip, ...] = ()
    drifts: tuple[Drift, ...] = ()
    gains: tuple[Gain, ...] = ()
    contacts: tuple[Contact, ...] = ()
    jolts: tuple[Jolt, ...] = ()
    dead_axes: tuple[DeadAxis, ...] = ()
    swapped: tuple[tuple[int, int], ...] = ()
    saturated: bool = False
    walks: tuple[Walk, ...] = ()
    warming: Warming | None = None
    frames: tuple[Frame, ...] = ()
    hysteresis: float = 0.0
    """Friction of each hinge against the turn by which a posture is reached, N·m."""


@record
class Place:
    """Where in the campaign readings are taken.

    posture : (N,), k in dwell k, between k and k + 1 in the move that follows it.
    progress : (N,), 0 at the start of the campaign, 1 at its end.
    """

    posture: FloatArray
    progress: FloatArray


def sensitivity(faults: Faults, sensors: int) -> FloatArray:
    """What gains and crosstalk add to the sensitivity error S, (n, 3, 3), symmetric."""
    extra = np.zeros((sensors, 3, 3))
    for g in faults.gains:
        xy, xz, yz = g.crosstalk
        beside = np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
        extra[g.sensor] += np.diag(g.relative) + beside
    return extra


def contact(faults: Faults, postures: int) -> FloatArray:
    """Force and moment on the terminal per posture, (K, 2, 3), LCS, about its origin."""
    wrench = np.zeros((postures, 2, 3))
    for c in faults.contacts:
        wrench[c.posture] += np.array([c.force, c.moment])
    return wrench


def turned_away(faults: Faults, force: FloatArray, place: Place) -> FloatArray:
    """Forces (..., N, n, 3), N, BCS, as sensors at their first mounting would feel them.

    A sensor turned from X to exp([δ]×) X reads of a force what it would have read of
    exp([δ]×)ᵀ times that force.
    """
    if not faults.slips:
        return force
    force = force.copy()
    for s in faults.slips:
        later = place.posture >= s.posture - 0.5
        force[..., later, s.sensor, :] = force[..., later, s.sensor, :] @ rotations.exp(
            np.asarray(s.turn)
        )
    return force


def zero_offset(faults: Faults, sensors: int, place: Place) -> FloatArray:
    """What shifts and drifts add to the zeros, (N, n, 3), N."""
    offset = np.zeros((len(place.posture), sensors, 3))
    for s in faults.zero_shifts:
        offset[place.posture >= s.posture - 0.5, s.sensor] += s.change
    if faults.warming is not None:
        warmer = temperature(faults, place) - temperature(faults, Place(np.zeros(1), np.zeros(1)))
        offset += warmer[:, None, None] * np.asarray(faults.warming.slope)
    for d in faults.drifts:
        offset[:, d.sensor] += place.progress[:, None] * np.asarray(d.change)
    return offset


def temperature(faults: Faults, place: Place) -> FloatArray:
    """Temperature of the hall (N,), °C."""
    rise = 0.0 if faults.warming is None else faults.warming.rise
    return np.asarray(20.0 + rise * (1.0 - np.exp(-3.0 * place.progress)))


def streams(time: FloatArray, value: FloatArray) -> tuple[Series, ...]:
    """What is logged at times (N,), s: a stream per support of value (N, n, 3)."""
    return tuple(Series(time, np.ascontiguousarray(value[:, i])) for i in range(value.shape[1]))


def thermometer(faults: Faults, time: FloatArray, place: Place) -> tuple[Series, ...]:
    """What a thermometer logs at times (N,), s, of these places; nothing in a steady hall."""
    if faults.warming is None:
        return ()
    return (Series(time, np.repeat(temperature(faults, place)[:, None], 3, axis=1)),)


def zero_walk(
    faults: Faults, sensors: int, progress: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """What random walks add to the zeros, (..., N, n, 3), N; progress (..., N) from 0 to 1."""
    step = np.sqrt(np.maximum(np.diff(progress, axis=-1, prepend=progress[..., :1]), 0.0))
    out = np.zeros((*progress.shape, sensors, 3))
    for walk in faults.walks:
        increments = walk.size * step[..., None] * rng.standard_normal((*progress.shape, 3))
        out[..., walk.sensor, :] += np.cumsum(increments, axis=-2)
    return out


def logged(faults: Faults, place: FloatArray, home: FloatArray) -> FloatArray:
    """What frames add to logged coordinates (..., n, 3), m; home: where they are right."""
    out = np.zeros_like(place)
    for frame in faults.frames:
        away = place[..., frame.sensor, :] - home[..., frame.sensor, :]
        out[..., frame.sensor, :] += away @ frame.matrix.T
    return out


def recorded(faults: Faults, reading: FloatArray, place: Place, rig: Rig) -> FloatArray:
    """What the recorder makes of readings (..., N, n, 3): cut off, frozen, exchanged.

    What a sensor does not measure reads 0.
    """
    out = np.clip(reading, -rig.capacity, rig.capacity) if faults.saturated else reading.copy()
    out[..., ~rig.axes] = 0.0
    for dead in faults.dead_axes:
        first = int(np.searchsorted(place.posture, dead.posture - 0.5))
        out[..., first:, dead.sensor, dead.axis] = out[..., first, dead.sensor, dead.axis, None]
    for a, b in faults.swapped:
        out[..., [a, b], :] = out[..., [b, a], :]
    return np.asarray(out, dtype=np.float64)
