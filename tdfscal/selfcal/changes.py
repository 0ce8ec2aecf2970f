"""Did a sensor turn within the campaign, did its zero jump, or did a contact stay?

The part of a campaign before a posture is tested against the part from there on, for every posture
and every sensor: if the sensor had another rotation afterwards, by how much would χ² fall? What is
common to both parts (mass, barycentre, hinges, the other sensors, this sensor's zero) stays common,
for a slip in the mounting changes none of them. The same is asked of a jump of the zero, and of a
zero that drifts: under a load that hardly varies a turn about a horizontal axis and a jump look
alike, and what is about as likely is named beside it, whichever sensor's.

A contact that stays over a run of postures moves the readings of all sensors as one wrench has it:
a constant one of the terminal (six unknowns, LCS), or a force that the base's frame holds at a
point of the terminal, as a rope or a load does: e_F += f, e_M += R l × f, linear in f and l fᵀ
(twelve). Every run between two postures is asked for; a long campaign's on a grid, then finer.

Nothing is fitted anew. With the whitened Jacobian J of the fit, its residual r and the columns c of
the suspect, score u = cᵀ(r − J A⁺ Jᵀr) and information I = cᵀc − cᵀJ A⁺ Jᵀc, A = JᵀJ, the statistic
uᵀ I⁺ u is χ² of the rank of I (Rao 1948). All splits follow from sums over the postures' own 3 × 3
and 3 × p blocks, so that the search is linear in their number. Of all suspects the likeliest is
named, by the fall of −2 ln L less q ln N for q unknowns (Schwarz).

References
----------
Rao C.R. (1948), Large sample tests of statistical hypotheses concerning several parameters. Math.
Proc. Camb. Phil. Soc. 44, 50-57.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.special import fdtrc

from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.score_tests import NOISE_ONLY, Suspicion, worst_by_either_end
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import INTERVAL_FACTOR, chi2_sf
from tdfscal.numerics.least_squares import ask
from tdfscal.records import BoolArray, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import ROWS, Fit
from tdfscal.significance import CAUSES_APART, MOST_REJECTED, STAYING_CONTACT, WITHIN_CAMPAIGN

#: Postures on either side of a split: one alone is an outlier, not a part of the campaign.
_FEWEST = 2
#: Splits of a long campaign that count as tests of their own: one misplaced by half their distance
#: loses 1.5 % of χ². Of a run's ends as many are looked at together.
_SPLITS = 32
#: By how much finer a grid of ends is than the one before.
_FINER = 8
#: Changes that are about as likely as the likeliest, itself among them, named at most.
_NAMED = 6
#: Kind of a suspicion by what changed.
_KINDS = {"rotation": "slip", "zero": "jump", "LCS": "contact", "BCS": "contact"}


@record
class _Change:
    """A suspect at its best.

    what : rotation or zero of a sensor, or LCS or BCS, the frame of a wrench. first, last : from
    which posture (in the order of time) it holds, and from which no more. amount, std : rad in the
    BCS or N in the sensor's frame, (3,); of a wrench (6,) or (12,), the force first. move : (p,),
    of the other parameters with it. worth : fall of −2 ln L less what its unknowns are worth.
    """

    what: str
    sensor: int
    first: int
    last: int
    statistic: float
    size: int
    amount: FloatArray
    std: FloatArray
    move: FloatArray
    worth: float


class _Normal:
    """Normal equations of the fit about its estimate, the postures in the order of time.

    counts : (K,), in that order, which of them count.
    """

    def __init__(self, fit: Fit, order: IntArray, counts: BoolArray) -> None:
        fit = replace(fit, weight=counts[np.argsort(order)].astype(np.float64))
        self.fit, self.order, self.counts = fit, order, counts
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
        self.unknown = float(np.log(ROWS * len(order)))

    def step(self, group: str, sensor: int, possible: IntArray) -> _Change:
        """The likeliest change of a sensor's rotation or zero from one of these postures on."""
        sums = [np.cumsum(x[::-1], axis=0)[::-1][possible] for x in self._products(group, sensor)]
        best = self._likeliest(group, sensor, *sums)
        return replace(best, first=int(possible[best.first]), last=len(self.order))

    def drift(self, sensor: int, shapes: FloatArray) -> _Change:
        """The likeliest drift of a sensor's zero, of some shapes over time (S, K)."""
        cross, own, score = self._products("zero", sensor)
        powers = ((shapes, cross), (shapes**2, own), (shapes, score))
        sums = [np.tensordot(shape, x, axes=1) for shape, x in powers]
        return self._likeliest("zero", sensor, *sums)

    def contact(self, frame: str) -> _Change | None:
        """The likeliest wrench that stayed over a run of postures; None where there are too few."""
        at = self.fit.at
        if frame == "BCS":
            wrench = at.design[..., 12 * self.fit.rig.n :][..., :12]
        else:
            wrench = np.zeros((len(self.order), ROWS, 6))
            wrench[:, :3, :3] = wrench[:, 3:, 3:] = at.rotation
        columns = (self.fit.root @ wrench)[self.order]
        ends = np.append(np.flatnonzero(self.counts), len(self.order))
        each = np.concatenate([self.active, columns, self.residual[..., None]], axis=2)
        apart = max(1, len(ends) // _SPLITS)
        some = np.unique([*range(0, len(ends), apart), len(ends) - 1])
        while (found := self._run(frame, columns, each, ends, some)) and apart > 1:
            best = np.searchsorted(ends, [found.first, found.last])[:, None]
            finer = max(1, apart // _FINER)
            some = np.unique(best + np.unique([0, *range(-apart, apart + 1, finer)]))
            some = some[(some >= 0) & (some < len(ends))]
            apart = finer
        return found

    def _run(
        self, frame: str, columns: FloatArray, each: FloatArray, ends: IntArray, some: IntArray
    ) -> _Change | None:
        """The likeliest run between two of some ends.

        columns : (K, 6, c), of its wrench. each : (K, 6, p + c + 1), the fit's, these, residuals.
        ends : of postures that count, and the last.
        """
        i, j = np.triu_indices(len(some), 1)
        inside = some[j] - some[i]
        enough = (inside >= _FEWEST) & (len(ends) - 1 - inside >= _FEWEST)
        i, j = i[enough], j[enough]
        if not len(i):
            return None
        cut, at = ROWS * ends[some], np.cumsum([self.active.shape[2], columns.shape[2]])
        flat, by = each.reshape(-1, each.shape[2]), columns.reshape(-1, columns.shape[2])
        parts = [by[a:b].T @ flat[a:b] for a, b in pairwise(cut)]
        total = np.cumsum([np.zeros_like(parts[0]), *parts], axis=0)
        cross, own, score = np.split(total[j] - total[i], at, axis=2)
        best = self._likeliest(frame, 0, cross, own, score[..., 0])
        first, last = (int(ends[some[end[best.first]]]) for end in (i, j))
        return replace(best, first=first, last=last)

    def _products(self, group: str, sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Per posture, of a suspect's columns: cᵀJ (K, 3, p), cᵀc (K, 3, 3) and cᵀr (K, 3)."""
        start = layout(self.fit.rig.n)[group].start + 3 * sensor
        block = self.design[..., start : start + 3]
        across = np.swapaxes(block, 1, 2)
        score = (across @ self.residual[..., None])[..., 0]
        return across @ self.active, across @ block, score

    def _likeliest(
        self, what: str, sensor: int, cross: FloatArray, own: FloatArray, score: FloatArray
    ) -> _Change:
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
        worth = fall - size * self.unknown
        return _Change(what, sensor, best, 0, fall, size, amount, std, move, worth)

    def _rest(self, fall: float, size: int) -> float:
        """χ² per degree of freedom without a suspect of this χ² and size."""
        return float(max(self.chi2 - fall, np.finfo(float).tiny) / max(self.dof - size, 1))

    def p_value(self, change: _Change) -> float:
        """That noise alone gives as much, for this suspect alone."""
        rest = self._rest(change.statistic, change.size)
        if self.fit.postures.noise_from_residuals:
            dof = max(self.dof - change.size, 1)
            return float(fdtrc(change.size, dof, change.statistic / change.size / rest))
        return float(chi2_sf(change.statistic / max(1.0, rest), change.size))


def find_change(of: Estimate[Fit], time: FloatArray, number: IntArray) -> Suspicion | None:
    """Look for a sensor that turned, a zero that jumped, or a contact that stayed.

    Parameters
    ----------
    of : the estimate; postures that it leaves out are taken in again where a change explains them
        better than contact at each, a wrench of six unknowns.
    time, number : (K,), s, when each posture was held, and the number that it goes by.

    Returns
    -------
    The change that explains most, or None where noise, an outlier or a drift does as well.
    """
    order = np.argsort(time, kind="stable")
    used = (of.fit.weight > 0)[order]
    best: tuple[float, list[_Change], float, bool] | None = None
    for counts in [used] if used.all() else [used, np.ones_like(used)]:
        normal = _Normal(of.fit, order, counts)
        found = _most_likely(normal, time[order], used)
        if found is None:
            continue
        changes, level = found
        change = changes[0]
        p_value = normal.p_value(change)
        if p_value > level:
            continue
        ahead, touched = change.worth, int(np.sum(counts & ~used))
        if touched:  # of contact at each of them, whose deviance is that of the estimate
            ahead += of.fit.cost + ROWS * touched * normal.unknown - normal.chi2
        if ahead > -CAUSES_APART and (best is None or ahead > best[0]):
            best = ahead, changes, p_value, bool(touched) and ahead < CAUSES_APART
    return None if best is None else _suspicion(of, time[order], number[order], *best)


def _most_likely(
    normal: _Normal, time: FloatArray, used: BoolArray
) -> tuple[list[_Change], float] | None:
    """The likeliest change and those about as likely, and the level of its test.

    None where a zero that drifts explains more. used : (K,), postures that the estimate is by.
    """
    counts, sensors = normal.counts, range(normal.fit.rig.n)
    before: IntArray = np.cumsum(counts) - counts
    possible = np.flatnonzero(counts & (before >= _FEWEST) & (counts.sum() - before >= _FEWEST))
    if not len(possible):
        return None
    ramp = (time - time.mean()) / max(float(np.ptp(time)), np.finfo(float).tiny)
    creep = np.stack([ramp, ramp**2 - np.mean(ramp**2)])
    changes = [normal.step(group, i, possible) for group in ("zero", "rotation") for i in sensors]
    splits = min(len(possible), _SPLITS)
    level = WITHIN_CAMPAIGN / (len(changes) * splits)
    runs = [normal.contact(frame) for frame in ("LCS", "BCS")]
    # Postures that are out already spoil nothing, as long as they are few.
    many = np.sum(~used) > MOST_REJECTED * len(used)
    changes += [run for run in runs if run and (many or used[run.first : run.last].any())]
    changes.sort(key=lambda change: change.worth, reverse=True)
    best = changes[0]
    if _KINDS[best.what] == "contact":
        level = STAYING_CONTACT / (len(runs) * splits**2 / 2)
    if any(normal.drift(i, creep).worth >= best.worth for i in sensors):
        return None
    near = [change for change in changes if change.worth > best.worth - CAUSES_APART]
    return near[:_NAMED], level


def _suspicion(
    of: Estimate[Fit],
    time: FloatArray,
    number: IntArray,
    weight: float,
    changes: list[_Change],
    p_value: float,
    tied: bool,
) -> Suspicion:
    """Name the changes, the likeliest first, and the angle that they spoil most by either end."""
    rig, best = of.fit.rig, changes[0]
    turns = ((c.move, c.sensor if c.what == "rotation" else None, c.amount) for c in changes)
    shift, harm, angle = worst_by_either_end(rig, of.uncertainty, turns)
    return Suspicion(
        causes=tuple(_cause(rig, each, time, number) for each in changes),
        p_value=p_value,
        shift=shift,
        harm=harm,
        angle=angle,
        kind=_KINDS[best.what],
        support=best.sensor,
        tied=tied,
        weight=weight,
    )


def _cause(rig: Rig, change: _Change, time: FloatArray, number: IntArray) -> Finding:
    """A sensor that turned about the BCS's axes, whose zero jumped, or what pushed; and when.

    time, number : (K,), in the order of time. A row that is one posture has its number for a time.
    """
    first, last = change.first, change.last
    values: dict[str, Value] = {"posture": int(number[first])}
    timed = not np.array_equal(time, number - 1)
    size, subject = float(np.linalg.norm(change.amount[:3])), (rig.supports[change.sensor],)
    values |= {
        "change": change.amount[:3].tolist(),
        "change_95": (INTERVAL_FACTOR * change.std[:3]).tolist(),
    }
    if _KINDS[change.what] == "contact":
        values |= {"last": int(number[last - 1]), "frame": change.what}
        if timed:
            values["between"] = time[[first, last - 1]].tolist()
        return Finding("contact-stays", (), size, "N", values=values)
    if timed:
        values["between"] = time[first - 1 : first + 1].tolist()
        values["cut"] = float(time[first - 1 : first + 1].mean())  # middles: the move lies between
    if change.what == "rotation":
        return Finding("sensor-slipped", subject, size, "rad", values=values)
    return Finding("zero-jumped", subject, size, "N", values=values)
