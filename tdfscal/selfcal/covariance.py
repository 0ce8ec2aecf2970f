"""From a fit to its covariance, the share of each source, and honest intervals (theory, 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.model.calibrated import Calibrated, with_rotations
from tdfscal.model.parameters import (
    EVEN_TURN,
    layout,
    parameter_count,
    retract,
    sensing,
    with_motions,
)
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf, coverage_factor
from tdfscal.numerics.least_squares import Spectrum, spectrum, triangular
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.selfcal.estimator import Fit
from tdfscal.significance import INTERVAL_COVERAGE

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
#: A share of a null vector below this is rounding.
_ROUNDING = 1e-6
#: A share of noise in a variance below this leaves as good as infinite degrees of freedom.
_NO_SHARE = 1e-9


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Covariance of the rotations and its parts.

    covariance : (3n, 3n), rad², of left perturbations in the BCS. rpy_covariance : (n, 3, 3),
    rad². contributions : source → (n, 3), variance of roll, pitch, yaw, rad²; they sum to the
    diagonal of rpy_covariance. parameter_std : (P,), 0 where known exactly, ∞ where undetermined.
    effective_dof, coverage_factor : (n, 3), for 95 % (GUM, annex G).
    """

    covariance: FloatArray
    rpy_covariance: FloatArray
    contributions: dict[str, FloatArray]
    parameter_std: FloatArray
    effective_dof: FloatArray
    coverage_factor: FloatArray

    @property
    def rpy_std(self) -> FloatArray:
        """Standard uncertainty of roll, pitch, yaw (n, 3), rad."""
        return np.sqrt(np.diagonal(self.rpy_covariance, axis1=1, axis2=2))


@dataclass(frozen=True, slots=True)
class Estimate:
    """A fit and what is known of it before it is doubted.

    parts : the whitened Jacobian of postures and priors, decomposed.
    """

    fit: Fit
    parts: Spectrum
    quality: Quality
    uncertainty: Uncertainty


def estimate(fit: Fit, *, noise_from_residuals: bool = False) -> Estimate:
    """Judge a fit by its own residuals; see `evaluate`."""
    parts = information_root(fit)
    stats = quality(fit, parts)
    known = evaluate(fit, parts, stats.birge, noise_from_residuals=noise_from_residuals)
    return Estimate(fit, parts, stats, known)


def information_root(fit: Fit) -> Spectrum:
    """Decompose the whitened Jacobian of the used postures and the priors."""
    return spectrum(_whitened_jacobian(fit))


def factored_information(fit: Fit) -> Spectrum:
    """The same from the Jacobian's triangular factor, whose rows are no postures: much faster."""
    J = _whitened_jacobian(fit)
    return spectrum(triangular(J), len(J))


def _whitened_jacobian(fit: Fit) -> FloatArray:
    J = fit.root @ fit.jacobian
    return np.concatenate([J.reshape(-1, J.shape[-1]), fit.prior_jacobian])


def quality(fit: Fit, parts: Spectrum) -> Quality:
    """χ² of the fit against the stated uncertainties."""
    e = fit.residual[fit.weight > 0]
    dof = fit.rows + len(fit.prior_residual) - len(parts.values)
    total, all_dof = fit.cost, dof
    if fit.rig.earlier is not None:
        total, all_dof = total + fit.rig.earlier.chi2, all_dof + fit.rig.earlier.dof
    rms_force, rms_moment = (
        float(np.sqrt(np.mean(np.sum(e[:, rows] ** 2, axis=1)))) for rows in np.s_[:3, 3:]
    )
    return Quality(
        chi2=fit.cost,
        dof=dof,
        p_value=float(chi2_sf(fit.cost, dof)) if dof > 0 else 1.0,
        birge=float(np.sqrt(total / all_dof)) if all_dof > 0 else 1.0,
        rms_force=rms_force,
        rms_moment=rms_moment,
    )


def evaluate(
    fit: Fit,
    parts: Spectrum,
    birge: float,
    *,
    noise_from_residuals: bool = False,
    undeclared: FloatArray | None = None,
) -> Uncertainty:
    """Posterior covariance, budget and coverage factors.

    birge : its excess over 1 scales the standard deviation of the noise; it never shrinks any.
    noise_from_residuals : the noise level itself comes from this fit, with its few degrees.
    undeclared : (p,), by which the active parameters move with what the rig file may lack.
    """
    posterior = parts.root @ parts.root.T  # pseudo-inverse of the information
    inflate = max(1.0, birge) ** 2
    shares = {
        name: share * (inflate if name in NOISE else 1.0)
        for name, share in _shares(fit, posterior).items()
    }
    if undeclared is not None:
        shares[UNDECLARED] = np.outer(undeclared, undeclared)
        posterior = posterior + shares[UNDECLARED]
    dof = np.inf
    if birge > 1 or noise_from_residuals:
        dof = max(1, fit.rows - len(parts.values) + len(fit.prior_residual))
        dof += 0 if fit.rig.earlier is None else fit.rig.earlier.dof
    faked, std = faked_information(fit), parameter_std(fit.active, posterior, parts)
    return of_shares(fit.state.rotation, shares, faked, parts, std, dof)


def of_shares(
    R: FloatArray,
    shares: dict[str, FloatArray],
    faked: FloatArray,
    parts: Spectrum,
    std: FloatArray,
    noise_dof: float = np.inf,
) -> Uncertainty:
    """Uncertainty of rotations (n, 3, 3), whose turns are the first of the parameters.

    shares : source → (p, p), covariance by it. faked : (3n, 3n), information that noise fakes,
    whose loss is the noise's. std : (P,), of every parameter. noise_dof : behind the scale of the
    noise; only that has finite degrees of freedom (Welch–Satterthwaite, GUM, G.4.1).
    """
    turns = slice(3 * len(R))
    own = {name: share[turns, turns] for name, share in shares.items()}
    linear = np.sum(list(own.values()), axis=0)
    covariance = without_faked(linear, faked, blind_turns(parts, 3 * len(R)))
    own["noise"] = own["noise"] + (covariance - linear)
    contributions = {name: so3.rpy_variance(R, share) for name, share in own.items()}
    total = np.sum(list(contributions.values()), axis=0)
    noise = np.sum([contributions[name] for name in NOISE if name in contributions], axis=0)
    share = np.maximum(noise / np.maximum(total, np.finfo(float).tiny), _NO_SHARE)
    dof = np.asarray(noise_dof / share**2)
    return Uncertainty(
        covariance=covariance,
        rpy_covariance=so3.rpy_covariance(R, covariance),
        contributions=contributions,
        parameter_std=std,
        effective_dof=dof,
        coverage_factor=coverage_factor(INTERVAL_COVERAGE, dof),
    )


def _shares(fit: Fit, posterior: FloatArray) -> dict[str, FloatArray]:
    """Covariance (p, p) by source; together they are the posterior covariance."""
    at, W = fit.at, fit.at.information
    gain = fit.weight[:, None, None] * (posterior @ np.swapaxes(fit.jacobian, 1, 2) @ W)

    def through(cov: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("kpa,kab,kqb->pq", gain, cov, gain, optimize=True))

    friction = np.diag([0, 0, 0, 1, 1, 1]) * fit.postures.moment_var
    reading = np.einsum(
        "kiab,kibc,kidc->kad", at.noise_force, fit.postures.force_cov, at.noise_force
    )
    turning = at.noise_turn @ at.turn_cov @ np.swapaxes(at.noise_turn, 1, 2)
    shares = {
        "noise": through(reading),
        "positioner": through(turning),
        "hinge friction": through(np.broadcast_to(friction, turning.shape)),
    }
    places = layout(fit.rig.n, fit.state.motions)
    groups = {PRIORS[group]: place for group, place in places.items()}
    rows = fit.prior_jacobian
    return shares | prior_shares(fit.rig, posterior, rows, len(rows), fit.active, groups)


def prior_shares(
    rig: Rig,
    posterior: FloatArray,
    rows: FloatArray,
    still: int,
    active: BoolArray,
    groups: dict[str, slice],
) -> dict[str, FloatArray]:
    """Covariance by earlier campaigns, and by the priors of groups of parameters.

    posterior : (p, c), of the active parameters with all that rows (m, c) of priors are by.
    still : of these rows by the parameters of statics, whose last ones are earlier campaigns'.
    """
    columns = np.flatnonzero(active)
    earlier = 0 if rig.earlier is None else len(rig.earlier.root)
    before, common, after = np.split(rows, [still - earlier, still])
    own, by = np.concatenate([before, after]), {EARLIER: common}
    for name, place in groups.items():
        inside = np.flatnonzero((columns >= place.start) & (columns < place.stop))
        by[name] = own[np.abs(own[:, inside]).any(axis=1)]
    halves = {name: posterior @ part.T for name, part in by.items()}
    return {name: half @ half.T for name, half in halves.items()}


def faked_information(fit: Fit) -> FloatArray:
    """Information (3n, 3n) about the rotations that noise in the readings fakes.

    JᵀWJ takes its levers from the measured forces, noise included: a sensor that feels nothing
    but its own noise sideways would seem to know its yaw. The expectation of that part is
    Σ_k E[[n]×ᵀ Bᵀ W B [n]×], B = [I; [ρ_i]×].
    """
    n, M = fit.rig.n, sensing(fit.state)
    B = fit.at.wrench
    W = fit.at.information * fit.weight[:, None, None]
    C = np.einsum("knra,krs,knsb->knab", B, W, B, optimize=True)
    values, axes = np.linalg.eigh(M @ fit.postures.force_cov @ np.swapaxes(M, -1, -2))
    faked = np.zeros((3 * n, 3 * n))
    for a in range(3):
        turn = so3.hat(axes[..., :, a])
        block = np.einsum("kn,knca,kncd,kndb->nab", values[..., a], turn, C, turn, optimize=True)
        for i in range(n):
            faked[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += block[i]
    return faked


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
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
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


def joint_posterior(
    fit: Fit, rotation_covariance: FloatArray, rotation: FloatArray | None = None
) -> Calibrated:
    """All parameters of a self-calibration with their joint posterior covariance.

    rotation_covariance : (3n, 3n), rad², as published; it may differ from the fit's own (Birge
    ratio, noise that fakes information, a tracker's share). rotation : (n, 3, 3), as published,
    where it is not the fit's. The other parameters keep their distribution given the rotations.
    Combinations that no posture sees (theory, section 4) carry no variance: they do not show in
    any contact wrench at rest either.
    """
    size, turns = len(fit.active), 3 * fit.rig.n
    parts = factored_information(fit)
    free = np.flatnonzero(fit.active)
    posterior = np.zeros((size, size))
    posterior[np.ix_(free, free)] = parts.root @ parts.root.T
    # How zeros moved belongs to this campaign alone.
    size = parameter_count(fit.rig.n)
    posterior, state = posterior[:size, :size], with_motions(fit.state, 0)
    if rotation is not None:
        turn = so3.log(rotation @ np.swapaxes(state.rotation, 1, 2)).ravel()
        along = np.linalg.solve(posterior[:turns, :turns], turn)
        state = replace(retract(state, posterior[:, :turns] @ along), rotation=rotation)
    return Calibrated(
        rig=fit.rig,
        state=state,
        covariance=with_rotations(posterior, turns, rotation_covariance),
        open=np.zeros(size, dtype=np.bool_),
        joint=True,
    )
