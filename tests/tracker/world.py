"""A surveyed rig with a known truth; shares nothing with the estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

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

PAPER = Instrument(range=10e-6, range_ppm=5.0, angle_arcsec=2.0)
SQUARE = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 2
TRIPOD = SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0.1, 0, 0.4]])


def sight(rng: np.random.Generator, xyz: FloatArray, tracker: Instrument = PAPER) -> FloatArray:
    """What a spherical instrument in the origin reads for the points (N, 3)."""
    seen = []
    arcsec = np.deg2rad(1 / 3600)
    for x, y, z in xyz:
        distance = float(np.sqrt(x * x + y * y + z * z))
        azimuth, zenith = np.arctan2(y, x), np.arccos(z / distance)
        azimuth += rng.normal() * tracker.angle_arcsec * arcsec
        zenith += rng.normal() * tracker.angle_arcsec * arcsec
        distance += rng.normal() * (tracker.range + tracker.range_ppm * 1e-6 * distance)
        level = distance * np.sin(zenith)
        seen.append([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.cos(zenith)])
    return np.array(seen)


def rotation(rng: np.random.Generator) -> FloatArray:
    """Any rotation."""
    return np.asarray(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix())


def points(
    groups: list[str], labels: list[str], xyz: FloatArray, std: FloatArray | None = None
) -> PointSet:
    return PointSet(
        tuple(groups), tuple(labels), np.asarray(xyz, dtype=np.float64), std, "file.csv"
    )


def make_rig(n: int = 3, positioner: float = 10e-6) -> Rig:
    turn = 2 * np.pi * np.arange(n) / n
    return Rig(
        name="survey",
        supports=tuple(f"ncp{i + 1}" for i in range(n)),
        gravity=9.80665,
        gravity_tilt_std=0.0,
        mass=UncertainValue(np.array(500.0), np.array(0.0)),
        barycentre=UncertainValue(np.zeros(3), np.zeros(3)),
        inertia=None,
        hinge=0.6 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1),
        zero=UncertainValue(np.zeros((n, 3)), np.zeros((n, 3))),
        nominal_rpy=np.zeros((n, 3)),
        rpy_std=np.full((n, 3), np.inf),
        capacity=np.full((n, 3), np.inf),
        axes=np.ones((n, 3), dtype=np.bool_),
        declared=DeclaredUncertainty(positioner=positioner),
        acceptance=Acceptance(),
    )


@dataclass(frozen=True)
class Survey:
    """A rig, what was measured on it, and the true X (n, 3, 3) and R_b^m (3, 3)."""

    rig: Rig
    session: TrackerSession
    X: FloatArray
    tracker: FloatArray

    def with_session(self, **changes: object) -> Survey:
        return replace(self, session=replace(self.session, **changes))  # type: ignore[arg-type]


def make_survey(
    seed: int,
    *,
    n: int = 3,
    distance: float = 5.0,
    spacing: float = 0.1,
    layout: FloatArray = TRIPOD,
    moves: int = 10,
    travel: float = 0.4,
    positioner: float = 10e-6,
    drawing: float = 0.0,
    tracker: Instrument = PAPER,
    angles: float = 0.05,
    skew: dict[str, FloatArray] | None = None,
    misalignment: float = 0.0,
) -> Survey:
    """Survey a rig whose middle lies `distance` from the tracker.

    skew : support → (3, 3), the linear map that its axes really make of servo coordinates.
    misalignment : rad, scatter per axis of the sensing axes against the body that is measured.
    """
    rng = np.random.default_rng(seed)
    rig = make_rig(n, positioner)
    R = Rotation.from_euler("ZYX", [rng.uniform(-3, 3), *rng.normal(size=2) * 0.02]).as_matrix()
    bearing = rng.uniform(-3, 3)
    level = 0.1 * distance
    T = np.array([distance * np.cos(bearing), distance * np.sin(bearing), -level])
    X, nominal, seen, servo, carried = [], [], [], [], []
    for i, name in enumerate(rig.supports):
        centre = rig.hinge[i]
        X.append(Rotation.from_euler("ZYX", angles * rng.normal(size=3)).as_matrix())
        body = Rotation.from_rotvec(misalignment * rng.normal(size=3)).as_matrix() @ X[-1]
        drawn = layout * spacing
        made = drawn + drawing * rng.normal(size=drawn.shape)
        nominal.append(drawn)
        seen.append(sight(rng, (made @ body.T + centre + [0, 0, 0.1]) @ R.T + T, tracker))
        commanded = centre + rng.uniform(-travel / 2, travel / 2, size=(moves, 3))
        reached = commanded - centre
        if skew and name in skew:
            reached = reached @ skew[name].T
        reached = reached + centre + positioner * rng.normal(size=(moves, 3))
        servo.append(commanded)
        carried.append(sight(rng, (reached + np.array([0.05, 0.02, 0.08])) @ R.T + T, tracker))
    target_names = [f"P{j + 1}" for j in range(len(layout))] * n
    move_names = [f"M{j + 1}" for j in range(moves)] * n
    target_groups = [name for name in rig.supports for _ in layout]
    move_groups = [name for name in rig.supports for _ in range(moves)]
    session = TrackerSession(
        instrument=tracker,
        drawing=drawing,
        nominal=points(target_groups, target_names, np.concatenate(nominal)),
        targets=points(target_groups, target_names, np.concatenate(seen)),
        servo=points(move_groups, move_names, np.concatenate(servo)),
        moves=points(move_groups, move_names, np.concatenate(carried)),
    )
    return Survey(rig, session, np.stack(X), R)


def error_vector(truth: FloatArray, estimate: FloatArray) -> FloatArray:
    """Rotation vectors (3n,), rad, with truth = exp([d]×) estimate."""
    turns = truth @ np.swapaxes(estimate, -1, -2)
    return np.asarray(Rotation.from_matrix(turns).as_rotvec()).reshape(-1)


def squared(error: FloatArray, covariance: FloatArray) -> float:
    """Squared distance of an error, in its covariance."""
    return float(error @ np.linalg.solve(covariance, error))


def chi2_bounds(dof: int, tail: float = 1e-4) -> tuple[float, float]:
    """Interval that χ² leaves on either side with probability `tail`."""
    from scipy.special import chdtri

    return float(chdtri(dof, 1 - tail)), float(chdtri(dof, tail))
