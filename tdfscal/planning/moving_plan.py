"""The motion that is best for the angles in a given time: exchange of lines, then small changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.planning.limits import check_limits
from tdfscal.planning.moving_information import MovingRequest, forecast
from tdfscal.planning.predicted_information import Forecast, averaged
from tdfscal.planning.static_loads import internal_part
from tdfscal.planning.trajectory import Lines, Trajectory, brought_to_limits
from tdfscal.records import ANGLES, FloatArray, IntArray, Rig

#: Fastest line, Hz: the carriages follow it quasi-statically, and inertia stays a correction.
_FASTEST = 0.2
#: Lines and sizes that a coordinate may take in the exchange.
_CHOICE, _SHARES = 6, (0.5, 0.2)
#: Small changes that are tried, their size, the share of the coordinates that each touches, and
#: the least size of a line.
_CHANGES, _CHANGE, _FEW, _LEAST = 120, 0.3, 0.35, 0.02
#: Random motions that the plan is compared with; lines of each of their coordinates.
_RANDOM = 8
#: Steps of the time table, s, and distances of waypoints to choose from, s.
TABLE = 0.1
_WAYPOINTS = (2.0, 1.0, 0.5, 0.25, 0.2, 0.1)
#: What a spline through the waypoints may miss: m, of the motion as a whole, and share of the
#: squeeze, for which the hinges' places among themselves count.
_CLOSE, _CLOSE_SHARE = 1.0e-4, 0.02
#: Shortest motion, s.
_SHORTEST = 20.0


@dataclass(frozen=True, slots=True)
class MovingPlan:
    """A motion to be driven. expected, random : of it, and of random motions within the limits."""

    rig: Rig
    request: MovingRequest
    trajectory: Trajectory
    expected: Forecast
    random: Forecast

    @property
    def improvement(self) -> float:
        """Mean standard uncertainty of random motions over that of the plan."""
        return self.random.mean / self.expected.mean

    @property
    def time(self) -> FloatArray:
        """Instants (N,) of the time table, s."""
        return np.asarray(np.arange(round(self.request.duration / TABLE) + 1) * TABLE)

    @property
    def waypoints(self) -> FloatArray:
        """Times (M,), s, through whose positions a cubic spline, at rest at both ends, runs."""
        from scipy.interpolate import CubicSpline

        fine = self.trajectory.at(self.time)
        limits = self.request.limits
        arm = fine.place - fine.place.mean(axis=1, keepdims=True)
        slack = max(_CLOSE_SHARE * limits.squeeze, 1e-3)
        for step in _WAYPOINTS:
            count = max(4, round(self.request.duration / step))
            knot = np.asarray(np.linspace(0.0, self.request.duration, count + 1), dtype=np.float64)
            course = self.trajectory.at(knot)
            near = CubicSpline(knot, course.position(limits), bc_type="clamped")(self.time)
            force = CubicSpline(knot, course.squeeze, bc_type="clamped")(self.time)
            off = near - fine.position(limits)
            squeezed = force - fine.squeeze
            if limits.stiffness is not None:
                squeezed = limits.stiffness * internal_part(arm, off)
            if np.abs(off).max() <= _CLOSE and np.abs(squeezed).max() <= slack:
                break
        return knot


def plan_motion(rig: Rig, request: MovingRequest, rng: np.random.Generator) -> MovingPlan:
    """Choose a motion: every coordinate's line in turn, then small changes of all.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : an angle stays unobservable.
    """
    _check(rig, request)
    coordinates = 3 * rig.n

    def driven(lines: Lines) -> Trajectory:
        return brought_to_limits(rig, request.limits, request.duration, request.speed, lines)

    # What the positioners' errors squeeze is the same draw for all, so that motions compare.
    fixed = int(rng.integers(2**32))

    def size(lines: Lines) -> float:
        errors = np.random.default_rng(fixed)
        return float(np.nanmean(forecast(request, driven(lines), errors, draws=1).rpy_std ** 2))

    most = max(1, int(_FASTEST * request.duration))
    choice = np.unique(np.round(np.geomspace(1, most, _CHOICE)).astype(np.int64))
    start = Lines(
        choice[rng.permutation(coordinates) % len(choice)],
        rng.uniform(-np.pi, np.pi, coordinates),
        np.ones(coordinates),
    )
    best = _changed(_exchanged(start, choice, size), most, size, rng)
    expected = forecast(request, driven(best), rng)
    if expected.largest > rig.acceptance.identifiable:
        i, j = np.unravel_index(int(np.nanargmax(expected.rpy_std)), expected.rpy_std.shape)
        raise NotIdentifiableError(
            f"no motion within these limits determines {ANGLES[j]} of "
            f"{rig.supports[i]}: about ±{1e3 * expected.rpy_std[i, j]:.3g} mrad would be left",
            hint="squeeze harder, tilt farther, or move for longer",
        )
    others = [
        forecast(request, driven(_drawn(coordinates, most, rng)), rng) for _ in range(_RANDOM)
    ]
    return MovingPlan(rig, request, driven(best), expected, averaged(others))


def _check(rig: Rig, request: MovingRequest) -> None:
    check_limits(rig, request.limits)
    if not _SHORTEST <= request.duration <= 3600.0:
        raise UsageError(
            f"the motion is to last {request.duration:g} s",
            where="--duration",
            hint=f"give {_SHORTEST:g} to 3600 s",
        )
    if not 0.0 < request.speed < np.inf:
        raise UsageError(
            f"the speed limit is {request.speed:g} m/s", where="--speed", hint="give m/s above 0"
        )
    if not 0.0 < request.noise < np.inf:
        raise UsageError(f"the noise is {request.noise:g} N", where="--noise", hint="give newtons")


def _drawn(coordinates: int, most: int, rng: np.random.Generator) -> Lines:
    """A motion of random lines."""
    return Lines(
        rng.integers(1, most + 1, coordinates),
        rng.uniform(-np.pi, np.pi, coordinates),
        np.ones(coordinates),
    )


def _exchanged(lines: Lines, choice: IntArray, size: Callable[[Lines], float]) -> Lines:
    """Every coordinate in turn takes the line that is best with the others, or a smaller size."""
    least = size(lines)
    for c in range(len(lines.line)):
        here = np.arange(len(lines.line)) == c
        tried = [replace(lines, line=np.where(here, line, lines.line)) for line in choice]
        tried += [replace(lines, size=np.where(here, share, lines.size)) for share in _SHARES]
        sizes = [size(each) for each in tried]
        if min(sizes) < least:
            lines, least = tried[int(np.argmin(sizes))], min(sizes)
    return lines


def _changed(
    lines: Lines, most: int, size: Callable[[Lines], float], rng: np.random.Generator
) -> Lines:
    """Small changes of lines, phases and sizes, each kept where it helps."""
    least, wide = size(lines), _CHANGE
    for _ in range(_CHANGES):
        count = len(lines.line)
        few = rng.random(count) < _FEW
        step = np.where(few, rng.integers(-2, 3, count), 0)
        tried = Lines(
            line=np.clip(lines.line + step, 1, most),
            phase=lines.phase + np.where(few, 3 * wide * rng.standard_normal(count), 0.0),
            size=np.clip(
                lines.size * np.exp(np.where(few, 2 * wide * rng.standard_normal(count), 0.0)),
                _LEAST, 1.0,
            ),
        )  # fmt: skip
        now = size(tried)
        if now < least:
            lines, least = tried, now
        else:
            wide = max(0.985 * wide, 0.1)
    return lines
