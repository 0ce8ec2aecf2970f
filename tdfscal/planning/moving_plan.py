"""A motion for the angles in a given time: what it would tell by the estimator's own balance."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import EVEN_TURN, nominal, sensing
from tdfscal.model.statics import internal_part
from tdfscal.motioncal.blocks import blocks
from tdfscal.motioncal.estimator import MovingPriors, at_state
from tdfscal.motioncal.noise import NoiseModel
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics import so3
from tdfscal.planning.candidates import Candidates, Limits, check_limits
from tdfscal.planning.predicted_information import Forecast, averaged
from tdfscal.planning.selection import inverse
from tdfscal.planning.trajectory import Lines, Trajectory, brought_to_limits
from tdfscal.records import ANGLES, FloatArray, Rig, UncertainValue

#: Instants per second that show a slow motion whole.
_RATE = 4.0
#: Correlation time, s, of force noise that does not average out within a posture (the rig file's
#: uncertainty.force_noise): amplifiers and structure.
_SLOW = 2.0
#: Way, m, over which the error of a positioner changes: the lead of its screw.
_LEAD = 0.02
#: Draws of the positioners' errors, and waves of each.
DRAWS, _WAVES = 6, 64
#: Knots of the spectra, Hz.
_KNOTS = np.geomspace(2e-3, 3.0, 24)


@record
class MovingRequest:
    """What is asked for.

    duration : s. speed : m/s, of any hinge. noise : N/√Hz, root density of a force component: that
    of its mean over a second. delay : s, of the force stamps, as the rig file states it.
    """

    limits: Limits
    duration: float
    speed: float
    noise: float
    delay: UncertainValue


def _covariance(
    rig: Rig, request: MovingRequest, course: Candidates, time: FloatArray
) -> FloatArray:
    """Covariance (3n, 3n) of the rotations to expect, rad², BCS."""
    n, slow = rig.n, _seen(rig, course, time)
    cut = blocks(slow, np.ones(len(time), dtype=np.bool_))
    priors = MovingPriors(rig, slow, request.delay)
    fit = at_state(
        priors, cut, priors.start(nominal(rig)), _spectrum(rig, request.noise, course, time)
    )
    _, J = fit.whitened()
    information = J.T @ J
    information[: 3 * n, : 3 * n] += np.eye(3 * n) / EVEN_TURN**2
    # What no row sees stays as open as its unit is wide.
    information += np.diag(1e-12 * np.diagonal(information).max() * np.ones(len(information)))
    return inverse(information)[: 3 * n, : 3 * n]


def _seen(rig: Rig, course: Candidates, time: FloatArray) -> Slow:
    state = nominal(rig)
    back = np.linalg.inv(sensing(state))
    force = np.einsum("nab,knb->kna", back, course.force) + state.zero
    return Slow(
        supports=rig.supports,
        time=time,
        position=course.place,
        force=force,
        step=float(time[1] - time[0]),
        rate=1 / float(time[1] - time[0]),
        clipped=np.zeros(len(time), dtype=np.bool_),
    )


def _spectrum(rig: Rig, noise: float, course: Candidates, time: FloatArray) -> NoiseModel:
    """Force noise, flat and slow, and position noise by the error fields at this speed."""
    declared = rig.declared
    f = 2 * np.pi * _KNOTS
    force = noise**2 + 2 * _SLOW * declared.force_noise**2 / (1 + (f * _SLOW) ** 2)
    step = np.linalg.norm(np.diff(course.place, axis=0), axis=2)
    speed = float(np.sqrt(np.mean(step**2))) / float(time[1] - time[0])
    lasts = _LEAD / max(speed, _LEAD / float(time[-1]))
    # A Gaussian correlation over the way, at the mean speed of the hinges.
    place = declared.positioner**2 * np.sqrt(2 * np.pi) * lasts
    place = place * np.exp(-0.5 * (f * lasts) ** 2) + 1e-18
    H = len(_KNOTS)
    log_density = np.log(np.concatenate([force, place]))
    nothing = np.zeros((2 * H, 2 * H))
    return NoiseModel(np.log(_KNOTS), log_density, log_density, nothing, nothing)


def instants(duration: float) -> FloatArray:
    """Times (N,), s, at which a motion is looked at."""
    return np.arange(int(duration * _RATE)) / _RATE


def forecast(
    request: MovingRequest, trajectory: Trajectory, rng: np.random.Generator, draws: int = DRAWS
) -> Forecast:
    """Uncertainty to expect of a motion; NaN for sensors of one axis or none, which have no angles.

    rng : draws the internal forces that the positioners' own errors make where their stiffness is
    known; the mean variance over the draws stands.
    """
    rig, time = trajectory.rig, instants(trajectory.duration)
    course = trajectory.at(time)
    R = nominal(rig).rotation
    open_ends = (rig.axes.sum(axis=1) < 2)[:, None]
    unplanned = request.limits.repeatability_force(rig)
    courses = [course]
    if unplanned > 0.0:
        courses = [_with_errors(course, unplanned, rng) for _ in range(draws)]
    variance = [so3.rpy_variance(R, _covariance(rig, request, each, time)) for each in courses]
    return Forecast(np.where(open_ends, np.nan, np.sqrt(np.mean(variance, axis=0))))


def _with_errors(course: Candidates, size: float, rng: np.random.Generator) -> Candidates:
    """The course with the internal forces of one draw of the positioners' error fields."""
    n = course.place.shape[1]
    wave = rng.standard_normal((n, 3, _WAVES, 3)) / _LEAD
    phase = rng.uniform(-np.pi, np.pi, (n, 3, _WAVES))
    angle = np.einsum("knb,nawb->knaw", course.place, wave) + phase
    error = size * np.sqrt(2.0 / _WAVES) * np.cos(angle).sum(axis=3)
    arm = course.place - course.place.mean(axis=1, keepdims=True)
    return replace(course, squeeze=course.squeeze + internal_part(arm, error))


#: Fastest line, Hz: the carriages follow it quasi-statically, and inertia stays a correction.
_FASTEST = 0.2
#: Motions that are drawn, of which the best is taken.
_DRAWN = 12
#: Steps of the time table, s.
TABLE = 0.1
#: Shortest motion, s.
_SHORTEST = 20.0


@record
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
    def used(self) -> dict[str, FloatArray]:
        """What the motion uses of its limits: rad, m/s, m per axis, N."""
        course, limits = self.trajectory.at(self.time), self.request.limits
        way = np.linalg.norm(np.diff(course.place, axis=0), axis=2)
        used = {
            "tilt": np.arccos(np.clip((course.rotation @ limits.level.T)[:, 2, 2], -1, 1)).max(),
            "speed": way.max() / (self.time[1] - self.time[0]),
            "travel": np.abs(course.place - limits.at_home(self.rig)).max(axis=(0, 1)),
            "squeeze": np.linalg.norm(course.squeeze, axis=2).max(),
            "force": np.linalg.norm(course.force, axis=2).max(),
        }
        return {name: np.asarray(value) for name, value in used.items()}

    @property
    def time(self) -> FloatArray:
        """Instants (N,) of the time table, s."""
        return np.asarray(np.arange(round(self.request.duration / TABLE) + 1) * TABLE)


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
            where="duration",
            hint=f"give {_SHORTEST:g} to 3600 s",
        )
    if not 0.0 < request.speed < np.inf:
        raise UsageError(
            f"the speed limit is {request.speed:g} m/s", where="speed", hint="give m/s above 0"
        )
    if not 0.0 < request.noise < np.inf:
        raise UsageError(f"the noise is {request.noise:g} N", where="noise", hint="give newtons")


def _drawn(coordinates: int, most: int, rng: np.random.Generator) -> Lines:
    """A motion of random lines."""
    return Lines(
        rng.integers(1, most + 1, coordinates),
        rng.uniform(-np.pi, np.pi, coordinates),
        np.ones(coordinates),
    )
