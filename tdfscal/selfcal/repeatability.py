"""Did the machine stay what it was? Drift over the campaign, and postures visited again.

Raw readings of a posture visited twice differ by hundreds of newtons, since the NCPs stand some
micrometres elsewhere and squeeze the terminal. The residual wrench of the fit is free of that: it
sees internal forces only through errors of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdfscal.numerics.distributions import chi2_sf, p_text
from tdfscal.records import BoolArray, FloatArray, IntArray
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

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.force:.2g} N and {self.moment:.2g} N·m ({p_text(self.p_value)})"


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
    def warnings(self) -> list[str]:
        """What is more than noise."""
        found = []
        if self.drift.p_value < CHANGED_RIG:
            found.append(
                f"the unexplained wrench drifts by {self.drift.text} over the campaign: warm up "
                "longer, tare just before, or record faster"
            )
        if self.hysteresis is not None and self.hysteresis.p_value < CHANGED_RIG:
            found.append(
                f"postures reached from opposite sides differ by {self.hysteresis.text}: hinge "
                "friction or backlash (declare uncertainty.hinge_moment)"
            )
        elif self.repeat is not None and self.repeat.p_value < CHANGED_RIG:
            found.append(
                f"postures visited again differ by {self.repeat.text}: the machine or its sensors "
                "changed between the visits"
            )
        return found


def examine(fit: Fit, time: FloatArray) -> Stability:
    """Look at the residuals in the order of time (K,), s."""
    order = np.argsort(time[fit.weight > 0], kind="stable")
    used = np.flatnonzero(fit.weight > 0)[order]
    e, C, t = fit.residual[used], fit.at.cov[used], time[used]
    first, second = _returns(fit.postures.position[used])
    opposite = _opposite(fit.postures.position[used], first, second)
    every = np.ones(len(first), dtype=bool)
    return Stability(
        drift=_trend(e, C, t),
        returns=len(first),
        repeat=_difference(e, C, first, second, every),
        hysteresis=_difference(e, C, first, second, opposite),
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


def _returns(position: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs (earlier, later) of visits to one place, not one right after the other.

    Postures in the order of one coordinate are compared with those next to them only. Where a
    place is visited very often, `_PAIRS` of its pairs say as much as all.
    """
    flat = position.reshape(len(position), -1)
    order = np.argsort(flat[:, np.argmax(np.ptp(flat, axis=0))], kind="stable")
    along = flat[order, np.argmax(np.ptp(flat, axis=0))]
    found: list[IntArray] = []
    count = 0
    for step in range(1, len(position)):
        near = np.flatnonzero(along[step:] - along[:-step] < SAME_PLACE)
        if not len(near) or count > _PAIRS:
            break
        a, b = order[near], order[near + step]
        same = np.abs(flat[a] - flat[b]).max(axis=1) < SAME_PLACE
        first, second = np.minimum(a, b)[same], np.maximum(a, b)[same]
        found.append(np.stack([first, second])[:, second - first > 1])
        count += found[-1].shape[1]
    pairs = np.concatenate([np.zeros((2, 0), dtype=np.int64), *found], axis=1)
    pairs = pairs[:, np.lexsort(pairs[::-1])]
    return pairs[0], pairs[1]


def _opposite(position: FloatArray, first: IntArray, second: IntArray) -> BoolArray:
    """Which pairs were reached from opposite sides."""
    came = np.diff(position, axis=0, prepend=position[:1]).reshape(len(position), -1)
    return np.asarray(np.einsum("pa,pa->p", came[first], came[second]) < 0)


def _difference(
    e: FloatArray, C: FloatArray, first: IntArray, second: IntArray, which: BoolArray
) -> Change | None:
    """Quadratic mean change between the visits of the pairs chosen."""
    a, b = first[which], second[which]
    if len(a) == 0:
        return None
    d = e[b] - e[a]
    chi2 = float(np.einsum("pa,pa->", d, np.linalg.solve(C[a] + C[b], d[..., None])[..., 0]))
    rms = np.sqrt(np.mean(d**2, axis=0))
    return _change(rms, chi2, ROWS * len(a))
