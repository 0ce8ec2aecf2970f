"""From a fit to its covariance, the share of each source, and honest intervals (theory, 5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

import numpy as np

from tdfscal.estimation.fit import Fitted, information
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated, with_rotations
from tdfscal.model.parameters import EVEN_TURN, layout, parameter_count, retract, with_motions
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo, chi2_sf, coverage_factor, propagate
from tdfscal.numerics.least_squares import Spectrum, covariance_root
from tdfscal.records import BoolArray, FloatArray, JointPrior
from tdfscal.significance import INTERVAL_COVERAGE

F = TypeVar("F", bound=Fitted)

#: What earlier campaigns contribute; their covariance is not scaled yet.
EARLIER = "earlier campaigns"
#: What the rig file lacks, where it is suspected and the result accepted.
UNDECLARED = "undeclared error"
#: Sources of the budget that average out over postures; the Birge ratio scales these.
NOISE = ("noise", "positioner", "hinge friction", EARLIER)
#: Parameter groups by their name in the budget.
PRIORS = {
    "zero": "zero",
    "sensitivity": "sensitivity",
    "mass": "mass",
    "barycentre": "barycentre",
    "hinge": "hinge",
    "datum": "datum",
    "tilt": "gravity",
    "compliance": "compliance",
    "friction": "hinge hysteresis",
    "drift": "drift",
    "rotation": "prior angles",
}
#: Of the parameters that only motion has.
MOTION = "motion"
#: A share of a null vector below this is rounding.
_ROUNDING = 1e-6
#: A share of noise in a variance below this leaves as good as infinite degrees of freedom.
_NO_SHARE = 1e-9


@record
class Quality:
    """How well residuals and stated uncertainties agree.

    chi2 with dof degrees of freedom; p_value that chance alone gives more. birge = √(χ²/dof), of
    all campaigns where the estimate stands on earlier ones.
    rms_force (N), rms_moment (N·m, about the barycentre): quadratic mean over the postures of
    the length of the residual.
    """

    chi2: float
    dof: int
    p_value: float
    birge: float
    rms_force: float
    rms_moment: float


@record
class Uncertainty:
    """Covariance of the rotations and its parts.

    covariance : (3n, 3n), rad², of left perturbations in the BCS. rpy_covariance : (n, 3, 3),
    rad². contributions : source → (n, 3), variance of roll, pitch, yaw, rad²; they sum to the
    diagonal of rpy_covariance. parameter_std : (P,), 0 where known exactly, ∞ where undetermined.
    coverage_factor : (n, 3), for 95 % (GUM, annex G).
    """

    covariance: FloatArray
    rpy_covariance: FloatArray
    contributions: dict[str, FloatArray]
    parameter_std: FloatArray
    coverage_factor: FloatArray

    @property
    def rpy_std(self) -> FloatArray:
        """Standard uncertainty of roll, pitch, yaw (n, 3), rad."""
        return np.sqrt(np.diagonal(self.rpy_covariance, axis1=1, axis2=2))


@record
class Estimate(Generic[F]):
    """A fit and what is known of it before it is doubted.

    parts : its whitened Jacobian, decomposed. shares : source → (p, p), covariance of the free
    parameters by it, noise as it is stated.
    """

    fit: F
    parts: Spectrum
    quality: Quality
    shares: dict[str, FloatArray]
    uncertainty: Uncertainty

    @property
    def calibrated(self) -> Calibrated:
        """All parameters of the rig with their joint covariance, for those who use them."""
        return self.calibrated_at(self.uncertainty.covariance)

    def calibrated_at(
        self, rotation_covariance: FloatArray, rotation: FloatArray | None = None
    ) -> Calibrated:
        """The same with the rotations as published.

        rotation_covariance : (3n, 3n), rad²; it may differ from the fit's own (χ², noise that
        fakes information, a tracker's share). rotation : (n, 3, 3), where it is not the fit's. The
        other parameters keep their distribution given the rotations. Combinations that no row sees
        (theory, section 4) carry no variance: they do not show in any contact wrench at rest
        either.
        """
        of, posterior = self.fit, _summed(self.shares)
        size, turns = parameter_count(of.rig.n), 3 * of.rig.n
        # How zeros moved, and what only motion has, belongs to this campaign alone.
        free = np.flatnonzero(of.active)
        full = np.zeros((len(of.active),) * 2)
        full[np.ix_(free, free)] = posterior
        full, state = full[:size, :size], with_motions(of.still, 0)
        if rotation is not None:
            turn = so3.log(rotation @ np.swapaxes(state.rotation, 1, 2)).ravel()
            along = np.linalg.solve(full[:turns, :turns], turn)
            state = replace(retract(state, full[:, :turns] @ along), rotation=rotation)
        return Calibrated(
            rig=of.rig,
            state=state,
            covariance=with_rotations(full, turns, rotation_covariance),
            open=np.zeros(size, dtype=np.bool_),
            joint=True,
        )


def quality(of: Fitted, parts: Spectrum) -> Quality:
    """χ² of a fit against the stated uncertainties; parts : of its Jacobian."""
    dof = of.rows + len(of.prior_jacobian) - len(parts.values)
    total, all_dof, earlier = of.cost, dof, of.rig.earlier
    if earlier is not None:
        total, all_dof = total + earlier.chi2, all_dof + earlier.dof
    rms_force, rms_moment = of.rms
    return Quality(
        chi2=of.cost,
        dof=dof,
        p_value=float(chi2_sf(of.cost, dof)),
        birge=float(np.sqrt(total / all_dof)) if all_dof > 0 else 1.0,
        rms_force=rms_force,
        rms_moment=rms_moment,
    )


def estimate(of: F) -> Estimate[F]:
    """Judge a fit by its own residuals; see `evaluate`."""
    parts = information(of)
    return evaluate(of, parts, quality(of, parts))


def evaluate(of: F, parts: Spectrum, stats: Quality) -> Estimate[F]:
    """Posterior covariance, budget and coverage factors of a fit; parts : of its Jacobian."""
    C = parts.root @ parts.root.T  # pseudo-inverse of the information
    shares = of.noise_shares(C) | prior_shares(of, C[: int(of.active.sum())])
    return _of_shares(of, parts, stats, shares)


def beside(known: Estimate[F], undeclared: FloatArray) -> Estimate[F]:
    """The same with a covariance (p, p) of the free parameters by what the rig file may lack."""
    shares = known.shares | {UNDECLARED: undeclared}
    return _of_shares(known.fit, known.parts, known.quality, shares)


def _summed(shares: Mapping[str, FloatArray]) -> FloatArray:
    return np.asarray(np.sum(list(shares.values()), axis=0))


def _of_shares(
    of: F, parts: Spectrum, stats: Quality, shares: dict[str, FloatArray]
) -> Estimate[F]:
    """All shares together; only the noise has finite degrees (Welch–Satterthwaite, GUM, G.4.1)."""
    R, turns = of.still.rotation, slice(3 * of.rig.n)
    scale, noise_dof = of.noise_scale(stats.birge, stats.dof)
    own = {
        name: share[turns, turns] * (scale if name in NOISE else 1.0)
        for name, share in shares.items()
    }
    linear = _summed(own)
    covariance = without_faked(linear, of.faked_information(), blind_turns(parts, turns.stop))
    own["noise"] = own["noise"] + (covariance - linear)  # its loss is the noise's
    contributions = {name: so3.rpy_variance(R, share) for name, share in own.items()}
    total = _summed(contributions)
    noise = np.sum([contributions[name] for name in NOISE if name in contributions], axis=0)
    share = np.maximum(noise / np.maximum(total, np.finfo(float).tiny), _NO_SHARE)
    uncertainty = Uncertainty(
        covariance=covariance,
        rpy_covariance=so3.rpy_covariance(R, covariance),
        contributions=contributions,
        parameter_std=parameter_std(of.active, _summed(shares), parts),
        coverage_factor=coverage_factor(INTERVAL_COVERAGE, noise_dof / share**2),
    )
    return Estimate(of, parts, stats, shares, uncertainty)


def prior_shares(of: Fitted, posterior: FloatArray) -> dict[str, FloatArray]:
    """Covariance (p, p) by earlier campaigns, and by the priors of groups of parameters.

    posterior : (p, c), of the free parameters with all that the prior rows (m₀, c) are by.
    """
    places = layout(of.rig.n, of.still.motions)
    groups = {PRIORS[group]: place for group, place in places.items()}
    groups[MOTION] = slice(places["drift"].stop, len(of.active))
    columns, still = np.flatnonzero(of.active), of.stated.count
    before, common, after = np.split(of.prior_jacobian, [still - of.stated.common, still])
    own, by = np.concatenate([before, after]), {EARLIER: common}
    for name, place in groups.items():
        inside = np.flatnonzero((columns >= place.start) & (columns < place.stop))
        by[name] = own[np.abs(own[:, inside]).any(axis=1)]
    if not len(columns) or columns[-1] < groups[MOTION].start:
        del by[MOTION]
    halves = {name: posterior @ part.T for name, part in by.items()}
    return {name: half @ half.T for name, half in halves.items()}


def with_sources_of_earlier(
    contributions: Mapping[str, FloatArray], earlier: JointPrior | None
) -> dict[str, FloatArray]:
    """Variances (n, 3) by source, that of earlier campaigns by the sources that these had."""
    found = dict(contributions)
    if earlier is None or not earlier.sources or EARLIER not in found:
        return found
    whole = found.pop(EARLIER)
    for name, share in earlier.sources.items():
        found[name] = found.get(name, 0.0) + share * whole
    return found


def blind_turns(parts: Spectrum, count: int) -> FloatArray:
    """Turns (r, count) in rad that no row sees, longest component 1, from the null space."""
    null = parts.null[:, :count]
    null = null[np.abs(null).max(axis=1, initial=0.0) > _ROUNDING] / parts.scale[:count]
    return np.asarray(null / np.abs(null).max(axis=1, initial=0.0, keepdims=True))


def without_faked(covariance: FloatArray, faked: FloatArray, blind: FloatArray) -> FloatArray:
    """Covariance (3n, 3n) without the faked information N, and with the unseen turns.

    With Λ = C⁻¹ the true information is Λ − N, while the score's variance is at most Λ, hence
    C' = (Λ − N)⁻¹ Λ (Λ − N)⁻¹. Where noise fakes all there is (μ ≥ 1), and along blind turns,
    nothing is known; but no turn is less known than one spread evenly over the circle.
    """
    root = covariance_root(covariance)
    mu, V = np.linalg.eigh(root.T @ faked @ root)
    half = root @ V
    gain = 1 / np.maximum(1 - mu, _ROUNDING)
    corrected = (half * gain**2) @ half.T + EVEN_TURN**2 * blind.T @ blind
    values, vectors = np.linalg.eigh(corrected)
    return np.asarray((vectors * np.clip(values, 0.0, EVEN_TURN**2)) @ vectors.T)


def parameter_std(active: BoolArray, posterior: FloatArray, parts: Spectrum) -> FloatArray:
    """Standard uncertainty (P,) of every parameter; posterior : (p, p), of the active ones."""
    std = np.zeros(len(active))
    blind = np.abs(parts.null).max(axis=0, initial=0.0)[: len(posterior)] > _ROUNDING
    std[active] = np.where(blind, np.inf, np.sqrt(np.diagonal(posterior)))
    return std


def simulate_angles(
    draw: Callable[[int], FloatArray],
    rotation: FloatArray,
    rpy_std: FloatArray,
    factor: FloatArray | float,
    known: BoolArray,
    max_trials: int,
    *,
    chunk: int,
) -> MonteCarlo:
    """Draw until the averages are stable or the trials run out.

    draw : rotations (T, n, 3, 3) of T trials, at most `chunk` of them, about the estimate
    `rotation` (n, 3, 3). rpy_std : (n, 3), rad, linear standard uncertainty, and by its coverage
    factor the half width of its interval. known : (n,), sensors whose angles the data determine;
    those of the others are not followed.
    """
    followed = known[:, None].astype(np.float64)

    def angles(size: int) -> FloatArray:
        drawn = [draw(min(chunk, size - start)) for start in range(0, size, chunk)]
        return np.concatenate([followed * so3.deviations(each, rotation) for each in drawn])

    found = propagate(angles, rpy_std, INTERVAL_COVERAGE, max_trials)
    return found.about(so3.to_rpy(rotation), followed * factor * rpy_std)
