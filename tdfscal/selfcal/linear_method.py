"""The paper's linear method, corrected: the published baseline, and a start value."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.errors import DataError
from tdfscal.estimation.uncertainty import PRIORS, Uncertainty, of_shares
from tdfscal.findings import Finding, Value
from tdfscal.model.parameters import State, gravity, layout, nominal, prior_std
from tdfscal.model.postures import register
from tdfscal.model.statics import Postures, features_jacobian
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.numerics.rotation_descent import turns_from
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.estimator import Fit, at_state, noise_shares
from tdfscal.wrench.contact_wrench import to_lcs


@dataclass(frozen=True, slots=True)
class LinearData:
    """What the linear method takes as given; every array may carry leading batch axes.

    load : (..., K, n, 3), f_i − z_i, N. pose : (..., K, 3, 3), R. weight : (..., 3), G, N, BCS.
    hinge : (..., n, 3), barycentre : (..., 3), m, LCS.
    """

    load: FloatArray
    pose: FloatArray
    weight: FloatArray
    hinge: FloatArray
    barycentre: FloatArray


def linear_data(rig: Rig, postures: Postures) -> LinearData:
    """Take mass, barycentre and zeros as the rig file states them."""
    state = nominal(rig)
    return LinearData(
        load=postures.force - rig.zero.value,
        pose=register(rig.hinge, postures.position)[0],
        weight=state.mass * gravity(state, rig.gravity),
        hinge=rig.hinge,
        barycentre=rig.barycentre.value,
    )


def moment_rows(data: LinearData) -> tuple[FloatArray, FloatArray]:
    """Rows of Σ_i (r̂_i Rᵀ ⊗ f_iᵀ) vec X_i = −r̂_m Rᵀ G, vec by rows (Eq. 21–24 corrected).

    Returns (..., 3K, 9n) and (..., 3K), moments about the LCS origin.
    """
    Rt = np.swapaxes(data.pose, -1, -2)
    lever = so3.hat(data.hinge)[..., None, :, :, :] @ Rt[..., None, :, :]  # r̂_i Rᵀ
    rows = np.einsum("...knac,...knd->...kancd", lever, data.load)
    down = Rt @ data.weight[..., None, :, None]  # Rᵀ G
    right = -(so3.hat(data.barycentre)[..., None, :, :] @ down)[..., 0]
    batch, (K, n) = rows.shape[:-5], data.load.shape[-3:-1]
    return rows.reshape(*batch, 3 * K, 9 * n), right.reshape(*batch, 3 * K)


def linear_rotations(data: LinearData) -> FloatArray:
    """Rotations (..., n, 3, 3) by the paper's method (theory, section 3).

    Moment equations only, least squares for 9n unknowns, each block projected on SO(3). Needs 9
    postures for three sensors; biased by noise in the readings, and ill-conditioned.
    """
    rows, right = moment_rows(data)
    Q, R = np.linalg.qr(rows)
    vec = np.linalg.solve(R, np.swapaxes(Q, -1, -2) @ right[..., None])
    return so3.project(vec.reshape(*rows.shape[:-2], -1, 3, 3))


def linear_start(rig: Rig, postures: Postures) -> State:
    """Start value: moment and force rows together, least squares, projected on SO(3).

    Where the postures are too few to determine all 9n entries the least-squares correction to
    the nominal mounting is the smallest one.
    """
    data = linear_data(rig, postures)
    moment, m_right = moment_rows(data)
    # Σ_i (I ⊗ f_iᵀ) vec X_i = −G
    force = np.einsum("ac,knd->kancd", np.eye(3), data.load).reshape(-1, 9 * rig.n)
    radius = np.linalg.norm(rig.hinge - rig.hinge.mean(axis=0), axis=1).mean()
    rows = np.concatenate([moment / radius, force])  # both in N
    right = np.concatenate([m_right / radius, np.tile(-data.weight, len(postures))])
    guess = nominal(rig).rotation
    step = np.linalg.lstsq(rows, right - rows @ guess.ravel(), rcond=None)[0]
    return replace(nominal(rig), rotation=so3.project(guess + step.reshape(rig.n, 3, 3)))


def fit_linear(rig: Rig, observed: Postures) -> Fit:
    """Estimate from the moment equations about the LCS origin; nothing but rotations is fitted.

    Raises
    ------
    DataError
        Fewer postures than the 9n unknowns need, three equations each.
    """
    need = 3 * rig.n
    if len(observed) < need:
        values: dict[str, Value] = {"need": need, "sensors": rig.n}
        raise DataError(Finding("linear-postures-few", size=len(observed), values=values))
    rotation = linear_rotations(linear_data(rig, observed))
    state = replace(nominal(rig), rotation=rotation)
    return at_state(rig, observed, state, np.ones(len(observed)))


def evaluate_linear(fit: Fit, parts: Spectrum) -> Uncertainty:
    """Covariance and budget of the linear estimate, to the first order in all of its inputs.

    parts : of the fit's Jacobian. What is unknown keeps its stated value.
    """
    rig, seen, at = fit.rig, fit.postures, fit.at
    rows, _ = moment_rows(linear_data(rig, seen))
    turns = turns_from(fit.state.rotation)[:, :-1] @ np.linalg.pinv(rows)
    gain = turns.reshape(len(turns), len(seen), 3).swapaxes(0, 1) @ to_lcs(at)[:, 3:]  # (K, 3n, 6)
    std, places = prior_std(rig, seen.motion), layout(rig.n, seen.motions)
    std[places["rotation"]] = 0.0
    by_prior = at.design @ features_jacobian(fit.state, at, rig.gravity)
    by_prior = (gain @ (by_prior * np.where(np.isfinite(std), std, 0.0))).sum(axis=0)
    shares = noise_shares(fit, gain)
    for group, name in PRIORS.items():
        shares[name] = by_prior[:, places[group]] @ by_prior[:, places[group]].T
    return of_shares(fit.state.rotation, shares, np.zeros((3 * rig.n,) * 2), parts, std)
