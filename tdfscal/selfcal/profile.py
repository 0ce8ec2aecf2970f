"""The balance as a least-squares problem in the rotations alone.

Every other parameter enters the features linearly, or nearly so about a state; eliminated, they
leave |A y|² with y = (vec X₁, …, vec Xₙ, 1), a few dozen numbers whatever the postures and the
parameters. The search over mountings and the Monte Carlo trials run on it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.estimation.fit import Priors
from tdfscal.model.parameters import State, parameter_count, retract
from tdfscal.model.statics import Balance, features, features_jacobian
from tdfscal.numerics import so3
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import FloatArray, Rig


@dataclass(frozen=True, slots=True)
class Profile:
    """What rotations cost when all other parameters take their best values for them.

    features : (q, 9n + 1), ψ = features · y. prior : (m, 9n + 1), the whitened prior rows.
    eliminated : (q, r), and prior_eliminated : (m, r): what the other parameters can explain, as
        features and as prior rows; whitened, their columns are orthonormal.
    root : A (r, 9n + 1), with |A y|² the cost of the postures and priors.
    """

    features: FloatArray
    prior: FloatArray
    eliminated: FloatArray
    prior_eliminated: FloatArray
    root: FloatArray


def linear_in_rotations(state: State, at: Balance, g: float) -> FloatArray:
    """Features as a linear map (q, 9n + 1) of y, the other parameters those of the state."""
    n = state.n
    many = retract(state, np.zeros((9 * n + 1, parameter_count(n, state.motions))))
    units = np.eye(9 * n + 1)[:, :-1].reshape(-1, n, 3, 3)  # one entry of a rotation; last none
    *each, fixed = features(replace(many, rotation=units), at, g)
    return np.stack([*(one - fixed for one in each), fixed], axis=1)


def turns_from(state: State) -> FloatArray:
    """Turns of the sensors from a state as a linear map (3n, 9n + 1) of y: δ = ½ Σ_b x̂_b × x_b.

    x_b and x̂_b are the columns of X and of the state's X̂; the sum has the length of sin |δ|.
    """
    n = state.n
    out = np.zeros((3 * n, 9 * n + 1))
    for i, base in enumerate(state.rotation):
        cross = so3.hat(base.T) / 2  # (b, 3, 3)
        out[3 * i : 3 * i + 3, 9 * i : 9 * i + 9] = np.moveaxis(cross, 0, 2).reshape(3, 9)
    return out


def profile(
    rig: Rig,
    at: Balance,
    compressed: FloatArray,
    state: State,
    priors: Priors,
    *,
    mixing: float = 0.0,
) -> Profile:
    """Eliminate all parameters but the rotations, linearised about a state.

    Parameters
    ----------
    compressed : (≤ q, q), of the whitened design, as `estimator.statistic` forms it.
    mixing : standard deviation of what may be added to every entry of each X. About a far state
        it stands for gain and crosstalk, whose columns belong to one rotation.
    """
    n = state.n
    linear = linear_in_rotations(state, at, rig.gravity)
    jacobian = features_jacobian(state, at, rig.gravity)[:, priors.active]
    other = np.flatnonzero(priors.active) >= 3 * n
    residual, rows = priors(state)
    below = rows[:, ~other] @ turns_from(state)
    below[:, -1] += residual
    rows, nuisance = rows[:, other], jacobian[:, other]
    if mixing > 0:
        free = np.eye(9 * n) / mixing
        nuisance = np.concatenate([nuisance, linear[:, :-1]], axis=1)
        rows = np.block(
            [[rows, np.zeros((len(rows), 9 * n))], [np.zeros((9 * n, rows.shape[1])), free]]
        )
        below = np.concatenate([below, np.zeros((9 * n, 9 * n + 1))])
    whole = np.concatenate([compressed @ linear, below])
    parts = spectrum(np.concatenate([compressed @ nuisance, rows]))
    best = -parts.root @ (parts.left.T @ whole)  # (nuisance parameters, 9n + 1)
    mapped, prior = linear + nuisance @ best, below + rows @ best
    root = np.linalg.qr(np.concatenate([compressed @ mapped, prior]), mode="r")
    explained = parts.root
    return Profile(mapped, prior, nuisance @ explained, rows @ explained, np.asarray(root))
