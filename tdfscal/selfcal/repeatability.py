"""Did the machine stay what it was? Drift over the campaign, and postures visited again.

Raw readings of a posture visited twice differ by hundreds of newtons, since the NCPs stand some
micrometres elsewhere and squeeze the terminal. The residual wrench of the fit is free of that: it
sees internal forces only through errors of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.findings import Finding
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import FloatArray, IntArray
from tdfscal.selfcal.estimator import ROWS, Fit
from tdfscal.significance import CHANGED_RIG

#: Two dwells are one posture when every NCP stands within this distance, m. A squeeze moves NCPs
#: by micrometres and is no other posture for this purpose, a tilt of 0.1 mrad is.
SAME_PLACE = 5e-5
#: Pairs of visits that are looked at, at most.
_PAIRS = 200_000


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the residual wrench, its length and a test against chance.

    force : N. moment : N·m. p_value : that noise alone changes as much.
    """

    force: float
    moment: float
    p_value: float

    def finding(self, code: str) -> Finding:
        """As a finding; its size is that of the force."""
        return Finding(code, (), self.force, "N", self.p_value, values={"moment": self.moment})


@dataclass(frozen=True, slots=True)
class Stability:
    """What the campaign says of drift and hysteresis.

    drift : linear trend from the first posture to the last. returns : number of times a posture
    was visited again. repeat : quadratic mean change between visits; hysteresis : the part between
    visits that came from opposite sides. None where the campaign does not return.
    """

    drift: Change
    returns: int
    repeat: Change | None
    hysteresis: Change | None

    @property
    def findings(self) -> list[Finding]:
        """What is more than noise."""
        found = []
        if self.drift.p_value < CHANGED_RIG:
            found.append(self.drift.finding("wrench-drifts"))
        if self.hysteresis is not None and self.hysteresis.p_value < CHANGED_RIG:
            found.append(self.hysteresis.finding("postures-hysteresis"))
        elif self.repeat is not None and self.repeat.p_value < CHANGED_RIG:
            found.append(self.repeat.finding("postures-changed"))
        return found


def examine(fit: Fit, time: FloatArray) -> Stability:
    """Look at the residuals in the order of time (K,), s."""
    order = np.argsort(time[fit.weight > 0], kind="stable")
    used = np.flatnonzero(fit.weight > 0)[order]
    e, C, t = fit.residual[used], fit.at.cov[used], time[used]
    place = fit.postures.position[used].reshape(len(used), -1)
    pairs, came = _returns(place), np.diff(place, axis=0, prepend=place[:1])
    opposite = np.einsum("pa,pa->p", came[pairs[0]], came[pairs[1]]) < 0
    return Stability(
        drift=_trend(e, C, t),
        returns=pairs.shape[1],
        repeat=_difference(e, C, *pairs),
        hysteresis=_difference(e, C, *pairs[:, opposite]),
    )


def _trend(e: FloatArray, C: FloatArray, t: FloatArray) -> Change:
    """Weighted slope of e (K, 6) over the campaign."""
    span = np.ptp(t)
    x = (t - t.mean()) / (span if span > 0 else 1.0)
    W = np.linalg.inv(C)
    information = np.einsum("k,kab->ab", x**2, W)
    if not span > 0 or len(t) < 3:
        return Change(0.0, 0.0, 1.0)
    slope = np.linalg.solve(information, np.einsum("k,kab,kb->a", x, W, e))
    return _change(slope, float(slope @ information @ slope), ROWS)


def _change(wrench: FloatArray, chi2: float, dof: int) -> Change:
    lengths = np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])
    return Change(float(lengths[0]), float(lengths[1]), float(chi2_sf(chi2, dof)))


def _returns(place: FloatArray) -> IntArray:
    """Pairs (2, m), earlier and later, of visits to one place, not one right after the other.

    Postures (K, 3n) in the order of one coordinate are compared with those next to them only. Where
    a place is visited very often, `_PAIRS` of its pairs say as much as all.
    """
    widest = place[:, np.argmax(np.ptp(place, axis=0))]
    order = np.argsort(widest, kind="stable")
    along = widest[order]
    pairs = np.zeros((2, 0), dtype=np.int64)
    for step in range(1, len(place)):
        near = np.flatnonzero(along[step:] - along[:-step] < SAME_PLACE)
        if not len(near) or pairs.shape[1] > _PAIRS:
            break
        found = np.sort([order[near], order[near + step]], axis=0)
        same = np.abs(place[found[0]] - place[found[1]]).max(axis=1) < SAME_PLACE
        pairs = np.hstack([pairs, found[:, same & (found[1] - found[0] > 1)]])
    return pairs[:, np.lexsort(pairs[::-1])]


def _difference(e: FloatArray, C: FloatArray, a: IntArray, b: IntArray) -> Change | None:
    """Quadratic mean change between the visits a and b."""
    if len(a) == 0:
        return None
    d = e[b] - e[a]
    chi2 = float(np.einsum("pa,pa->", d, np.linalg.solve(C[a] + C[b], d[..., None])[..., 0]))
    return _change(np.sqrt(np.mean(d**2, axis=0)), chi2, ROWS * len(a))
