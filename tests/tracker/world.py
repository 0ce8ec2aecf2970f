"""Surveys of the simulator by one line each, and the distance of what is made of them."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdfscal import simulation
from tdfscal.records import (
    DeclaredUncertainty,
    FloatArray,
    Instrument,
    PointSet,
    Rig,
    TrackerSession,
)
from tdfscal.simulation import Options, SurveyOptions, draw_truths, simulate_survey

PAPER = Instrument(range=10e-6, range_ppm=5.0, angle_arcsec=2.0)
SQUARE = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 2
TRIPOD = SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0.1, 0, 0.4]])


def rotation(rng: np.random.Generator) -> FloatArray:
    """Any rotation."""
    return np.asarray(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix())


def points(
    groups: list[str], labels: list[str], xyz: FloatArray, std: FloatArray | None = None
) -> PointSet:
    return PointSet(
        tuple(groups), tuple(labels), np.asarray(xyz, dtype=np.float64), std, "file.csv"
    )


@dataclass(frozen=True)
class Survey:
    """A rig, what was measured on it, and the true X (n, 3, 3) and R_b^m (3, 3)."""

    rig: Rig
    session: TrackerSession
    X: FloatArray
    tracker: FloatArray

    def with_session(self, **changes: object) -> "Survey":
        return replace(self, session=replace(self.session, **changes))  # type: ignore[arg-type]


def make_survey(
    seed: int,
    *,
    n: int = 3,
    distance: float = 5.0,
    layout: FloatArray = 0.1 * TRIPOD,
    moves: int = 10,
    travel: float = 0.2,
    positioner: float = 10e-6,
    drawing: float = 0.0,
    tracker: Instrument = PAPER,
    angles: float = 0.05,
    misalignment: float = 0.0,
) -> Survey:
    """Survey a rig whose sensors are turned by `angles`, rad, per axis; layout: of targets, m."""
    rng = np.random.default_rng(seed)
    rig = simulation.make_rig(n, declared=DeclaredUncertainty(positioner=positioner))
    truth = draw_truths(rig, Options(rpy=angles * rng.normal(size=(n, 3))), rng, 1).trial(0)
    options = SurveyOptions(
        tracker, distance, tuple(map(tuple, layout)), drawing, moves, travel, misalignment
    )
    played = simulate_survey(rig, truth, options, rng)
    return Survey(rig, played.session, truth.rotation, played.rotation)


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
