"""The paper's linear method, corrected: the published baseline."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import DataError
from tdfscal.estimation.uncertainty import Uncertainty
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import gravity, layout, nominal, prior_std, symmetric
from tdfscal.model.postures import register
from tdfscal.model.statics import Postures, forces
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.numerics.least_squares import covariance_root
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.estimator import Fit, at_state
from tdfscal.significance import INTERVAL_COVERAGE

#: The budget's only source: the method has no covariance of its own to split.
SOURCE = "all inputs"
_CHUNK = 200


@record
class LinearData:
    """What the linear method takes as given; every array may carry leading batch axes.

    load : (..., K, n, 3), f_i − z_i, N. pose : (..., K, 3, 3), R. weight : (..., 3), G, N, BCS.
    hinge : (..., n, 3), barycentre : (..., 3), m, LCS. moment : (..., K, 3), N·m, LCS, of what else
    acts on the terminal; 0 where nothing is known of it.
    """

    load: FloatArray
    pose: FloatArray
    weight: FloatArray
    hinge: FloatArray
    barycentre: FloatArray
    moment: FloatArray


def linear_data(rig: Rig, postures: Postures) -> LinearData:
    """Take mass, barycentre and zeros as the rig file states them."""
    state = nominal(rig)
    return LinearData(
        load=postures.force - rig.zero.value,
        pose=register(rig.hinge, postures.position)[0],
        weight=state.mass * gravity(state, rig.gravity),
        hinge=rig.hinge,
        barycentre=rig.barycentre.value,
        moment=np.zeros((len(postures), 3)),
    )


def linear_rotations(data: LinearData, weight: FloatArray | None = None) -> FloatArray:
    """Rotations (..., n, 3, 3) by the paper's method (theory, section 3).

    Σ_i (r̂_i Rᵀ ⊗ f_iᵀ) vec X_i = −r̂_m Rᵀ G, vec by rows (Eq. 21–24 corrected), moments about the
    LCS origin: least squares for 9n unknowns, each block projected on SO(3). Needs 9 postures for
    three sensors; biased by noise in the readings, and ill-conditioned. weight : (K,), 0 for a
    posture that is left out.
    """
    Rt = np.swapaxes(data.pose, -1, -2)
    lever = so3.hat(data.hinge)[..., None, :, :, :] @ Rt[..., None, :, :]  # r̂_i Rᵀ
    rows = np.einsum("...knac,...knd->...kancd", lever, data.load)
    down = Rt @ data.weight[..., None, :, None]  # Rᵀ G
    right = -(so3.hat(data.barycentre)[..., None, :, :] @ down)[..., 0] - data.moment
    batch, (K, n) = rows.shape[:-5], data.load.shape[-3:-1]
    rows, right = rows.reshape(*batch, 3 * K, 9 * n), right.reshape(*batch, 3 * K)
    if weight is not None:
        used = np.repeat(weight > 0, 3)
        rows, right = rows[..., used, :], right[..., used]
    Q, R = np.linalg.qr(rows)
    vec = np.linalg.solve(R, np.swapaxes(Q, -1, -2) @ right[..., None])
    return so3.project(vec.reshape(*rows.shape[:-2], -1, 3, 3))


def fit_linear(rig: Rig, observed: Postures, weight: FloatArray) -> Fit:
    """Estimate from the moment equations about the LCS origin; nothing but rotations is fitted.

    weight : (K,), 0 for a posture that is left out.

    Raises
    ------
    DataError
        Fewer postures than the 9n unknowns need, three equations each.
    """
    need, used = 3 * rig.n, int(np.count_nonzero(weight))
    if used < need:
        values: dict[str, Value] = {"need": need, "sensors": rig.n}
        raise DataError(Finding("linear-postures-few", size=used, values=values))
    rotation = linear_rotations(linear_data(rig, observed), weight)
    return at_state(rig, observed, replace(nominal(rig), rotation=rotation), weight)


def evaluate_linear(fit: Fit, rng: np.random.Generator, trials: int) -> Uncertainty:
    """Covariance of the linear estimate: all inputs perturbed, solved again `trials` times.

    About the estimate, for noise in the regressors pulls every solution to the same side.
    """
    rig, base = fit.rig, fit.state.rotation
    sizes = [min(_CHUNK, trials - start) for start in range(0, trials, _CHUNK)]
    found = np.concatenate(
        [linear_rotations(_perturbed(fit, rng, size), fit.weight) for size in sizes]
    )
    turns = so3.log(found @ np.swapaxes(base, 1, 2)).reshape(trials, -1)
    covariance = turns.T @ turns / trials
    rpy_covariance = so3.rpy_covariance(base, covariance)
    std = prior_std(rig)
    std[: 3 * rig.n] = 0.0
    return Uncertainty(
        covariance=covariance,
        rpy_covariance=rpy_covariance,
        contributions={SOURCE: np.diagonal(rpy_covariance, axis1=1, axis2=2)},
        parameter_std=std,
        coverage_factor=np.full((rig.n, 3), float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))),
    )


def _perturbed(fit: Fit, rng: np.random.Generator, trials: int) -> LinearData:
    """Draw all inputs of the linear method; what is unknown keeps its stated value."""
    rig, seen, given = fit.rig, fit.postures, linear_data(fit.rig, fit.postures)
    std, place = prior_std(rig, seen.motion), layout(rig.n, seen.motions)

    def draw(group: str, *shape: int) -> FloatArray:
        own = np.where(np.isfinite(std[place[group]]), std[place[group]], 0.0)
        return (rng.standard_normal((trials, len(own))) * own).reshape(trials, *shape)

    noise = np.einsum(
        "knab,tknb->tkna",
        covariance_root(seen.force_cov),
        rng.standard_normal((trials, *seen.force.shape)),
        optimize=True,
    )
    zero = draw("zero", rig.n, 3)[:, None]
    if seen.motion is not None:
        moving = draw("drift", seen.motions, rig.n, 3)
        zero = zero + np.einsum("kng,tgna->tkna", seen.motion.value, moving)
    mixed = np.eye(3) + symmetric(draw("sensitivity", rig.n, 6))  # (T, n, 3, 3)
    hinge = draw("hinge", rig.n, 3)
    # Displacement (T, K, n, 3) of the positions on which the hinges are registered: the encoder
    # stands C F ahead of the hinge.
    shift = np.einsum("kab,tnb->tkna", fit.at.rotation, hinge) + draw("datum", rig.n, 3)[:, None]
    given_way = draw("compliance", 2)[:, None, None, [0, 0, 1]]
    shift += given_way * forces(fit.state, fit.at.seen.force)
    turn = -np.einsum("knab,tknb->tka", fit.at.turn, shift, optimize=True)
    turn += np.einsum(
        "kab,tkb->tka",
        covariance_root(fit.at.turn_cov),
        rng.standard_normal((trials, len(seen), 3)),
    )
    tilt = np.concatenate([draw("tilt", 2), np.zeros((trials, 1))], axis=1)
    weight = given.weight * (1 + draw("mass") / rig.mass.value)[:, None]
    return LinearData(
        load=np.einsum("tnab,knb->tkna", mixed, given.load) + noise - zero,
        pose=so3.exp(turn) @ given.pose,
        weight=np.einsum("tab,tb->ta", so3.exp(tilt), weight),
        hinge=given.hinge + hinge,
        barycentre=given.barycentre + draw("barycentre", 3),
        moment=np.sqrt(seen.moment_var) * rng.standard_normal((trials, len(seen), 3)),
    )
