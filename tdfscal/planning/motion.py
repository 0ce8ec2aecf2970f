"""The usual motion for the angles within the limits of a rig, and what to expect of it.

Every coordinate, three translations along and three turns about the BCS's axes and 3n − 6 internal
forces, follows one line of a multisine: a sine has the largest effect of all signals within a limit
of its size. The lines lie evenly between the slowest and the fastest one, which takes coordinates
apart; a search among random lines finds none that is better by more than a few per cent. All start
and end at rest. A translation shows nothing of the sensors by itself, but takes stiff
positioners through their errors, which squeeze; without a stated travel there is none.
"""

from __future__ import annotations

import numpy as np

from tdfscal.errors import NotIdentifiableError
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import EVEN_TURN, nominal, sensing
from tdfscal.model.statics import internal_modes, internal_part
from tdfscal.motioncal.blocks import blocks
from tdfscal.motioncal.estimator import at_state
from tdfscal.motioncal.fit import MovingPriors
from tdfscal.motioncal.rows import NoiseModel
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics import so3
from tdfscal.numerics.information import inverse
from tdfscal.planning.candidates import Candidates, Limits, check_noise, hanging, room, too_heavy
from tdfscal.planning.predicted_information import Forecast
from tdfscal.records import ANGLES, FloatArray, Rig, UncertainValue

#: Fastest line, Hz: the carriages follow it quasi-statically, and inertia stays a correction.
_FASTEST = 0.2
#: Phases, turns, from one line to the next: as uneven as may be.
_GOLDEN = 0.618034
#: Time in which a motion starts and ends, s, and at most as a share of it.
_RAMP, _RAMP_SHARE = 3.0, 0.2
#: Instants per second at which the limits are held, and which show a slow motion whole.
_FINE, _RATE = 10.0, 4.0
#: Rounds in which the angles, which act almost linearly, are brought to their limits.
_ROUNDS, _ROUNDING = 6, 1e-9
#: Step of the time table, s.
TABLE = 0.1
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


@record
class Multisine:
    """Lines brought to the limits.

    line : (3n,), periods of each coordinate: translations, turns, squeezes. way (3,), m, turn, rad,
    and force, N : what a coordinate of 1 is.
    """

    rig: Rig
    request: MovingRequest
    line: FloatArray
    way: FloatArray
    turn: float
    force: float

    def at(self, time: FloatArray) -> Candidates:
        """What is driven at times (N,), s."""
        rig, limits = self.rig, self.request.limits
        signal = _signals(self.line, self.request.duration, time)
        R = so3.exp(self.turn * signal[:, 3:6]) @ limits.level
        arm, carried = hanging(rig, R)
        middle = limits.at_home(rig).mean(axis=0) + self.way * signal[:, :3]
        spoke = (rig.hinge - rig.hinge.mean(axis=0)) @ np.swapaxes(R, 1, 2)
        modes = internal_modes((rig.hinge - rig.barycentre.value) @ limits.level.T)
        squeeze = self.force * internal_part(arm, np.tensordot(signal[:, 6:], modes, axes=1))
        return Candidates(R, middle[:, None] + spoke, carried, squeeze)


@record
class MovingPlan:
    """A motion to be driven. expected : the uncertainty that it promises."""

    rig: Rig
    request: MovingRequest
    motion: Multisine
    expected: Forecast

    @property
    def time(self) -> FloatArray:
        """Instants (N,) of the time table, s."""
        return np.asarray(np.arange(round(self.request.duration / TABLE) + 1) * TABLE)

    @property
    def used(self) -> dict[str, FloatArray]:
        """What the motion uses of its limits: rad, m/s, m per axis, N."""
        course, limits = self.motion.at(self.time), self.request.limits
        way = np.linalg.norm(np.diff(course.place, axis=0), axis=2)
        used = {
            "tilt": np.arccos(np.clip((course.rotation @ limits.level.T)[:, 2, 2], -1, 1)).max(),
            "speed": way.max() / (self.time[1] - self.time[0]),
            "travel": np.abs(course.place - limits.at_home(self.rig)).max(axis=(0, 1)),
            "squeeze": np.linalg.norm(course.squeeze, axis=2).max(),
            "force": np.linalg.norm(course.force, axis=2).max(),
        }
        return {name: np.asarray(value) for name, value in used.items()}


def plan_motion(rig: Rig, request: MovingRequest, rng: np.random.Generator) -> MovingPlan:
    """Bring the usual multisine to the limits, and foretell what it shows.

    rng : draws the positioners' own errors, where their stiffness is known.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : an angle stays unobservable.
    """
    check_noise(rig, request.noise)
    motion = usual_motion(rig, request)
    expected = forecast(motion, rng)
    if expected.largest > rig.acceptance.identifiable:
        i, j = np.unravel_index(int(np.nanargmax(expected.rpy_std)), expected.rpy_std.shape)
        raise NotIdentifiableError(
            f"the motion within these limits does not determine {ANGLES[j]} of "
            f"{rig.supports[i]}: about ±{1e3 * expected.rpy_std[i, j]:.3g} mrad would be left",
            hint="squeeze harder, tilt farther, or move for longer",
        )
    return MovingPlan(rig, request, motion, expected)


def usual_motion(rig: Rig, request: MovingRequest) -> Multisine:
    """Return the largest motion of the usual lines within the limits.

    Raises UsageError where the weight alone is beyond a limit of the forces.
    """
    limits, duration = request.limits, request.duration
    line = np.round(np.linspace(1, max(1, int(_FASTEST * duration)), 3 * rig.n))
    time = np.linspace(0.0, duration, max(60, int(_FINE * duration)) + 1)
    signal = _signals(line, duration, time)
    turn, room_left = _turn(limits, signal[:, 3:6]), limits.travel.min(axis=0)
    # To the end of the travel; none where that is not stated.
    way = np.where(np.isfinite(room_left), room_left, 0.0) / np.abs(signal[:, :3]).max(axis=0)
    motion, home = Multisine(rig, request, line, way, turn, 1.0), limits.at_home(rig)
    for _ in range(_ROUNDS):  # way and speed grow almost linearly with both
        course = motion.at(time)
        speed = np.linalg.norm(np.diff(course.place, axis=0), axis=2).max(axis=1) / np.diff(time)
        gone = np.abs(course.place - home)
        with np.errstate(divide="ignore", invalid="ignore"):
            use = np.where(gone > _ROUNDING, gone / limits.travel, 0.0).max()
        use = max(use, speed.max() / request.speed)
        if use <= 1.0:
            break
        use *= 1 + _ROUNDING
        motion = replace(motion, way=motion.way / use, turn=motion.turn / use)
    course = motion.at(time)
    largest = float(np.linalg.norm(course.squeeze, axis=2).max())
    force = 0.0 if largest == 0.0 else limits.squeeze / largest
    left = float(room(rig, limits, course.carried, force * course.squeeze).min())
    if left < 0.0:
        raise too_heavy(rig, limits, course.carried)
    return replace(motion, force=force * min(left, 1.0))


def _signals(line: FloatArray, duration: float, time: FloatArray) -> FloatArray:
    """Coordinates (N, C), at most 1, from rest to rest."""
    ramp = min(_RAMP, _RAMP_SHARE * duration)
    u = np.clip(np.minimum(time, duration - time) / ramp, 0.0, 1.0)
    envelope = u**3 * (10.0 + u * (6.0 * u - 15.0))
    turns = line * np.clip(time, 0.0, duration)[:, None] / duration
    wave = np.sin(2 * np.pi * (turns + _GOLDEN * np.arange(len(line))))
    return np.asarray(wave * envelope[:, None])


def _turn(limits: Limits, signal: FloatArray) -> float:
    """Size, rad, of turns (N, 3) whose largest lean or twist is the limit."""
    turn = limits.tilt
    for _ in range(_ROUNDS if turn > 0.0 else 0):
        R = so3.exp(turn * signal)
        lean = np.arccos(np.clip(R[:, 2, 2], -1.0, 1.0))
        twist = np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1])
        turn *= limits.tilt / max(float(lean.max()), float(np.abs(twist).max()))
    return turn


def forecast(motion: Multisine, rng: np.random.Generator, draws: int = DRAWS) -> Forecast:
    """Uncertainty to expect of a motion; NaN for sensors of one axis or none, which have no angles.

    rng : draws the internal forces that the positioners' own errors make where their stiffness is
    known; the mean variance over the draws stands.
    """
    rig, request = motion.rig, motion.request
    time = np.arange(int(request.duration * _RATE)) / _RATE
    course, R = motion.at(time), nominal(rig).rotation
    open_ends = (rig.axes.sum(axis=1) < 2)[:, None]
    unplanned = request.limits.repeatability_force(rig)
    courses = [course]
    if unplanned > 0.0:
        courses = [_with_errors(course, unplanned, rng) for _ in range(draws)]
    variance = [so3.rpy_variance(R, _covariance(rig, request, each, time)) for each in courses]
    return Forecast(np.where(open_ends, np.nan, np.sqrt(np.mean(variance, axis=0))))


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


def _with_errors(course: Candidates, size: float, rng: np.random.Generator) -> Candidates:
    """The course with the internal forces of one draw of the positioners' error fields."""
    n = course.place.shape[1]
    wave = rng.standard_normal((n, 3, _WAVES, 3)) / _LEAD
    phase = rng.uniform(-np.pi, np.pi, (n, 3, _WAVES))
    angle = np.einsum("knb,nawb->knaw", course.place, wave) + phase
    error = size * np.sqrt(2.0 / _WAVES) * np.cos(angle).sum(axis=3)
    arm = course.place - course.place.mean(axis=1, keepdims=True)
    return replace(course, squeeze=course.squeeze + internal_part(arm, error))
