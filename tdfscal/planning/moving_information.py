"""What a motion would tell, by the estimator's own balance, blocks and weights."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.parameters import EVEN_TURN, nominal, sensing
from tdfscal.motioncal.blocks import blocks
from tdfscal.motioncal.estimator import MovingPriors, at_state
from tdfscal.motioncal.noise import NoiseModel
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics import so3
from tdfscal.planning.candidates import Candidates
from tdfscal.planning.exchange import inverse
from tdfscal.planning.limits import Limits
from tdfscal.planning.predicted_information import Forecast
from tdfscal.planning.static_loads import internal_part
from tdfscal.planning.trajectory import Trajectory
from tdfscal.records import FloatArray, Rig, UncertainValue

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


@dataclass(frozen=True, slots=True)
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
