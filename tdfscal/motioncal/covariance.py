"""From a fit in motion to the covariance of its rotations and the share of each source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.model import dynamics
from tdfscal.model.parameters import layout, sensing
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.rows import reading_gain
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf, coverage_factor
from tdfscal.numerics.least_squares import Spectrum, spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import PRIORS, Quality, Uncertainty, blind_turns, without_faked
from tdfscal.significance import INTERVAL_COVERAGE

#: Names in the budget of what only motion has.
SPECTRUM, MOTION = "noise spectrum", "motion"
#: A share of a null vector below this is rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class MovingUncertainty:
    """Uncertainty of the rotations and of what motion adds.

    turns : as from static postures. joint : (3n, 3n + m), rad and SI, covariance of the rotations
    with everything active, and of all active, (p, p), in `posterior`. moving_std : (8,), of I_O,
    τ, d.
    """

    turns: Uncertainty
    posterior: FloatArray
    moving_std: FloatArray


def posterior(fit: MovingFit, parts: Spectrum) -> tuple[FloatArray, FloatArray]:
    """Covariance (p, p) of the active parameters at the spectrum, and what its error adds.

    By the law of total covariance over the spectrum's parameters θ, E[C(θ)] + Cov[x̂(θ)], to the
    second order along the principal axes of their covariance.
    """
    C = parts.root @ parts.root.T
    added = np.zeros_like(C)
    values, axes = np.linalg.eigh(fit.noise.covariance)
    equations, here = fit.normal_equations(), fit.noise.log_density
    for value, axis in zip(values, axes.T, strict=True):
        step = np.sqrt(value) * axis
        (x_up, up), (x_down, down) = (equations.solved(here + s * step) for s in (1.0, -1.0))
        shift = (x_up - x_down) / 2
        added += (up @ up.T + down @ down.T) / 2 - C + np.outer(shift, shift)
    # The second difference may dip below zero by rounding and by curvature: it never helps.
    values, axes = np.linalg.eigh(added)
    return C, (axes * np.maximum(values, 0.0)) @ axes.T


def evaluate(fit: MovingFit) -> MovingUncertainty:
    """Posterior covariance, budget and coverage factors."""
    n = fit.rig.n
    parts = spectrum(fit.whitened()[1])
    C, added = posterior(fit, parts)
    turns = np.flatnonzero(np.flatnonzero(fit.active) < 3 * n)
    shares = {name: s[np.ix_(turns, turns)] for name, s in _shares(fit, C).items()}
    shares[SPECTRUM] = added[np.ix_(turns, turns)]
    linear = np.sum(list(shares.values()), axis=0)
    covariance = without_faked(linear, faked_information(fit), blind_turns(parts, turns))
    shares["noise"] = shares["noise"] + (covariance - linear)
    R = fit.state.still.rotation
    infinite = np.full((n, 3), np.inf)
    std = np.zeros(len(fit.active))
    blind = np.abs(parts.null).max(axis=0, initial=0.0) > _ROUNDING
    p = int(fit.active.sum())
    std[fit.active] = np.where(blind, np.inf, np.sqrt(np.diagonal(C + added)))[:p]
    cut = len(fit.active) - dynamics.PARAMETERS
    return MovingUncertainty(
        turns=Uncertainty(
            covariance=covariance,
            rpy_covariance=so3.rpy_covariance(R, covariance),
            contributions={name: so3.rpy_variance(R, share) for name, share in shares.items()},
            parameter_std=std[:cut],
            effective_dof=infinite,
            coverage_factor=coverage_factor(INTERVAL_COVERAGE, infinite),
        ),
        posterior=(C + added)[:p, :p],
        moving_std=std[cut:],
    )


def _shares(fit: MovingFit, C: FloatArray) -> dict[str, FloatArray]:
    """Covariance (p, p) by source at the spectrum; together they are C."""
    force, place = fit.noise.parts(fit.rows.bins)
    variance = force + place
    shares = {}
    for name, part in (("noise", force), ("positioner", place)):
        root = np.sqrt(fit.rows.bins.count * part) / variance
        half = C @ fit.rows.scaled(fit.jacobian, root).T
        shares[name] = half @ half.T
    columns = np.flatnonzero(fit.active)
    places = layout(fit.rig.n, fit.state.still.motions)
    cut = places["drift"].stop
    groups = {PRIORS[group]: place for group, place in places.items()}
    groups[MOTION] = slice(cut, len(fit.active))
    for source, span in groups.items():
        inside = np.flatnonzero((columns >= span.start) & (columns < span.stop))
        rows = fit.prior_jacobian[np.abs(fit.prior_jacobian[:, inside]).any(axis=1)]
        half = C @ rows.T
        shares[source] = half @ half.T
    own = C[:, len(columns) :]  # the turns at rests, whose prior rows are the unit matrix
    shares["positioner"] = shares["positioner"] + own @ own.T
    return shares


def faked_information(fit: MovingFit) -> FloatArray:
    """Information (3n, 3n) about the rotations that noise in the readings fakes.

    As `selfcal.covariance.faked_information`, summed over the Fourier coefficients: reading noise
    of density S_F turned by [u]×, through B, weighted by S⁻¹.
    """
    n = fit.rig.n
    M = sensing(fit.state.still)
    axes = [so3.hat(M[:, :, a]) for a in range(3)]
    faked = np.zeros((3 * n, 3 * n))
    for item in fit.designs:
        W = reading_gain(item, fit.noise)
        C = np.einsum("nrasb,rs->nab", item.lever, W)
        for turn in axes:
            block = np.swapaxes(turn, 1, 2) @ C @ turn
            for i in range(n):
                faked[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] += block[i]
    return faked


def quality(fit: MovingFit) -> Quality:
    """χ² of the fit, which the spectrum has been brought to agree with; rms over time."""
    _, jacobian = fit.whitened()
    used = len(spectrum(jacobian).values)
    count = round(float(fit.rows.bins.count.sum()))
    dof = count + len(fit.prior_residual) - used
    chi2 = fit.cost
    rms = [0.0, 0.0]
    total = sum(design.block.taper.shape[1] for design in fit.designs)
    for item, e in zip(fit.designs, fit.wrenches(), strict=True):
        both = np.where(np.arange(len(e)) > 0, 2.0, 1.0)[:, None]
        length = item.block.taper.shape[1] * item.block.step
        power = np.sum(both * np.abs(e) ** 2, axis=0) / length
        share = item.block.taper.shape[1] / total
        rms[0] += share * float(power[:3].sum())
        rms[1] += share * float(power[3:].sum())
    return Quality(
        chi2=chi2,
        dof=dof,
        p_value=float(chi2_sf(chi2, dof)) if dof > 0 else 1.0,
        birge=float(np.sqrt(chi2 / dof)) if dof > 0 else 1.0,
        rms_force=float(np.sqrt(rms[0])),
        rms_moment=float(np.sqrt(rms[1])),
    )
