"""Noise of a survey's points by its sources: the spherical instrument (Eq. 25), files, rounding;
how large the noise of each really is, and what it does to the angles.

One factor on all residuals lets a fault of one source dilute in the others: a drawing that is off
enlarges the residuals of the targets and not those of the moves. Each source has a component of
its own therefore: a factor on the instrument's noise, which moves and targets share, and an
isotropic variance beyond the stated one of the servo coordinates and of the nominal points. Their
restricted likelihood, which knows the parameters that the fit has taken, is integrated over a
prior that gives each stated uncertainty even odds to be right (Searle, Casella, McCulloch:
Variance Components, 1992, chapter 9). Distributions are propagated by trials (JCGM 101), in
batches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, MonteCarlo, propagate
from tdfscal.numerics.rotation_fits import align
from tdfscal.records import FloatArray, Instrument, IntArray, PointSet
from tdfscal.significance import INTERVAL_COVERAGE, NOISE_UNDERSTATED, STATED_NOISE_RIGHT
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
#: Factors on the instrument's standard uncertainty; the first says that it is as stated.
_FACTORS = np.concatenate([[1.0], np.geomspace(1.1, 60.0, 20)])
#: Standard deviations beyond the stated, over the typical one of the survey's coordinates.
_EXCESS = np.concatenate([[0.0], np.geomspace(0.25, 60.0, 20)])
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
        return Noise(
            {name: cov[which] for name, cov in self.measured.items()},
            {name: cov[which] for name, cov in self.reference.items()},
        )


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


@record
class Components:
    """Noise of each source, as the residuals and the statement together have it.

    instrument : factor on its standard uncertainties. positioner, drawing : m per coordinate,
    standard uncertainty beyond the stated one. understated : the sources whose statement
    the residuals make improbable.
    """

    instrument: float
    positioner: float
    drawing: float
    understated: tuple[Finding, ...]

    def scaled(self, instrument: Instrument) -> Instrument:
        """The instrument with the noise that it shows."""
        return Instrument(*(self.instrument * stated for stated in astuple(instrument)))

    def enlarged(self, noise: Noise, source: str) -> Noise:
        """Noise with these components; source : of the reference points' excess."""
        excess = {"positioner": self.positioner, "drawing": self.drawing}[source]
        count = len(next(iter([*noise.measured.values(), *noise.reference.values()])))
        stated = noise.reference.get(source, np.zeros((count, 3, 3)))
        return Noise(
            {name: self.instrument**2 * cov for name, cov in noise.measured.items()},
            {**noise.reference, source: stated + excess**2 * np.eye(3)},
        )


def estimate_components(moves: SurveyFit, targets: Sequence[SurveyFit]) -> Components:
    """Posterior means of the components' variances, given the residuals of moves and targets.

    These are registered with the noise as stated; no source is ever made better than that.
    """
    of_moves, unit_moves = _likelihood([moves])
    of_targets, unit_targets = _likelihood(targets)
    by_factor, by_excess = _log_prior(np.sqrt(_FACTORS**2 - 1)), _log_prior(_EXCESS)
    log_p = (of_moves + by_factor[:, None] + by_excess)[:, :, None]
    log_p = log_p + (of_targets + by_excess)[:, None, :]
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    parts = [p.sum(axis=other) for other in ((1, 2), (0, 2), (0, 1))]
    factor, servo, drawn = (
        float(np.sqrt(part @ values**2))
        for part, values in zip(parts, (_FACTORS, _EXCESS, _EXCESS), strict=True)
    )
    servo, drawn = servo * unit_moves, drawn * unit_targets
    found = (
        Finding("instrument-understated", size=factor),
        Finding("positioners-understated", size=servo, unit="m"),
        Finding("drawing-understated", size=drawn, unit="m"),
    )
    shown = [bool(part[0] < NOISE_UNDERSTATED) for part in parts]
    return Components(factor, servo, drawn, tuple(compress(found, shown)))


def _log_prior(ratio: FloatArray) -> FloatArray:
    """Log-weights of excess noise over the stated one: as stated, else half-Cauchy (Gelman 2006).

    ratio : of standard deviations, 0 first, then in geometric steps.
    """
    weight = np.zeros(len(ratio))
    weight[1:] = ratio[1:] / (1 + ratio[1:] ** 2)
    weight *= (1 - STATED_NOISE_RIGHT) / weight.sum()
    weight[0] = STATED_NOISE_RIGHT
    return np.asarray(np.log(weight))


def _likelihood(surveys: Sequence[SurveyFit]) -> tuple[FloatArray, float]:
    """Restricted log-likelihood (factors, excesses), and the unit of an excess, m."""
    variances = [np.trace(sum(s.noise.totals(len(s.points))), axis1=1, axis2=2) for s in surveys]
    unit = float(np.sqrt(np.concatenate(variances).mean() / 3))
    total = np.zeros((len(_FACTORS), len(_EXCESS)))
    for survey in surveys:
        seen, known = survey.noise.totals(len(survey.points))
        known = survey.fit.rotation @ known @ survey.fit.rotation.T
        J = survey.fit.jacobian
        # Orthonormal columns span the same parameters: metres away they would be all but parallel.
        J = np.linalg.qr(J.reshape(-1, J.shape[-1]))[0].reshape(J.shape)
        for a, factor in enumerate(_FACTORS):
            S = factor**2 * seen + known
            S = S + (_EXCESS * unit)[:, None, None, None] ** 2 * np.eye(3)  # (excess, N, 3, 3)
            total[a] += _restricted(S, J, survey.fit.residual)
    return total, unit


def _restricted(S: FloatArray, J: FloatArray, e: FloatArray) -> FloatArray:
    """Restricted log-likelihoods (b,) of residuals e (N, 3) with covariances S (b, N, 3, 3)."""
    W = np.linalg.inv(S)
    WJ = W @ J
    normal = np.einsum("nip,bniq->bpq", J, WJ)
    score = np.einsum("bnip,ni->bp", WJ, e)
    explained = np.einsum("bp,bp->b", score, np.linalg.solve(normal, score[..., None])[..., 0])
    chi2 = np.einsum("ni,bnij,nj->b", e, W, e) - explained
    volume = np.linalg.slogdet(S)[1].sum(axis=1) + np.linalg.slogdet(normal)[1]
    return np.asarray(-0.5 * (chi2 + volume))


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
    to_rpy = so3.rpy_jacobian(estimate) @ moves.fit.rotation.T
    linear = []

    def batch(size: int) -> FloatArray:
        R_b, b = _draw(moves, instrument, rng, size)
        draws = [_draw(t, instrument, rng, size) for t in targets]
        R_s, s = (np.stack(drawn, axis=1) for drawn in zip(*draws, strict=True))
        tilt = misalignment * rng.standard_normal((size, len(targets), 3))
        d = s - b[:, None] + tilt @ moves.fit.rotation.T
        linear.append(np.einsum("nij,tnj->tni", to_rpy, d))
        X = so3.exp(tilt) @ np.swapaxes(R_b, -1, -2)[:, None] @ R_s
        return so3.deviations(X, estimate)

    def draw(size: int) -> FloatArray:
        return np.concatenate([batch(min(_BATCH, size - k)) for k in range(0, size, _BATCH)])

    found = propagate(draw, rpy_std, INTERVAL_COVERAGE, trials)
    half = INTERVAL_FACTOR * rpy_std
    # The linear estimate of the same draws serves as control variate: its ends are known exactly,
    # and the scatter of finitely many trials drops out of the difference.
    same_draws = np.concatenate(linear)
    tails = [(1 - INTERVAL_COVERAGE) / 2, (1 + INTERVAL_COVERAGE) / 2]
    low, high = np.quantile(same_draws, tails, axis=0)
    scatter = np.abs(same_draws.std(axis=0) / rpy_std - 1)
    consistent = bool(np.all(scatter < 5 / np.sqrt(2 * found.trials)))
    return replace(
        found.about(so3.to_rpy(estimate), half),
        validated=consistent and found.validates(low, high),
    )


def _draw(
    survey: SurveyFit, instrument: Instrument, rng: np.random.Generator, count: int
) -> tuple[FloatArray, FloatArray]:
    """Rotations (count, 3, 3) of perturbed points, and their linear perturbations (count, 3)."""
    fit, noise = survey.fit, survey.noise
    x = fit.adjusted
    y = x @ fit.rotation.T + fit.translation[survey.group]
    shape = (count, len(x), 3)
    none = np.zeros((len(x), 3, 3))
    by_instrument = sum((noise.measured.get(source, none) for source in INSTRUMENT), none)
    others = sum((cov for s, cov in noise.measured.items() if s not in INSTRUMENT), none)
    sighted = np.any(by_instrument, axis=(1, 2))[:, None]
    seen = np.where(sighted, observe(y, instrument, rng, count), y)
    seen = seen + rng.standard_normal(shape) * np.sqrt(np.diagonal(others, axis1=1, axis2=2))
    C, D = noise.totals(len(x))
    known = x + rng.standard_normal(shape) * np.sqrt(np.diagonal(D, axis1=1, axis2=2))
    start = np.broadcast_to(fit.rotation, (count, 3, 3))
    rotation = align(seen, known, C, D, survey.group, start=start).rotation
    error = seen - y - (known - x) @ fit.rotation.T
    return rotation, np.einsum("pnj,tnj->tp", fit.gain[:3], error)
