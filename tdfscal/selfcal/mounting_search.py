"""Where the cost has its minima: mountings that may explain the postures, the nominal one or not.

Turning all sensors about the vertical by half a turn reverses every horizontal force, and where
those are small the balance hardly notices. A start is therefore never believed because it fits:
the landscape over all mountings is searched, on the few dozen numbers that the postures leave of
it when everything but the rotations is eliminated.

The balance as a least-squares problem in the rotations alone.

Every other parameter enters the features linearly, or nearly so about a state; eliminated, they
leave |A y|² with y = (vec X₁, …, vec Xₙ, 1), a few dozen numbers whatever the postures and the
parameters. The search over mountings and the Monte Carlo trials run on it.
"""

from __future__ import annotations

import numpy as np

from tdfscal.estimation.fit import Priors, scored
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State, parameter_count, retract, starting_state
from tdfscal.model.statics import Balance, Postures, balance, features
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_sf, normal_quantile
from tdfscal.numerics.least_squares import spectrum
from tdfscal.numerics.rotation_fits import descend
from tdfscal.records import BoolArray, FloatArray, Rig
from tdfscal.selfcal.estimator import LOOK, ROWS, Fit, Problem, at_state, fit, statistic
from tdfscal.significance import AMBIGUOUS_MOUNTING


@record
class Profile:
    """What rotations cost when all other parameters take their best values for them.

    features : (q, 9n + 1), ψ = features · y. prior : (m, 9n + 1), the whitened prior rows.
    eliminated : (q, r), what the other parameters can explain, as features; whitened, and with
        their prior rows, their columns are orthonormal.
    root : A (r, 9n + 1), with |A y|² the cost of the postures and priors.
    """

    features: FloatArray
    prior: FloatArray
    eliminated: FloatArray
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
    of: Problem, state: State, *, pull: FloatArray | None = None, mixing: float = 0.0
) -> Profile:
    """Eliminate all parameters but the rotations, linearised about a state.

    pull : (q,), part of the features' score that is taken away; default none.
    mixing : standard deviation of what may be added to every entry of each X. About a far state it
    stands for gain and crosstalk, whose columns belong to one rotation.
    """
    n, compressed, priors = state.n, of.compressed, of.priors
    linear, slope = linear_in_rotations(state, of.at, of.priors.rig.gravity), of.features(state)[1]
    jacobian, other = slope[:, priors.active], np.flatnonzero(priors.active) >= 3 * n
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
    of_postures = compressed @ linear
    if pull is not None:
        offset = scored(compressed, slope, priors(state)[1], priors.active, pull)
        of_postures[:, -1] -= offset[: len(compressed)]
        below[:, -1] -= offset[len(compressed) :]
    whole = np.concatenate([of_postures, below])
    parts = spectrum(np.concatenate([compressed @ nuisance, rows]))
    best = -parts.root @ (parts.left.T @ whole)  # (nuisance parameters, 9n + 1)
    mapped, prior = linear + nuisance @ best, below + rows @ best
    of_postures += compressed @ (nuisance @ best)
    root = np.linalg.qr(np.concatenate([of_postures, prior]), mode="r")
    return Profile(mapped, prior, nuisance @ parts.root, np.asarray(root))


#: Sensors above which combinations of turned ones are too many to try.
_MANY = 8
#: Starts drawn evenly over all rotations.
_DRAWN = 64
#: Steps from each start at most.
_DESCENT = 40
#: Two ends are one minimum when no sensor differs by more, rad.
APART = 0.1
#: A minimum is offered when its cost is below this many times the lowest, plus so much.
_WORTH, _MARGIN, _OFFERED = 4.0, 300.0, 6
#: Degrees of freedom of Student's t by which starts are compared: a few touched postures must not
#: decide between mountings.
_HEAVY_TAIL = 3.0
#: Rivals whose cost is within this many times the limit are fitted in full before they are judged.
_NEAR = 4.0
#: Starts at most whose sensors without all axes lean, and by how much, rad.
_LEANS, _LEAN = 12, 0.02
#: Costs that differ by less, relative, are one.
_ONE_COST = 1e-4


@record
class Rival:
    """Another mounting that explains the postures about as well.

    state : its estimate. gap : its χ² less that of the estimate, in units of the residuals'
    variance.
    """

    state: State
    gap: float

    @property
    def p_value(self) -> float:
        """Chance, at most, that the estimate is the wrong one of the two.

        With χ² apart by D on average the wrong one comes out lower by g with probability
        Φ(−(D + g)/2√D) ≤ Φ(−√g).
        """
        return 0.5 * float(chi2_sf(max(self.gap, 0.0), 1))


def best_start(rig: Rig, postures: Postures) -> Fit:
    """Estimate, not yet settled, in the basin of the lowest minimum over all mountings."""
    start = starting_state(rig, postures.motions)
    everyone, priors = np.ones(len(postures)), Priors(rig, postures.motion)
    at = balance(postures, start, rig.barycentre.value, rig.gravity)
    problem = Problem(at, statistic(at, everyone), priors)
    anywhere = np.random.default_rng(0).standard_normal((_DRAWN, rig.n, 3, 3))
    starts = np.concatenate([start.rotation[None], so3.project(anywhere)])
    tried = []
    for rotation in minima(problem, start, starts):
        solution = problem.solved(replace(start, rotation=rotation), iterations=LOOK)
        tried.append(at_state(rig, postures, solution.state, everyone))
    if not rig.axes.all():
        tried += _leaning(rig, postures, _likeliest(tried))
    return _likeliest(tried)


def _likeliest(tried: list[Fit]) -> Fit:
    """The one with the lowest robust cost, all in units of the smallest variance of residuals."""
    scale = min(each.misfit for each in tried)
    return min(tried, key=lambda each: robust_cost(each, scale))


def _leaning(rig: Rig, postures: Postures, near: Fit) -> list[Fit]:
    """Fits from starts about one whose sensors without all axes lean, until the best came twice.

    Two load cells that press against each other change the balance by how much they lean, and by
    the ratio of their leans: about an upright start there are as many minima as directions.
    """
    rng, lacks = np.random.default_rng(0), np.asarray((~rig.axes).any(axis=1))
    tried: list[Fit] = []
    for _ in range(_LEANS):
        lean = np.where(lacks[:, None], _LEAN * rng.standard_normal((rig.n, 3)), 0.0)
        start = replace(near.state, rotation=so3.exp(lean) @ near.state.rotation)
        tried.append(fit(rig, postures, start))
        lowest = min(each.cost for each in tried)
        if sum(each.cost < lowest * (1 + _ONE_COST) for each in tried) > 1:
            break
    return tried


def robust_cost(result: Fit, scale: float) -> float:
    """−2 log likelihood under Student's t, residuals in units of √scale."""
    tail = np.log1p(result.distance / (_HEAVY_TAIL * scale))
    prior = float(result.prior_residual @ result.prior_residual)
    return float((_HEAVY_TAIL + ROWS) * np.sum(tail)) + prior / scale


def rivals(result: Fit) -> list[Rival]:
    """Other mountings that explain the used postures, the likeliest first."""
    rig, priors = result.rig, Priors(result.rig, result.postures.motion)
    problem = Problem(result.at, statistic(result.at, result.weight), priors)
    # Half turns about the vertical of any one sensor, any two, all, and all but one; quarter turns.
    n, eye = rig.n, np.eye(rig.n)
    flips = [np.zeros(n), np.ones(n), *eye, *(1 - eye), *(eye / 2), *(-eye / 2)]
    flips += [eye[i] + eye[j] for i in range(n) for j in range(i) if n <= _MANY]
    vertical = np.pi * np.array(flips)[..., None] * np.array([0.0, 0.0, 1.0])
    starts = np.asarray(so3.exp(vertical) @ result.state.rotation)
    scale = max(1.0, result.cost / max(1, result.dof))
    here = result.state.rotation
    found: list[Rival] = []
    for rotation in minima(problem, result.state, starts):
        if apart(rotation, here, rig.axes) <= APART:
            continue
        solution = problem.solved(replace(result.state, rotation=rotation))
        rival = Rival(solution.state, (solution.cost - result.cost) / scale)
        if rival.gap < _NEAR * float(normal_quantile(1 - AMBIGUOUS_MOUNTING)) ** 2:
            again = fit(rig, result.postures, solution.state, result.weight)
            rival = Rival(again.state, (again.cost - result.cost) / scale)
        if apart(rival.state.rotation, here, rig.axes) > APART:
            found.append(rival)
    return sorted(found, key=lambda rival: rival.gap)


def describe(rig: Rig, state: State, rival: State) -> tuple[str, list[str]]:
    """Two mountings: roll, pitch, yaw, rad, of the sensors that differ; and those that do not."""
    differs = _turned(state.rotation, rival.rotation, rig.axes) > APART
    mine, other = (so3.to_rpy(each.rotation) for each in (state, rival))

    def angles(rpy: FloatArray) -> str:
        return f"[{', '.join(f'{value + 0.0:.2f}' for value in rpy)}]"

    each = (
        f"{rig.supports[i]} at roll, pitch, yaw {angles(mine[i])} or {angles(other[i])} rad"
        for i in np.flatnonzero(differs)
    )
    return "; ".join(each), [rig.supports[i] for i in np.flatnonzero(~differs)]


def minima(of: Problem, state: State, starts: FloatArray) -> list[FloatArray]:
    """Distinct minima (n, 3, 3) of the cost over all mountings, the lowest first.

    state : its other parameters are the ones that the search starts from. starts : (T, n, 3, 3).
    """
    rig = of.priors.rig
    axes, root = rig.axes, profile(of, state, mixing=rig.declared.force_sensitivity).root
    found = descend(root, starts, iterations=_DESCENT, tolerance=1e-3)
    order = np.argsort(found.cost, kind="stable")
    limit = _WORTH * float(found.cost[order[0]]) + _MARGIN
    left = found.rotation[order[found.cost[order] <= limit]]
    kept: list[FloatArray] = []
    while len(left) and len(kept) < _OFFERED:
        kept.append(left[0])
        left = left[apart(left, left[0], axes) > APART]
    return kept


def apart(a: FloatArray, b: FloatArray, axes: BoolArray | None = None) -> FloatArray:
    """Largest angle (...,), rad, by which a sensor of mountings a, b (..., n, 3, 3) is turned."""
    return np.asarray(_turned(a, b, axes).max(axis=-1))


def _turned(a: FloatArray, b: FloatArray, axes: BoolArray | None) -> FloatArray:
    """Angle (..., n), rad, of each sensor between mountings a, b (..., n, 3, 3).

    axes : (n, 3), what the sensors measure; a turn about the only axis measured is none.
    """
    cosine = (np.sum(a * b, axis=(-2, -1)) - 1) / 2
    if axes is not None:
        along = np.sum(a * b, axis=-2)  # of each axis with itself
        one = np.sum(np.where(axes, along, 0.0), axis=-1)
        count = axes.sum(axis=1)
        cosine = np.where(count > 1, cosine, np.where(count == 1, one, 1.0))
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))
