"""Where a laser tracker takes the bore of the outer gear to be (Sect. 5.2)."""

from __future__ import annotations

import numpy as np

from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import SurveyOptions, measure, rotations

#: Measuring points of the outer gear on a circle about the bore's mouth, m, every other deeper.
_POINTS, _RADIUS, _STEP = 6, 0.15, 0.05


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
