"""A motion for the angles in a given time: the best of several multisines within the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.planning.limits import check_limits
from tdfscal.planning.moving_information import MovingRequest, forecast
from tdfscal.planning.predicted_information import Forecast, averaged
from tdfscal.planning.static_loads import internal_part
from tdfscal.planning.trajectory import Lines, Trajectory, brought_to_limits
from tdfscal.records import ANGLES, FloatArray, Rig

#: Fastest line, Hz: the carriages follow it quasi-statically, and inertia stays a correction.
_FASTEST = 0.2
#: Motions that are drawn, of which the best is taken.
_DRAWN = 12
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
    """A motion to be driven. expected, random : of it, and of all that were drawn, on average."""

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
    """Choose the best of several multisines of random lines within the limits.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : an angle stays unobservable.
    """
    _check(rig, request)
    most = max(1, int(_FASTEST * request.duration))
    drawn = [
        brought_to_limits(
            rig, request.limits, request.duration, request.speed, _drawn(3 * rig.n, most, rng)
        )
        for _ in range(_DRAWN)
    ]
    forecasts = [forecast(request, trajectory, rng) for trajectory in drawn]
    best = int(np.argmin([found.mean for found in forecasts]))
    expected = forecasts[best]
    if expected.largest > rig.acceptance.identifiable:
        i, j = np.unravel_index(int(np.nanargmax(expected.rpy_std)), expected.rpy_std.shape)
        raise NotIdentifiableError(
            f"no motion within these limits determines {ANGLES[j]} of "
            f"{rig.supports[i]}: about ±{1e3 * expected.rpy_std[i, j]:.3g} mrad would be left",
            hint="squeeze harder, tilt farther, or move for longer",
        )
    return MovingPlan(rig, request, drawn[best], expected, averaged(forecasts))


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
