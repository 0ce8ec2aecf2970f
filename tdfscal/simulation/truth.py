"""What a simulated rig really is, within what its file states; what a laser tracker sees."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from tdfscal.errors import RigError
from tdfscal.frozen import record
from tdfscal.records import (
    Acceptance,
    DeclaredUncertainty,
    FloatArray,
    Instrument,
    PointSet,
    Rig,
    TrackerSession,
    UncertainValue,
)
from tdfscal.simulation import faults, rotations
from tdfscal.simulation.options import Options, SurveyOptions, carriage_stiffness

# Half widths of ignorance: what "unknown" (std ∞) may mean on a real rig.
UNKNOWN_ZERO = 5.0  # N
UNKNOWN_MASS = 0.01  # of the value
UNKNOWN_BARYCENTRE = 5.0e-3  # m
UNKNOWN_TILT = 1.0e-3  # rad
UNKNOWN_HINGE = 1.0e-4  # m
UNKNOWN_SENSITIVITY = 0.01


@record
class Truth:
    """The rig as it is, or as a controller takes it to be; arrays may have leading axes (...).

    rotation : (..., n, 3, 3), X_i, sensor frame → BCS. rpy : (..., n, 3), rad.
    zero : (..., n, 3), N. sensitivity : (..., n, 3, 3), S of f = (I + S) XᵀF + z, symmetric.
    mass : (...,), kg. barycentre : (..., 3), m, LCS. hinge : (..., n, 3), m, LCS.
    datum : (..., n, 3), m: where a carriage stands, less its servo coordinates.
    gravity : (..., 3), m/s², BCS. stiffness : (..., n, 3, 3), N/m, BCS.
    """

    rotation: FloatArray
    rpy: FloatArray
    zero: FloatArray
    sensitivity: FloatArray
    mass: FloatArray
    barycentre: FloatArray
    hinge: FloatArray
    datum: FloatArray
    gravity: FloatArray
    stiffness: FloatArray

    def trial(self, index: int) -> Truth:
        """One trial of several."""
        return Truth(*(np.asarray(getattr(self, f.name)[index]) for f in fields(self)))


def width(std: float | FloatArray, unknown: float | FloatArray) -> FloatArray:
    """Standard deviation to draw with, where ∞ is unknown."""
    return np.where(np.isinf(std), unknown, std)


def draw_truths(rig: Rig, options: Options, rng: np.random.Generator, trials: int) -> Truth:
    """Truths of independent trials, leading axis (trials,).

    Every quantity is value + std · N(0, 1), independent; unknown ones (std ∞) with the widths
    above. Gravity is turned by rotation-vector components ~ N(0, tilt_std) about the BCS' x and
    y. All draws are made whatever the std, so that one seed gives comparable rigs.
    """
    n, declared = rig.n, rig.declared
    for name in ("positioner", "force_noise", "hinge_moment"):
        if not np.isfinite(getattr(declared, name)):
            raise RigError(
                "an infinite scatter cannot be simulated",
                where=f"uncertainty.{name}",
                hint="give a number",
            )
    unit = rng.standard_normal
    turn = width(rig.rpy_std, np.array(options.installation_std))
    rpy = rig.nominal_rpy + turn * unit((trials, n, 3))
    if options.rpy is not None:
        rpy = np.array(np.broadcast_to(options.rpy, (trials, n, 3)), dtype=np.float64)
    zero = rig.zero.value + width(rig.zero.std, UNKNOWN_ZERO) * unit((trials, n, 3))
    mass = rig.mass.value + width(rig.mass.std, UNKNOWN_MASS * rig.mass.value) * unit(trials)
    off = width(rig.barycentre.std, UNKNOWN_BARYCENTRE) * unit((trials, 3))
    hinge = rig.hinge + width(declared.hinge, UNKNOWN_HINGE) * unit((trials, n, 3))
    datum = width(declared.datum, UNKNOWN_HINGE) * unit((trials, n, 3))
    entries = width(declared.force_sensitivity, UNKNOWN_SENSITIVITY) * unit((trials, n, 3, 3))
    lean = np.zeros((trials, 3))
    lean[:, :2] = width(rig.gravity_tilt_std, UNKNOWN_TILT) * unit((trials, 2))
    return Truth(
        rotation=rotations.from_rpy(rpy),
        rpy=rpy,
        zero=zero,
        sensitivity=0.5 * (entries + np.swapaxes(entries, -1, -2))
        + faults.sensitivity(options.faults, n),
        mass=mass,
        barycentre=rig.barycentre.value + off,
        hinge=hinge,
        datum=datum,
        gravity=rotations.exp(lean) @ np.array([0.0, 0.0, -rig.gravity]),
        stiffness=np.array(
            np.broadcast_to(carriage_stiffness(rig, options), (trials, n, 3, 3)), dtype=np.float64
        ),
    )


def draw_inertia(rig: Rig, truth: Truth, rng: np.random.Generator) -> FloatArray:
    """Inertia about the LCS origin, (3, 3), kg m²: within what the rig states, or of a body.

    That has the hinges' radius of gyration over √2, and its barycentre off the origin.
    """
    draw = rng.standard_normal((3, 3))
    draw = (draw + draw.T) / 2
    if rig.inertia is not None and np.all(np.isfinite(rig.inertia.std)):
        return np.asarray(rig.inertia.value + rig.inertia.std * draw)
    size = 0.5 * float(truth.mass) * np.mean(np.sum(truth.hinge**2, axis=1))
    own = 0.5 * size * (np.diag([1.0, 1.1, 1.3]) + 0.05 * draw)
    return np.asarray(own + off_centre(truth))


def off_centre(truth: Truth) -> FloatArray:
    """What the inertia about the LCS origin is more than that about the barycentre."""
    r = truth.barycentre
    return np.asarray(truth.mass * (r @ r * np.eye(3) - np.outer(r, r)))


GRAVITY = 9.80665


def make_rig(
    n: int = 3,
    mass: float = 500.0,
    radius: float = 0.6,
    *,
    height: float = 0.25,
    mass_std: float = 0.2,
    barycentre_std: float = 1.0e-3,
    zero_std: float = 0.5,
    declared: DeclaredUncertainty | None = None,
    name: str | None = None,
) -> Rig:
    """A rig of n hinges, evenly spaced on a circle of `radius` (m) in the LCS' xy plane.

    mass in kg; the barycentre lies `height` (m) above the middle of the circle; zeros are 0 N.
    The std are standard uncertainties (∞: unknown). declared: default 10 µm repeatability, 20 µm
    hinges, 0.1 N.
    """
    angle = 2.0 * np.pi * np.arange(n) / n
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    hinge = np.round(radius * circle, 15) + 0.0  # −0.3, not −0.29999999999999993 or −0.0
    return Rig(
        name=name or f"{n} supports, {mass:g} kg",
        supports=tuple(f"ncp{i + 1}" for i in range(n)),
        gravity=GRAVITY,
        gravity_tilt_std=0.0,
        mass=UncertainValue(np.array(mass), np.array(mass_std)),
        barycentre=UncertainValue(np.array([0.0, 0.0, height]), np.full(3, barycentre_std)),
        inertia=None,
        hinge=hinge,
        zero=UncertainValue(np.zeros((n, 3)), np.full((n, 3), zero_std)),
        nominal_rpy=np.zeros((n, 3)),
        rpy_std=np.full((n, 3), np.inf),
        capacity=np.full((n, 3), np.inf),
        axes=np.ones((n, 3), dtype=np.bool_),
        declared=declared or DeclaredUncertainty(positioner=1.0e-5, hinge=2.0e-5, force_noise=0.1),
        acceptance=Acceptance(),
    )


def reference_rig() -> Rig:
    """Three hinges at 120° on 0.6 m, 500 ± 0.2 kg, barycentre (0, 0, 0.25) m ± 1 mm."""
    return make_rig(name="Reference rig")


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
