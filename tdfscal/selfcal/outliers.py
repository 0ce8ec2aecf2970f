"""Postures that lie apart: a robust loss, those rejected, and each held against the others.

Then postures in contact that hide each other: the fit by the half of them that agree best.

Contacts that push alike at a third of the postures pull the fit to themselves, zeros and angles
with it: then every posture is off, and none stands out. Least trimmed squares do not ask who stands
out, but which half agrees: fits from a few postures drawn at random, each with the half that it
explains best, again and again (concentration); χ² of that half never rises.

References
----------
Rousseeuw, Van Driessen: Computing LTS regression for large data sets. Data Min. Knowl. Discov. 12
(2006) 29–45.
"""

from __future__ import annotations

import numpy as np

from tdfscal.estimation.judged import HeldOut
from tdfscal.findings import Finding
from tdfscal.frozen import field, record
from tdfscal.model.parameters import State, nominal
from tdfscal.model.statics import Postures, balance, features, to_origin
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.least_squares import Spectrum
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import ROWS, Fit, at_state, fit, spread, worth
from tdfscal.selfcal.mounting_search import Rival, best_start, rivals
from tdfscal.significance import OUTLYING_POSTURE

_HEAVY_TAIL = 3.0
_ROUNDS = 12
#: Share of outlying postures up to which they pull the fit too little to hide others.
_FEW = 0.01
#: Times that a lower minimum is gone to.
_MOVES = 3


@record
class RobustFit:
    """A fit, the postures that it leaves out, and the mountings that come near, likeliest first.

    rejected : posture → its evidence.
    """

    fit: Fit
    rejected: dict[int, Finding] = field(default_factory=dict)
    rivals: tuple[Rival, ...] = ()

    @classmethod
    def of(cls, fit: Fit, near: tuple[Rival, ...] = ()) -> RobustFit:
        """A fit with the evidence of the postures that it leaves out."""
        return cls(fit, _rejected(fit), near)


def sound(result: Fit, used: BoolArray) -> BoolArray:
    """Which postures (K,) pass: χ² of the residual against its covariance given the others.

    A posture inside the fit has pulled the fit towards itself; one outside has not. Both are
    tested against what a posture not used would show.
    """
    J = result.at.whitener @ result.jacobian
    e = (result.at.whitener @ result.residual[..., None])[..., 0]
    rows = np.concatenate([J[used].reshape(-1, J.shape[-1]), result.prior_jacobian])
    # pinv and not an inverse: mass, barycentre and zeros together may have a null space.
    leverage = J @ np.linalg.pinv(rows.T @ rows, hermitian=True) @ np.swapaxes(J, 1, 2)
    eye = np.eye(ROWS)
    # Deleted residual e/(1 − h) with covariance (1 − h)⁻¹; for an outsider the covariance is 1 + h.
    inside = eye - leverage
    tame = np.linalg.eigvalsh(inside)[:, 0] > 1e-6  # else the posture determines its own fit
    inside = np.where((used & tame)[:, None, None], inside, eye + leverage)
    d2 = np.einsum("ka,ka->k", e, np.linalg.solve(inside, e[..., None])[..., 0])
    rows = result.at.rows
    scale = spread(d2[used], rows[used]) if used.any() else 1.0
    limit = chi2_quantile(1 - OUTLYING_POSTURE / len(d2), max(1, int(np.median(rows))))
    return np.asarray(d2 <= limit * scale)


def fit_robust(rig: Rig, postures: Postures, start: State | None = None) -> RobustFit:
    """Fit with the postures that do not belong left out, each with its evidence.

    start : where to begin; by default the lowest minimum over all mountings. Where the postures
    that are left have a lower one elsewhere, it is gone to.
    """
    begin = best_start(rig, postures).state if start is None else start
    result = _fit_from(rig, postures, begin)
    near = rivals(result)
    for _ in range(_MOVES):
        if not near or near[0].gap >= 0:
            break
        other = _fit_from(rig, postures, near[0].state)
        if other.cost / max(1, other.dof) >= result.cost / max(1, result.dof):
            break
        result, near = other, rivals(other)
    return RobustFit.of(result, tuple(near))


def _fit_from(rig: Rig, postures: Postures, start: State) -> Fit:
    """Fit from one start; postures that fail are left out until no verdict changes."""
    everyone = np.ones(len(postures), dtype=bool)
    result = fit(rig, postures, start)
    used = sound(result, everyone)
    if used.all():
        return result
    if np.mean(~used) > _FEW:
        result = fit(rig, postures, result.state)
        for _ in range(_ROUNDS):  # Student's weights
            d2 = result.distance / result.misfit
            weight = (_HEAVY_TAIL + result.at.rows) / (_HEAVY_TAIL + d2)
            result = fit(rig, postures, result.state, weight)
        used = sound(result, everyone)
    return settled(rig, postures, fit(rig, postures, result.state, used.astype(np.float64)))


def settled(rig: Rig, postures: Postures, result: Fit) -> Fit:
    """Fit anew with the postures that pass until no verdict changes; result : by some of them."""
    for _ in range(_ROUNDS):
        used = result.weight > 0
        passed = sound(result, used)
        if (passed == used).all():
            break
        result = fit(rig, postures, result.state, passed.astype(np.float64))
    return result


def _rejected(result: Fit) -> dict[int, Finding]:
    """Name the postures of weight 0 with their residual wrench (moment about the LCS origin)."""
    scale = spread(result.distance[result.weight > 0], result.at.rows)
    found, out = {}, np.flatnonzero(result.weight == 0)
    wrenches = to_origin(result.at)[out] @ result.residual[out][..., None]
    for k, wrench in zip(out, wrenches[..., 0], strict=True):
        force, moment = (np.linalg.norm(part) for part in np.split(wrench, 2))
        ratio = np.sqrt(result.distance[k] / (result.at.rows[k] * scale))
        found[int(k)] = Finding(
            "posture-misfits",
            size=float(force),
            unit="N",
            values={"moment": float(moment), "ratio": float(ratio)},
        )
    return found


def cross_validate(fit: Fit, parts: Spectrum) -> HeldOut:
    """Leave each used posture out in turn.

    The deleted residual is (I − H_kk)⁻¹ e_k with H_kk = J_k (JᵀJ)⁺ J_kᵀ in whitened units: the
    refit without posture k to the second order of its change, without refitting.
    """
    used = np.flatnonzero(fit.weight > 0)
    L = np.linalg.cholesky(fit.at.cov[used])
    J = np.linalg.solve(L, fit.jacobian[used]) @ parts.root
    e = np.linalg.solve(L, fit.residual[used][..., None])
    # pinv: a posture that alone carries a direction predicts nothing there.
    apart = L @ np.linalg.pinv(np.eye(ROWS) - J @ np.swapaxes(J, 1, 2), hermitian=True)

    rig, start = fit.rig, nominal(fit.rig, fit.postures.motions)
    at = balance(fit.postures, start, rig.barycentre.value, rig.gravity)
    before = (at.design @ features(start, at, rig.gravity))[used]
    both = to_origin(at)[used] @ before[..., None], to_origin(fit.at)[used] @ apart @ e
    return HeldOut(*(np.linalg.norm(e.reshape(-1, 2, 3), axis=2) for e in both))


#: Random starts, of so many postures each: with a third of them touched, four are clean in one of
#: six. Steps of each, linear; the best that are followed to their end, and their steps.
_STARTS, _DRAWN, _STEPS = 100, 4, 5
_FOLLOWED, _FITS = 3, 3
#: Postures that are searched, drawn of more: they agree as all do.
_SEARCHED = 1000


def hidden_contact(rig: Rig, postures: Postures, whole: Fit) -> RobustFit | None:
    """The fit by the postures that agree, less than half of them left out; None where none are.

    whole : the fit by all of them, every weight 1.
    """
    K, rng = len(postures), np.random.default_rng(0)
    if _half(K) < 2 * _DRAWN:
        return None
    some = np.arange(K) if K <= _SEARCHED else np.sort(rng.choice(K, _SEARCHED, replace=False))
    few, best = postures.subset(some), None
    for used in _agreeing(whole, some, rng)[:_FOLLOWED]:
        found = fit(rig, few, whole.state, used.astype(np.float64))
        for _ in range(_FITS):
            found = fit(rig, few, found.state, _nearest(found.distance).astype(np.float64))
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    if len(some) < K:
        every = at_state(rig, postures, best.state, np.ones(K))
        best = fit(rig, postures, best.state, _nearest(every.distance).astype(np.float64))
    result = settled(rig, postures, best)
    out = int(np.sum(result.weight == 0))
    return RobustFit.of(result) if 0 < out <= K - _half(K) else None


def _half(count: int) -> int:
    """More than half of so many."""
    return count // 2 + 1


def _nearest(distance: FloatArray) -> BoolArray:
    """More than half of the postures (K,), those of the least distance."""
    near = np.zeros(len(distance), dtype=np.bool_)
    near[np.argsort(distance)[: _half(len(distance))]] = True
    return near


def contact_worth(of: Fit, whole: Fit) -> float:
    """Of the fit without some postures: each that is left out has six unknowns, its own wrench."""
    return worth(whole, of, ROWS * int(np.sum(of.weight == 0)), of.weight)


def _agreeing(whole: Fit, some: IntArray, rng: np.random.Generator) -> list[BoolArray]:
    """Halves of some postures that agree, as the linearised fit has it; the best first."""
    white, J = whole.whitened()
    rows = ROWS * len(whole.weight)
    prior_r, prior_J = white[rows:], J[rows:]
    r, J = white[:rows].reshape(-1, ROWS)[some], J[:rows].reshape(-1, ROWS, J.shape[1])[some]
    own, pull = np.swapaxes(J, 1, 2) @ J, np.einsum("kap,ka->kp", J, r)

    def distances(used: BoolArray) -> FloatArray:
        normal = own[used].sum(axis=0) + prior_J.T @ prior_J
        step = np.linalg.pinv(normal, hermitian=True) @ (
            pull[used].sum(axis=0) + prior_J.T @ prior_r
        )
        return np.asarray(np.sum((r - J @ step) ** 2, axis=1))

    found: dict[bytes, tuple[float, BoolArray]] = {}
    for _ in range(_STARTS):
        used = np.zeros(len(some), dtype=np.bool_)
        used[rng.choice(len(some), _DRAWN, replace=False)] = True
        for _ in range(_STEPS):
            used = _nearest(distances(used))
        found[used.tobytes()] = float(distances(used)[used].sum()), used
    return [used for _, used in sorted(found.values(), key=lambda each: each[0])]
