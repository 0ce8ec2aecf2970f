"""The planned motion x_d, and the survey of the bore by which it is planned (Sect. 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import Pose, SurveyOptions, measure, rotations

#: Measuring points of the outer gear on a circle about the bore's mouth, m, every other deeper.
_POINTS, _RADIUS, _STEP = 6, 0.15, 0.05


@dataclass(frozen=True, slots=True)
class Reference:
    """Poses between `start` (L,) and `goal` (L,), the same share of the way in every lane.

    share, rate, acceleration : (N,), 1, 1/s, 1/s², at the steps of the loop. The centre of
    compliance goes straight, the terminal turns about a fixed axis.
    """

    start: Pose
    goal: Pose
    share: FloatArray
    rate: FloatArray
    acceleration: FloatArray


def move(start: Pose, goal: Pose, duration: float, rest: float, step: float) -> Reference:
    """A move of minimum jerk in `duration` (s), then rest (s)."""
    time = np.arange(1, round((duration + rest) / step) + 1) * step
    u = np.clip(time / duration, 0.0, 1.0)
    return Reference(
        start,
        goal,
        share=u**3 * (10.0 + u * (6.0 * u - 15.0)),
        rate=30.0 * (u * (1.0 - u)) ** 2 / duration,
        acceleration=60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / duration**2,
    )


def advance(
    start: Pose, goal: Pose, *, way: float, speed: float, ramp: float, step: float
) -> Reference:
    """From rest at even acceleration during `ramp` (s) to `speed` (m/s), and on over `way` (m).

    goal : at the end of `way`.
    """
    total = way / speed + 0.5 * ramp
    time = np.arange(1, round(total / step) + 1) * step
    ramped = np.minimum(time, ramp)
    gone = speed * (0.5 * ramped**2 / ramp + np.maximum(time - ramp, 0.0))
    return Reference(
        start,
        goal,
        share=gone / way,
        rate=speed * ramped / ramp / way,
        acceleration=np.where(time < ramp, speed / ramp / way, 0.0),
    )


def require_within(
    rig: Rig, pose: Pose, home: tuple[float, ...], travel: tuple[float, ...], what: str
) -> None:
    """Refuse poses (...,) at which an NCP leaves its travel: ± travel (m) about its place at home.

    Raises UsageError.
    """
    place = pose.place(np.broadcast_to(rig.hinge, (*pose.translation.shape[:-1], rig.n, 3)))
    off = np.abs(place - rig.hinge - np.asarray(home)).reshape(-1, rig.n, 3)
    beyond = off - np.asarray(travel)
    if np.any(beyond > 1e-9):
        case, i, axis = np.unravel_index(int(beyond.argmax()), beyond.shape)
        raise UsageError(
            f"the NCP of {rig.supports[i]} would have to move {1e3 * off[case, i, axis]:.4g} mm "
            f"along {'xyz'[axis]}, and its travel is ±{1e3 * travel[axis]:.4g} mm",
            where=f"{what} {case + 1}",
            hint="choose postures nearer to home",
        )


def survey_error(
    rig: Rig,
    options: SurveyOptions,
    mouth: FloatArray,
    home: FloatArray,
    runs: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Error of the surveyed bore in the BCS, one per run: rotation (runs, 3, 3), left, and
    translation (runs, 3), m, of the mouth.

    mouth, home : (3,), m, BCS. The tracker measures points of the gear, and one point of each NCP
    at `options.moves` places, which give R_b^m and the BCS' origin; rigid fits without weights.
    """
    angle = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
    body = _RADIUS * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    body[::2, 2] = _STEP
    R_all, t_all = np.empty((runs, 3, 3)), np.empty((runs, 3))
    for run in range(runs):
        azimuth = rng.uniform(-np.pi, np.pi)
        station = home + options.distance * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        heading = rotations.exp(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))

        def seen(point: FloatArray) -> FloatArray:
            return measure((point - station) @ heading.T, options.instrument, rng)  # noqa: B023

        around = options.travel * rng.uniform(-1.0, 1.0, (rig.n, options.moves, 3))
        places = ((rig.hinge + home)[:, None, :] + around).reshape(-1, 3)
        really = places + rig.declared.positioner * rng.standard_normal(places.shape)
        A, a = rotations.fit(seen(really), places)
        B, b = rotations.fit(body, seen(body + mouth) @ A.T + a)
        R_all[run], t_all[run] = B, b - mouth
    return R_all, t_all
