"""Noise of a survey's points by its sources: the spherical instrument (Eq. 25), files, rounding;
what it does to the angles, by trials (JCGM 101).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tdfscal.errors import DataError
from tdfscal.estimation.uncertainty import simulate_angles
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, MonteCarlo
from tdfscal.numerics.rotation_fits import align
from tdfscal.records import FloatArray, Instrument, IntArray, PointSet
from tdfscal.trackercal.point_matching import MatchedPoints

if TYPE_CHECKING:
    from tdfscal.trackercal.judged_registration import SurveyFit

#: Sources of noise by their names in the budget.
INSTRUMENT = ("instrument range", "instrument angles")
MEASURED_FILE, REFERENCE_FILE = "measured points' file", "reference points' file"
_LAST_DIGIT = "last digit of the coordinates"
#: rad per second of arc.
ARCSEC = np.pi / 648_000
#: Standard uncertainty of a number that is rounded, over the worth of its last digit.
_ROUNDING = 1 / np.sqrt(12)
#: m; no instrument resolves less of a coordinate, whatever digits a file writes.
_FINEST = 1e-9
#: Trials that are made at once.
_BATCH = 500


def range_covariance(xyz: FloatArray, instrument: Instrument) -> FloatArray:
    """Covariance (N, 3, 3), m², of points xyz (N, 3), m, in the tracker's frame, by its range."""
    r, along = _range(xyz)
    sigma = instrument.range + instrument.range_ppm * 1e-6 * r
    return np.asarray((sigma**2)[:, None, None] * along[:, :, None] * along[:, None, :])


def angle_covariance(xyz: FloatArray, instrument: Instrument) -> FloatArray:
    """Covariance (N, 3, 3), m², of points xyz (N, 3), m, in the tracker's frame, by its angles.

    Eq. 25: x = r sinφ cosθ, y = r sinφ sinθ, z = r cosφ, with σ_θ = σ_φ. An azimuth error moves
    the point by r sinφ σ_θ only; its second-order part, r cosφ σ_φ σ_θ, keeps the covariance
    regular at the zenith.
    """
    r, along = _range(xyz)
    sigma = instrument.angle_arcsec * ARCSEC
    sin, cos = np.hypot(along[:, 0], along[:, 1]), along[:, 2]
    theta = np.arctan2(along[:, 1], along[:, 0])
    zero = np.zeros_like(theta)
    u_theta = np.stack([-np.sin(theta), np.cos(theta), zero], axis=1)
    u_phi = np.stack([cos * np.cos(theta), cos * np.sin(theta), -sin], axis=1)
    by_theta = (r * sigma) ** 2 * (sin**2 + (cos * sigma) ** 2)
    by_phi = (r * sigma) ** 2
    return np.asarray(
        by_theta[:, None, None] * u_theta[:, :, None] * u_theta[:, None, :]
        + by_phi[:, None, None] * u_phi[:, :, None] * u_phi[:, None, :]
    )


def observe(
    xyz: FloatArray, instrument: Instrument, rng: np.random.Generator, trials: int
) -> FloatArray:
    """Draw `trials` observations (trials, N, 3), m, of points xyz (N, 3) through Eq. 25."""
    r, along = _range(xyz)
    draw = rng.standard_normal((3, trials, len(xyz)))
    sigma = instrument.angle_arcsec * ARCSEC
    r = r + (instrument.range + instrument.range_ppm * 1e-6 * r) * draw[0]
    theta = np.arctan2(along[:, 1], along[:, 0]) + sigma * draw[1]
    phi = np.arccos(np.clip(along[:, 2], -1, 1)) + sigma * draw[2]
    flat = r * np.sin(phi)
    return np.stack([flat * np.cos(theta), flat * np.sin(theta), r * np.cos(phi)], axis=-1)


def _range(xyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    r = np.linalg.norm(xyz, axis=1)
    if np.any(r == 0):
        raise DataError(Finding("points-at-instrument"))
    return r, xyz / r[:, None]


@record
class Noise:
    """Covariances of N matched points by their source.

    measured : source → (N, 3, 3), m², in the measured frame. reference : the same of the
    reference points, in theirs.
    """

    measured: Mapping[str, FloatArray]
    reference: Mapping[str, FloatArray]

    def totals(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Sum over the sources, (N, 3, 3) each."""
        zero = np.zeros((count, 3, 3))
        return sum(self.measured.values(), zero), sum(self.reference.values(), zero)

    def take(self, which: IntArray) -> Noise:
        """The points with these indices only."""
        return Noise(*({name: cov[which] for name, cov in of.items()} for of in self._sides))

    def scaled(self, factor: float) -> Noise:
        """Standard uncertainties so many times as large."""
        return Noise(*({n: factor**2 * cov for n, cov in of.items()} for of in self._sides))

    @property
    def _sides(self) -> tuple[Mapping[str, FloatArray], Mapping[str, FloatArray]]:
        return self.measured, self.reference


def point_noise(
    points: MatchedPoints, instrument: Instrument | None, reference: Mapping[str, float]
) -> Noise:
    """Covariances of matched points: the files' or the instrument's, isotropic ones, rounding.

    reference : source → m, standard uncertainty per coordinate of the reference points. What a
    file states of a point stands in the place of both; a point of which it states none has the
    instrument's or, without one, the largest that the file states.
    """
    seen = {}
    std = points.measured.std
    if instrument is not None and (std is None or np.isnan(std).any()):
        seen[INSTRUMENT[0]] = range_covariance(points.measured.xyz, instrument)
        seen[INSTRUMENT[1]] = angle_covariance(points.measured.xyz, instrument)
    stated = np.ones((len(points), 1, 1)) * np.eye(3)
    known = {name: size**2 * stated for name, size in reference.items() if size > 0}
    measured = _beside_file(points.measured, seen, MEASURED_FILE)
    isotropic = _beside_file(points.reference, known, REFERENCE_FILE)
    # Where nothing is stated the residuals show the rounding among the rest. A stated uncertainty
    # of the reference points is that of the points themselves: it covers how they are written.
    if (measured or isotropic) and points.measured.resolution > 0:
        measured[_LAST_DIGIT] = (points.measured.resolution * _ROUNDING) ** 2 * stated
    if measured and not isotropic and points.reference.resolution > 0:
        isotropic[_LAST_DIGIT] = (points.reference.resolution * _ROUNDING) ** 2 * stated
    return Noise(measured, isotropic)


def _beside_file(
    points: PointSet, known: Mapping[str, FloatArray], file: str
) -> dict[str, FloatArray]:
    """Covariances by source: what a file states of its points, in the place of what is known."""
    std = np.full_like(points.xyz, np.nan) if points.std is None else points.std
    given = np.isfinite(std)
    by_file = np.all(given, axis=1, keepdims=True)
    found = {}
    if not by_file.all():
        found = {name: np.where(by_file[..., None], 0.0, cov) for name, cov in known.items()}
    if by_file.any():
        own = np.where(given, std, 0.0 if known else np.nanmax(std, axis=0))
        found[file] = own[:, :, None] ** 2 * np.eye(3)
    return found


def least_noise(points: MatchedPoints) -> float:
    """Noise per coordinate that residuals show at least, m: of the digits."""
    resolution = [points.measured.resolution, points.reference.resolution]
    return max(float(_FINEST), float(_ROUNDING * np.linalg.norm(resolution)))


def simulate_inputs(
    moves: SurveyFit,
    targets: Sequence[SurveyFit],
    instrument: Instrument,
    misalignment: float,
    rpy_std: FloatArray,
    *,
    trials: int,
    rng: np.random.Generator,
) -> MonteCarlo:
    """Draw all inputs about the estimate, register again, and compare with the linear interval.

    rpy_std : (n, 3), rad, linear standard uncertainty. trials : at most.
    """
    estimate = np.stack([moves.fit.rotation.T @ t.fit.rotation for t in targets])

    def draw(size: int) -> FloatArray:
        R_b = _draw(moves, instrument, rng, size)
        R_s = np.stack([_draw(t, instrument, rng, size) for t in targets], axis=1)
        tilt = misalignment * rng.standard_normal((size, len(targets), 3))
        return np.asarray(so3.exp(tilt) @ np.swapaxes(R_b, -1, -2)[:, None] @ R_s)

    known = np.ones(len(targets), dtype=np.bool_)
    return simulate_angles(draw, estimate, rpy_std, INTERVAL_FACTOR, known, trials, chunk=_BATCH)


def _draw(
    survey: SurveyFit, instrument: Instrument, rng: np.random.Generator, count: int
) -> FloatArray:
    """Rotations (count, 3, 3) of perturbed points."""
    fit, noise, x = survey.fit, survey.noise, survey.fit.adjusted
    y = x @ fit.rotation.T + fit.translation[survey.group]
    shape, none = (count, len(x), 3), np.zeros((len(x), 3, 3))
    by_instrument = sum((noise.measured.get(source, none) for source in INSTRUMENT), none)
    others = sum((cov for s, cov in noise.measured.items() if s not in INSTRUMENT), none)
    sighted = np.any(by_instrument, axis=(1, 2))[:, None]
    off = survey.scale * (observe(y, instrument, rng, count) - y)
    seen = np.where(sighted, y + off, y)
    seen = seen + rng.standard_normal(shape) * np.sqrt(np.diagonal(others, axis1=1, axis2=2))
    C, D = noise.totals(len(x))
    known = x + rng.standard_normal(shape) * np.sqrt(np.diagonal(D, axis1=1, axis2=2))
    start = np.broadcast_to(fit.rotation, (count, 3, 3))
    return np.asarray(align(seen, known, C, D, survey.group, start=start).rotation)
