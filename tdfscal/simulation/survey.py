"""Laser-tracker surveys of the rig (Sect. 3.2)."""

from __future__ import annotations

import numpy as np

from tdfscal.frozen import record
from tdfscal.records import FloatArray, Instrument, PointSet, Rig, TrackerSession
from tdfscal.simulation import rotations
from tdfscal.simulation.options import SurveyOptions
from tdfscal.simulation.truth import Truth

SENSOR_BELOW = np.array([0.0, 0.0, -0.15])
"""From a hinge centre to the middle of its sensor, BCS, m."""


@record
class Survey:
    """A simulated survey and its truth.

    rotation : (3, 3), R_b^m, BCS → tracker. translation : (3,), m. body : (n, 3, 3), the
    sensors' bodies, body frame → BCS. offset : (n, 3), m, BCS, from hinge centre to the point
    that is measured while the NCP moves. misalignment : rad per axis, standard deviation that
    the bodies were drawn with.
    """

    session: TrackerSession
    rotation: FloatArray
    translation: FloatArray
    body: FloatArray
    offset: FloatArray
    misalignment: float


def measure(point: FloatArray, instrument: Instrument, rng: np.random.Generator) -> FloatArray:
    """Points (..., 3), m, in the tracker's frame, as a spherical instrument reads them (Eq. 25).

    Range and both encoder angles (θ horizontal, φ from the zenith) are disturbed.
    """
    r = np.linalg.norm(point, axis=-1)
    theta = np.arctan2(point[..., 1], point[..., 0])
    phi = np.arctan2(np.hypot(point[..., 0], point[..., 1]), point[..., 2])
    angle_sd = np.deg2rad(instrument.angle_arcsec / 3600.0)
    draw = rng.standard_normal((3, *r.shape))
    r = r + (instrument.range + 1.0e-6 * instrument.range_ppm * r) * draw[0]
    theta = theta + angle_sd * draw[1]
    phi = phi + angle_sd * draw[2]
    return np.stack(
        [r * np.sin(phi) * np.cos(theta), r * np.sin(phi) * np.sin(theta), r * np.cos(phi)],
        axis=-1,
    )


def simulate_survey(
    rig: Rig,
    truth: Truth,
    options: SurveyOptions,
    rng: np.random.Generator,
    home: tuple[float, float, float] = (0.05, -0.03, 1.2),
) -> Survey:
    """Survey one rig: targets on the sensors' bodies, then one point per NCP as it moves alone.

    truth : of one trial. home : LCS origin in the BCS when the targets are measured, m. The
    instrument stands about as high as the rig, in a random direction, a little out of level.
    """
    n = rig.n
    setup_rng, target_rng, move_rng = rng.spawn(3)
    hinge = rig.hinge + np.asarray(home)
    middle = hinge.mean(axis=0)
    azimuth, heading = setup_rng.uniform(-np.pi, np.pi, 2)
    rise = setup_rng.uniform(-0.06, 0.06)
    way = np.array([np.cos(rise) * np.cos(azimuth), np.cos(rise) * np.sin(azimuth), np.sin(rise)])
    origin = middle + options.distance * way
    lean = setup_rng.normal(0.0, 0.01, 3) * np.array([1.0, 1.0, 0.0])
    R = rotations.exp(lean) @ rotations.exp(np.array([0.0, 0.0, heading]))

    def seen(point: FloatArray, draw: np.random.Generator) -> FloatArray:
        return measure((point - origin) @ R.T, options.instrument, draw)

    nominal = np.repeat(np.asarray(options.targets)[None], n, axis=0)
    real = nominal + options.drawing * target_rng.standard_normal(nominal.shape)
    twist = options.body_misalignment * target_rng.standard_normal((n, 3))
    body = truth.rotation @ rotations.exp(twist)
    targets = np.einsum("nij,npj->npi", body, real) + (hinge + SENSOR_BELOW)[:, None, :]

    servo = hinge[:, None, :] + move_rng.uniform(-1.0, 1.0, (n, options.moves, 3)) * options.travel
    repeat = rig.declared.positioner * move_rng.standard_normal(servo.shape)
    offset = SENSOR_BELOW + move_rng.uniform(-0.05, 0.05, (n, 3))
    carriage = servo + truth.datum[:, None, :] + repeat
    session = TrackerSession(
        instrument=options.instrument,
        drawing=options.drawing,
        nominal=_points(rig, "P", nominal),
        targets=_points(rig, "P", seen(targets, target_rng)),
        servo=_points(rig, "M", servo),
        moves=_points(rig, "M", seen(carriage + offset[:, None, :], move_rng)),
    )
    return Survey(session, R, -R @ origin, body, offset, options.body_misalignment)


def _points(rig: Rig, prefix: str, xyz: FloatArray) -> PointSet:
    count = xyz.shape[1]
    return PointSet(
        group=tuple(name for name in rig.supports for _ in range(count)),
        point=tuple(f"{prefix}{j + 1}" for _ in rig.supports for j in range(count)),
        xyz=xyz.reshape(-1, 3),
        std=None,
        source="simulated",
    )
