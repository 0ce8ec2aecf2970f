"""Postures that do not belong: found, named with their evidence, and left out.

A posture in contact, a hand on the terminal or a jolt adds a wrench that no parameter explains.
The fit starts with weights that fall with the residual (Student's t with few degrees of freedom),
so that a few bad postures cannot hide each other, and ends with plain maximum likelihood on the
postures that pass a χ² test whose false alarms are set for the campaign as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tdfscal.findings import Finding
from tdfscal.model.parameters import State
from tdfscal.model.statics import Postures
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.records import BoolArray, Rig
from tdfscal.selfcal.estimator import ROWS, Fit, fit, spread
from tdfscal.selfcal.mounting_search import Rival, best_start, rivals
from tdfscal.significance import OUTLYING_POSTURE

_HEAVY_TAIL = 3.0
_ROUNDS = 12
#: Times that a lower minimum is gone to.
_MOVES = 3


@dataclass(frozen=True, slots=True)
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
    if sound(result, everyone).all():
        return result
    result = _reweighted(rig, postures, result.state)
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


def _reweighted(rig: Rig, postures: Postures, start: State) -> Fit:
    """Few rounds of iteratively re-weighted least squares with Student's weights."""
    result = fit(rig, postures, start)
    for _ in range(_ROUNDS):
        d2 = result.distance / spread(result.distance, result.at.rows)
        result = fit(
            rig, postures, result.state, (_HEAVY_TAIL + result.at.rows) / (_HEAVY_TAIL + d2)
        )
    return result


def _rejected(result: Fit) -> dict[int, Finding]:
    """Name the postures of weight 0 with their residual wrench (moment about the barycentre)."""
    scale = spread(result.distance[result.weight > 0], result.at.rows)
    found = {}
    for k in np.flatnonzero(result.weight == 0):
        force, moment = (np.linalg.norm(part) for part in np.split(result.residual[k], 2))
        ratio = np.sqrt(result.distance[k] / (result.at.rows[k] * scale))
        found[int(k)] = Finding(
            "posture-misfits",
            size=float(force),
            unit="N",
            values={"moment": float(moment), "ratio": float(ratio)},
        )
    return found
