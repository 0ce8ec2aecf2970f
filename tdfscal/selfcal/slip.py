"""Did a sensor turn, or its zero jump, within the campaign?

The part of a campaign before a posture is tested against the part from there on, for every posture
and every sensor: if the sensor had another rotation afterwards, by how much would χ² fall? What is
common to both parts (mass, barycentre, hinges, the other sensors, this sensor's zero) stays common,
for a slip in the mounting changes none of them. The same is asked of a jump of the zero, and of a
zero that drifts: under a load that hardly varies a turn about a horizontal axis and a jump look
alike, and what is about as likely is named beside it, whichever sensor's.

Nothing is fitted anew. With the whitened Jacobian J of the fit, its residual r and the columns c of
the suspect, score u = cᵀ(r − J A⁺ Jᵀr) and information I = cᵀc − cᵀJ A⁺ Jᵀc, A = JᵀJ, the statistic
uᵀ I⁺ u is χ² of the rank of I (Rao 1948). All splits follow from sums over the postures' own 3 × 3
and 3 × p blocks, so that the search is linear in their number.

References
----------
Rao C.R. (1948), Large sample tests of statistical hypotheses concerning several parameters. Math.
Proc. Camb. Phil. Soc. 44, 50-57.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.score_tests import NOISE_ONLY, Suspicion, worst_angle
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import INTERVAL_FACTOR, chi2_sf
from tdfscal.numerics.least_squares import ask
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import ROWS, Fit
from tdfscal.significance import CAUSES_APART, WITHIN_CAMPAIGN

#: Postures on either side of a split: one alone is an outlier, not a part of the campaign.
_FEWEST = 2
#: Splits of a long campaign that count as tests of their own: one misplaced by half their distance
#: loses 1.5 % of χ².
_SPLITS = 32
#: Steps that are about as likely as the likeliest, itself among them, named at most.
_NAMED = 6


@record
class _Step:
    """A suspect at its best. group : rotation or zero.

    first : posture (in the order of time) from which it holds. amount, std : (3,), rad in the BCS
    or N in the sensor's frame. move : (p,), of the other parameters with it.
    """

    group: str
    sensor: int
    first: int
    statistic: float
    size: int
    amount: FloatArray
    std: FloatArray
    move: FloatArray


class _Normal:
    """Normal equations of the fit about its estimate, the postures in the order of time.

    counts : (K,), in that order, which of them count.
    """

    def __init__(self, fit: Fit, order: IntArray, counts: BoolArray) -> None:
        fit = replace(fit, weight=counts[np.argsort(order)].astype(np.float64))
        self.fit = fit
        self.design = fit.slopes[order]
        self.active = self.design[..., fit.active]
        white = fit.white
        self.residual = white[: ROWS * len(order)].reshape(-1, ROWS)[order]
        self.root = factored_information(fit).root
        gradient = np.einsum("kra,kr->a", self.active, self.residual)
        gradient += fit.prior_jacobian.T @ fit.prior_residual
        self.pull = self.root.T @ gradient
        self.chi2 = float(white @ white - self.pull @ self.pull)
        rows = ROWS * int(counts.sum()) + len(fit.prior_residual)
        self.dof = rows - self.root.shape[1]

    def step(self, group: str, sensor: int, possible: IntArray) -> _Step:
        """The likeliest change of a sensor's rotation or zero from one of these postures on."""
        sums = [np.cumsum(x[::-1], axis=0)[::-1][possible] for x in self._products(group, sensor)]
        best = self._likeliest(group, sensor, *sums)
        return replace(best, first=int(possible[best.first]))

    def drift(self, sensor: int, shapes: FloatArray) -> _Step:
        """The likeliest drift of a sensor's zero, of some shapes over time (S, K)."""
        cross, own, score = self._products("zero", sensor)
        powers = ((shapes, cross), (shapes**2, own), (shapes, score))
        sums = [np.tensordot(shape, x, axes=1) for shape, x in powers]
        return self._likeliest("zero", sensor, *sums)

    def _block(self, group: str, sensor: int) -> FloatArray:
        at = layout(self.fit.rig.n)[group].start + 3 * sensor
        return self.design[..., at : at + 3]

    def _products(self, group: str, sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Per posture, of a suspect's columns: cᵀJ (K, 3, p), cᵀc (K, 3, 3) and cᵀr (K, 3)."""
        block = self._block(group, sensor)
        across = np.swapaxes(block, 1, 2)
        score = (across @ self.residual[..., None])[..., 0]
        return across @ self.active, across @ block, score

    def _likeliest(
        self, group: str, sensor: int, cross: FloatArray, own: FloatArray, score: FloatArray
    ) -> _Step:
        """The best of suspects with these sums (S, …); first : which of them."""
        known = cross @ self.root
        scale = np.maximum(np.trace(own, axis1=1, axis2=2), np.finfo(float).tiny)
        left = own - known @ np.swapaxes(known, 1, 2)
        asked = ask(left, score - known @ self.pull, NOISE_ONLY * scale)
        best = int(np.argmax(asked.statistic))
        amount = -asked.amount[best]
        move = -self.root @ (self.pull + known[best].T @ amount)
        fall, size = float(asked.statistic[best]), int(asked.unknowns[best])
        # Held against the scatter that remains without the suspect, or it would excuse itself.
        std = asked.std[best] * np.sqrt(max(1.0, self._rest(fall, size)))
        return _Step(group, sensor, best, fall, size, amount, std, move)

    def _rest(self, fall: float, size: int) -> float:
        """χ² per degree of freedom without a suspect of this χ² and size."""
        return float(max(self.chi2 - fall, np.finfo(float).tiny) / max(self.dof - size, 1))

    def p_value(self, step: _Step, *, noise_from_residuals: bool) -> float:
        """That noise alone gives as much, for this suspect alone."""
        rest = self._rest(step.statistic, step.size)
        if noise_from_residuals:
            dof = max(self.dof - step.size, 1)
            return float(fdtrc(step.size, dof, step.statistic / step.size / rest))
        return float(chi2_sf(step.statistic / max(1.0, rest), step.size))


def find_slip(
    of: Estimate[Fit], time: FloatArray, number: IntArray, *, noise_from_residuals: bool = False
) -> Suspicion | None:
    """Look for a sensor that turned, or whose zero jumped, between two postures.

    Parameters
    ----------
    of : the estimate; postures that it leaves out are taken in again where a step explains them
        better than contact at each, a wrench of six unknowns.
    time, number : (K,), s, when each posture was held, and the number that it goes by.
    noise_from_residuals : the noise level itself comes from this fit.

    Returns
    -------
    The step that explains most, or None where noise, an outlier or a drift does as well.
    """
    order = np.argsort(time, kind="stable")
    used = (of.fit.weight > 0)[order]
    unknown = float(np.log(ROWS * len(used)))
    best: tuple[float, list[_Step], float] | None = None
    for counts in [used] if used.all() else [used, np.ones_like(used)]:
        normal = _Normal(of.fit, order, counts)
        found = _most_likely(normal, counts, time[order])
        if found is None:
            continue
        steps, tests = found
        step = steps[0]
        p_value = normal.p_value(step, noise_from_residuals=noise_from_residuals)
        if p_value > WITHIN_CAMPAIGN / tests:
            continue
        ahead = np.inf
        if touched := int(np.sum(counts & ~used)):
            ahead = of.fit.cost + ROWS * touched * unknown
            ahead -= normal.chi2 - step.statistic + step.size * unknown
        if ahead > -CAUSES_APART and (best is None or p_value < best[0]):
            best = p_value, steps, ahead
    return None if best is None else _suspicion(of, time[order], number[order], *best)


def _most_likely(
    normal: _Normal, counts: BoolArray, time: FloatArray
) -> tuple[list[_Step], int] | None:
    """The likeliest step and those about as likely, of any sensor and kind; the number of tests.

    None where a zero that drifts explains more.
    """
    before: IntArray = np.cumsum(counts) - counts
    possible = np.flatnonzero(counts & (before >= _FEWEST) & (counts.sum() - before >= _FEWEST))
    if not len(possible):
        return None
    sensors = range(normal.fit.rig.n)
    ramp = (time - time.mean()) / max(float(np.ptp(time)), np.finfo(float).tiny)
    creep = np.stack([ramp, ramp**2 - np.mean(ramp**2)])
    steps = [normal.step(group, i, possible) for group in ("zero", "rotation") for i in sensors]
    most = max(step.statistic for step in steps)
    if any(normal.drift(i, creep).statistic >= most for i in sensors):
        return None
    near = [step for step in steps if step.statistic > most - CAUSES_APART]
    near.sort(key=lambda step: step.statistic, reverse=True)
    return near[:_NAMED], len(steps) * min(len(possible), _SPLITS)


def _suspicion(
    of: Estimate[Fit],
    time: FloatArray,
    number: IntArray,
    p_value: float,
    steps: list[_Step],
    ahead: float,
) -> Suspicion:
    """Name the steps, the likeliest first, and the angle that they spoil most, before or after.

    ahead : by how much −2 ln L is below that of contact at the postures that are taken in again.
    """
    rig, moves, step = of.fit.rig, [], steps[0]
    for each in steps:
        before = each.move[: 3 * rig.n]
        after = before.copy()
        if each.group == "rotation":
            after[3 * each.sensor : 3 * each.sensor + 3] += each.amount
        moves += [np.abs(before), np.abs(after)]
    shift, harm, angle = worst_angle(rig, of.uncertainty, np.max(moves, axis=0))
    return Suspicion(
        causes=tuple(_cause(rig, each, time, number) for each in steps),
        p_value=p_value,
        shift=shift,
        harm=harm,
        angle=angle,
        kind="slip" if step.group == "rotation" else "jump",
        support=step.sensor,
        tied=ahead < CAUSES_APART,
        weight=step.statistic - step.size * float(np.log(max(of.fit.rows, 2))),
    )


def _cause(rig: Rig, step: _Step, time: FloatArray, number: IntArray) -> Finding:
    """A sensor that turned about the BCS's axes, or whose zero jumped; between two postures.

    time, number : (K,), in the order of time. A row that is one posture has its number for a time.
    """
    values: dict[str, Value] = {
        "change": step.amount.tolist(),
        "change_95": (INTERVAL_FACTOR * step.std).tolist(),
        "posture": int(number[step.first]),
    }
    if not np.array_equal(time, number - 1):
        values["between"] = time[step.first - 1 : step.first + 1].tolist()
    size, subject = float(np.linalg.norm(step.amount)), (rig.supports[step.sensor],)
    if step.group == "rotation":
        return Finding("sensor-slipped", subject, size, "rad", values=values)
    return Finding("zero-jumped", subject, size, "N", values=values)
