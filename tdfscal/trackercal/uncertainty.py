"""How large the noise of each source of a survey really is, and what it does to the angles.

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

from collections.abc import Sequence
from dataclasses import astuple
from itertools import compress

import numpy as np

from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, MonteCarlo, propagate
from tdfscal.numerics.rotation_fits import align
from tdfscal.records import FloatArray, Instrument
from tdfscal.significance import INTERVAL_COVERAGE, NOISE_UNDERSTATED, STATED_NOISE_RIGHT
from tdfscal.trackercal.judged_registration import SurveyFit
from tdfscal.trackercal.noise import INSTRUMENT, Noise, observe

#: Factors on the instrument's standard uncertainty; the first says that it is as stated.
_FACTORS = np.concatenate([[1.0], np.geomspace(1.1, 60.0, 20)])
#: Standard deviations beyond the stated, over the typical one of the survey's coordinates.
_EXCESS = np.concatenate([[0.0], np.geomspace(0.25, 60.0, 20)])


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


_BATCH = 500


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
