"""The paper's linear method, corrected, as a calibration with its covariance by Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdfscal.errors import DataError
from tdfscal.model.parameters import layout, nominal, prior_std, symmetric
from tdfscal.model.statics import Postures, forces
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.covariance import Uncertainty
from tdfscal.selfcal.estimator import Fit, at_state
from tdfscal.selfcal.initial_guess import LinearData, linear_data, linear_rotations
from tdfscal.selfcal.monte_carlo import covariance_root
from tdfscal.significance import INTERVAL_COVERAGE

#: The budget's only source: the method has no covariance of its own to split.
SOURCE = "all inputs"
_CHUNK = 200


def fit_linear(rig: Rig, observed: Postures) -> Fit:
    """Estimate from the moment equations about the LCS origin; nothing but rotations is fitted.

    Raises
    ------
    DataError
        Fewer postures than the 9n unknowns need, three equations each.
    """
    need = 3 * rig.n
    if len(observed) < need:
        raise DataError(
            f"the linear method needs {need} postures for {rig.n} sensors and finds "
            f"{len(observed)}",
            where="log",
            hint="record more postures, or use the default estimator",
        )
    rotation = linear_rotations(linear_data(rig, observed))
    state = replace(nominal(rig), rotation=rotation)
    return at_state(rig, observed, state, np.ones(len(observed)))


def evaluate_linear(fit: Fit, rng: np.random.Generator, trials: int) -> Uncertainty:
    """Covariance of the linear estimate: all inputs perturbed, solved again `trials` times."""
    rig, base = fit.rig, fit.state.rotation
    turns = np.concatenate(
        [
            so3.log(linear_rotations(_perturbed(fit, rng, min(_CHUNK, trials - start))) @ _T(base))
            for start in range(0, trials, _CHUNK)
        ]
    ).reshape(trials, -1)
    covariance = np.cov(turns, rowvar=False)
    rpy_covariance = so3.rpy_covariance(base, covariance)
    std = prior_std(rig)
    std[: 3 * rig.n] = 0.0
    return Uncertainty(
        covariance=covariance,
        rpy_covariance=rpy_covariance,
        contributions={SOURCE: np.diagonal(rpy_covariance, axis1=1, axis2=2)},
        parameter_std=std,
        effective_dof=np.full((rig.n, 3), np.inf),
        coverage_factor=np.full((rig.n, 3), float(normal_quantile(0.5 + INTERVAL_COVERAGE / 2))),
    )


def _T(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)


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
    shift = _shift(fit, hinge, draw("datum", rig.n, 3), draw("compliance", 2))
    turn = np.einsum("knab,tknb->tka", _turn_by_position(fit), shift, optimize=True)
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


def _shift(fit: Fit, hinge: FloatArray, datum: FloatArray, compliance: FloatArray) -> FloatArray:
    """Displacement (T, K, n, 3), m, BCS, of the positions on which the hinges are registered.

    hinge, datum : (T, n, 3), errors. compliance : (T, 2), sideways and along Z, m/N: the encoder
    stands C F ahead of the hinge.
    """
    F = forces(fit.state, fit.at.seen.force)
    moved = np.einsum("kab,tnb->tkna", fit.at.rotation, hinge) + datum[:, None]
    given: FloatArray = compliance[:, None, None, [0, 0, 1]] * F
    return np.asarray(-(moved + given))


def _turn_by_position(fit: Fit) -> FloatArray:
    """Rotation of the registered pose for a displacement of each position, (K, n, 3, 3), rad/m."""
    arm = fit.at.arm
    spoke = so3.hat(arm - arm.mean(axis=1, keepdims=True))
    inertia = np.einsum("knca,kncb->kab", spoke, spoke)
    return np.linalg.solve(inertia[:, None], spoke)
