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

All splits follow from sums over the postures' own 3 × 3 and 3 × p blocks, so that the search is
linear in their number.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.special import fdtrc

from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.judged import Change, ChangeSearch, change_suspicion
from tdfscal.estimation.score_tests import Suspicion
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.findings import Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import layout
from tdfscal.numerics.distributions import chi2_sf
from tdfscal.records import BoolArray, FloatArray, IntArray
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


@record(kw_only=True)
class _Run(Change):
    """A change that holds from a posture (in the order of time) on, and from `last` no more."""

    first: int
    last: int

    @classmethod
    def of(cls, change: Change, first: int, last: int) -> _Run:
        """A change with its postures."""
        return cls(**vars(change), first=first, last=last)


class _Search(ChangeSearch):
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
        root = factored_information(fit).root
        gradient = np.einsum("kra,kr->a", self.active, self.residual)
        pull = root.T @ (gradient + fit.prior_jacobian.T @ fit.prior_residual)
        dof = ROWS * int(counts.sum()) + len(fit.prior_residual) - root.shape[1]
        super().__init__(root, ROWS * len(order), pull, float(white @ white - pull @ pull), dof)

    def step(self, group: str, sensor: int, possible: IntArray) -> _Run:
        """The likeliest change of a sensor's rotation or zero from one of these postures on."""
        sums = [np.cumsum(x[::-1], axis=0)[::-1][possible] for x in self._products(group, sensor)]
        best = self.likeliest(group, sensor, *sums)
        return _Run.of(best, int(possible[best.which]), len(self.order))

    def drift(self, sensor: int, shapes: FloatArray) -> Change:
        """The likeliest drift of a sensor's zero, of some shapes over time (S, K)."""
        cross, own, score = self._products("zero", sensor)
        powers = ((shapes, cross), (shapes**2, own), (shapes, score))
        sums = [np.tensordot(shape, x, axes=1) for shape, x in powers]
        return self.likeliest("zero", sensor, *sums)

    def contact(self, frame: str) -> _Run | None:
        """The likeliest wrench that stayed over a run of postures; None where there are too few."""
        fit, columns = self.fit, self.fit.by_wrench
        if frame == "BCS":
            columns = fit.root @ fit.at.design[..., 12 * fit.rig.n :][..., :12]
        columns = columns[self.order]
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
    ) -> _Run | None:
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
        best = self.likeliest(frame, 0, cross, own, score[..., 0])
        first, last = (int(ends[some[end[best.which]]]) for end in (i, j))
        return _Run.of(best, first, last)

    def _products(self, group: str, sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Per posture, of a suspect's columns: cᵀJ (K, 3, p), cᵀc (K, 3, 3) and cᵀr (K, 3)."""
        start = layout(self.fit.rig.n)[group].start + 3 * sensor
        block = self.design[..., start : start + 3]
        across = np.swapaxes(block, 1, 2)
        score = (across @ self.residual[..., None])[..., 0]
        return across @ self.active, across @ block, score

    def p_value(self, change: Change) -> float:
        """That noise alone gives as much, for this suspect alone."""
        fall, size = change.statistic, change.unknowns
        rest = self.scatter(fall, size)
        if self.fit.postures.noise_from_residuals:
            return float(fdtrc(size, max(self.dof - size, 1), fall / size / rest))
        return float(chi2_sf(fall / max(1.0, rest), size))


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
    best: tuple[float, list[_Run], float, bool] | None = None
    for counts in [used] if used.all() else [used, np.ones_like(used)]:
        search = _Search(of.fit, order, counts)
        found = _most_likely(search, time[order], used)
        if found is None:
            continue
        changes, level = found
        change = changes[0]
        p_value = search.p_value(change)
        if p_value > level:
            continue
        ahead, touched = change.worth, int(np.sum(counts & ~used))
        if touched:  # of contact at each of them, whose deviance is that of the estimate
            ahead += of.fit.cost + ROWS * touched * search.unknown - search.chi2
        # Postures that are out already need no other cause that explains them less well.
        if ahead > (0.0 if touched else -CAUSES_APART) and (best is None or ahead > best[0]):
            best = ahead, changes, p_value, bool(touched) and ahead < CAUSES_APART
    if best is None:
        return None
    weight, changes, p_value, tied = best
    causes = [each.cause(of.fit.rig, **_when(each, time[order], number[order])) for each in changes]
    return change_suspicion(of, changes, causes, p_value=p_value, weight=weight, tied=tied)


def _most_likely(
    search: _Search, time: FloatArray, used: BoolArray
) -> tuple[list[_Run], float] | None:
    """The likeliest change and those about as likely, and the level of its test.

    None where a zero that drifts explains more. used : (K,), postures that the estimate is by.
    """
    counts, sensors = search.counts, range(search.fit.rig.n)
    before: IntArray = np.cumsum(counts) - counts
    possible = np.flatnonzero(counts & (before >= _FEWEST) & (counts.sum() - before >= _FEWEST))
    if not len(possible):
        return None
    ramp = (time - time.mean()) / max(float(np.ptp(time)), np.finfo(float).tiny)
    creep = np.stack([ramp, ramp**2 - np.mean(ramp**2)])
    changes = [search.step(group, i, possible) for group in ("zero", "rotation") for i in sensors]
    splits = min(len(possible), _SPLITS)
    level = WITHIN_CAMPAIGN / (len(changes) * splits)
    runs = [search.contact(frame) for frame in ("LCS", "BCS")]
    # Postures that are out already spoil nothing, as long as they are few.
    many = np.sum(~used) > MOST_REJECTED * len(used)
    changes += [run for run in runs if run and (many or used[run.first : run.last].any())]
    changes.sort(key=lambda change: change.worth, reverse=True)
    best = changes[0]
    if best.kind == "contact":
        level = STAYING_CONTACT / (len(runs) * splits**2 / 2)
    if any(search.drift(i, creep).worth >= best.worth for i in sensors):
        return None
    near = [change for change in changes if change.worth > best.worth - CAUSES_APART]
    return near[:_NAMED], level


def _when(change: _Run, time: FloatArray, number: IntArray) -> dict[str, Value]:
    """At which postures, and when.

    time, number : (K,), in the order of time. A row that is one posture has its number for a time.
    """
    first, last = change.first, change.last
    values: dict[str, Value] = {"posture": int(number[first])}
    contact, timed = change.kind == "contact", not np.array_equal(time, number - 1)
    if contact:
        values["last"] = int(number[last - 1])
    if timed:
        ends = [first, last - 1] if contact else [first - 1, first]
        values["between"] = time[ends].tolist()
        if not contact:
            values["cut"] = float(time[ends].mean())  # middles: the move lies between
    return values
