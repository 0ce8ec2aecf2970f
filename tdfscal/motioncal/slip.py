"""Did a sensor turn, its zero jump, the delay change, or a contact begin or end, at some instant?

The columns of such a step are those of the model from that instant on, zero before it, in the
Fourier coefficients of the blocks.

A step that is misplaced leaves a pulse, by which the noise of a quiet log tells it from a true one:
its score is asked for at every instant. With q(t) the weighted residual, brought back to time under
the taper, it is Σ c(t) q(t) over all t from the instant on. The information changes slowly, and is
worked out at some instants.

What touches for a moment, or a move that the model does not follow, has an edge too. A step is
believed where what lies beyond a second on either side of it shows it as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.errors import DataError
from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.judged import Change, ChangeSearch, change_suspicion
from tdfscal.estimation.score_tests import Suspicion
from tdfscal.estimation.uncertainty import Estimate
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.model import statics
from tdfscal.model.parameters import sensing
from tdfscal.model.samples_in_motion import derivatives
from tdfscal.motioncal.blocks import BAND, ComplexArray
from tdfscal.motioncal.design import BlockDesign
from tdfscal.motioncal.fit import MovingFit
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import chi2_quantile, chi2_sf
from tdfscal.numerics.least_squares import NOISE_ONLY, ask
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.significance import CAUSES_APART, CHANGED_RIG

#: What stays from an instant on where something touches the terminal: a wrench in the BCS.
CONTACT = "BCS"
#: Instants all over the log at which the information of a step is worked out.
_SPLITS = 24
#: Share of the largest information of a free wrench below which it is rounding.
_ROUNDING = 1e-9
#: Instants on either side that a local cubic takes in for the change of a force.
_HALF = 3
#: Middles of smooth pulses of a free wrench, 2 s long, about a step, s.
_PULSES = np.linspace(-1.0, 1.0, 5)
#: Fall of χ² within which the instant lies with 95 %.
_WITHIN = float(chi2_quantile(0.95, 1))


@record(kw_only=True)
class Step(Change):
    """A change at its likeliest instant.

    between : s, times between which it lies with 95 %. p_value : that noise gives as much anywhere
    in the log, with and without what lies about it. wrench : (F, 6) of every block, by the step and
    the move, which has the turns at rests too.
    """

    between: tuple[float, float]
    p_value: float
    wrench: tuple[ComplexArray, ...]


class _Steps(ChangeSearch):
    """Columns of steps in all blocks of a fit, and the sums that their tests need.

    An instant is told by its place among all that are used, block after block.
    """

    def __init__(self, fit: MovingFit) -> None:
        super().__init__(factored_information(fit).root, fit.rows)
        self.fit = fit
        self.time = np.concatenate([fit.slow.time[block.index] for block in fit.blocks])
        self.first = np.cumsum([0, *map(len, fit.blocks)])
        self.columns = [_columns(fit, item) for item in fit.designs]
        self.size = self.columns[0].shape[2]
        both = np.concatenate([fit.psi[:, None], fit.slope], axis=1)
        wrenches = [item.wrench(both) for item in fit.designs]
        self.white = [
            item.white(e, fit.noise) for item, e in zip(fit.designs, wrenches, strict=True)
        ]
        each = [
            np.einsum("tak,ta->tk", columns, item.back_in_time(e[..., 0], fit.noise))
            for columns, item, e in zip(self.columns, fit.designs, wrenches, strict=True)
        ]
        #: Score (N, k) of a step from every instant on.
        self.score = np.cumsum(np.concatenate(each)[::-1], axis=0)[::-1]
        whole = [self._of_block(k, 0) for k in range(len(fit.designs))]
        #: Sums over all blocks behind each.
        self.behind = [sum(whole[k + 1 :], 0.0 * whole[0]) for k in range(len(whole))]

    def wrench(self, block: int, place: int) -> ComplexArray:
        """Coefficients (F, 6, k) of the columns of a block from a place on."""
        columns = self.columns[block].copy()
        columns[: max(place - int(self.first[block]), 0)] = 0.0
        return self.fit.designs[block].block.transform(columns)

    def _of_block(self, block: int, place: int) -> FloatArray:
        c = self.fit.designs[block].white(self.wrench(block, place), self.fit.noise)
        return np.asarray(c.T @ np.concatenate([c, self.white[block]], axis=1))

    def sums(self, place: int) -> FloatArray:
        """cᵀ(c, r, J), (k, k + 1 + p), of the columns c from a place on."""
        block = int(np.searchsorted(self.first, place, side="right")) - 1
        return self._of_block(block, place) + self.behind[block]

    def beside(self, sums: FloatArray) -> FloatArray:
        """Information (k, k) of columns with these sums (k, k + 1 + p) beside the fit."""
        known = sums[:, self.size + 1 :] @ self.root
        return np.asarray(sums[:, : self.size] - known @ known.T)

    def beyond(self, place: int, own: IntArray) -> float:
        """Statistic of some columns from a place on, beside a free wrench about that place."""
        rows, k = list[FloatArray](), len(own)
        for number, item in enumerate(self.fit.designs):
            away = self.fit.slow.time[item.block.index][:, None] - self.time[place] - _PULSES
            shape = np.where(np.abs(away) < 1, np.cos(np.pi * away / 2) ** 2, 0.0)
            pulses = np.einsum("fw,ab->fawb", item.block.transform(shape), np.eye(6))
            step = self.wrench(number, place)[..., own]
            both = np.concatenate([step, pulses.reshape(*step.shape[:2], -1)], axis=2)
            columns = item.white(both, self.fit.noise)
            rows.append(np.concatenate([columns, self.white[number]], axis=1))
        c, r, J = np.split(np.concatenate(rows), np.array([0, 1]) + k + 6 * len(_PULSES), axis=1)
        known, score = c.T @ J @ self.root, (c.T @ r)[:, 0]
        left = c.T @ c - known @ known.T
        taken = left[:k, k:] @ np.linalg.pinv(left[k:, k:], rcond=_ROUNDING, hermitian=True)
        floor = NOISE_ONLY * float(np.sum(c[:, :k] ** 2))
        asked = ask(left[:k, :k] - taken @ left[k:, :k], score[:k] - taken @ score[k:], floor)
        return float(asked.statistic)

    def removed(
        self, place: int, own: IntArray, amount: FloatArray, move: FloatArray
    ) -> list[ComplexArray]:
        """Wrench (F, 6) of every block by a step from a place on, and by the move with it."""
        return [
            item.wrench(self.fit.slope @ move) + self.wrench(k, place)[..., own] @ amount
            for k, item in enumerate(self.fit.designs)
        ]


def _columns(fit: MovingFit, item: BlockDesign) -> FloatArray:
    """Change of e (N, 6, 6 n + 7) by turns and zeros of all sensors, the delay, and a wrench."""
    F, B = item.force, statics.wrench(item.arm)
    zeros = -B @ sensing(fit.still)
    change = derivatives(F.reshape(len(F), -1), item.block.step, _HALF)[0].reshape(F.shape)
    delay = np.einsum("knra,kna->kr", B, change)
    both = np.concatenate([B @ -so3.hat(F), zeros], axis=1)
    columns = np.moveaxis(both, 1, 2).reshape(len(F), 6, -1)
    wrench = np.broadcast_to(np.eye(6), (len(F), 6, 6))
    return item.across.wrench(np.concatenate([columns, delay[..., None], wrench], axis=2))


def likeliest_steps(
    fit: MovingFit, determined: BoolArray | None = None, most: float = CHANGED_RIG
) -> tuple[Step, ...]:
    """Find the likeliest step and those about as likely; none where noise does as well.

    determined : (n,), sensors whose turns the data show, by default all; the others stand.
    most : largest chance that noise does as well anywhere in the log.
    """
    n, steps = fit.rig.n, _Steps(fit)
    suspects = [("delay", 0, np.array([6 * n])), (CONTACT, 0, np.arange(6 * n + 1, 6 * n + 7))]
    for i in range(n):
        suspects.append(("zero", i, np.arange(3 * (n + i), 3 * (n + i) + 3)))
        if determined is None or determined[i]:
            suspects.append(("rotation", i, np.arange(3 * i, 3 * i + 3)))
    places = np.linspace(0, len(steps.time), _SPLITS + 1).astype(np.int64)[1:-1]
    information = np.array([steps.beside(steps.sums(place)) for place in places.tolist()])
    # Neighbouring instants of a band of frequencies are no tests of their own.
    tests = 2 * BAND * len(steps.time) * len(suspects)
    asked = (
        _at_its_best(
            steps, group, support, own, places, information[:, own[:, None], own], tests, most
        )
        for group, support, own in suspects
    )
    found = sorted(filter(None, asked), key=lambda step: step.worth, reverse=True)
    near = [step for step in found[1:] if found[0].worth - step.worth < CAUSES_APART]
    return (*found[:1], *(step for step in near if step.what != "delay"))


def _at_its_best(
    steps: _Steps,
    group: str,
    support: int,
    own: IntArray,
    places: IntArray,
    information: FloatArray,
    tests: float,
    most: float,
) -> Step | None:
    """A step at its likeliest instant; None where noise does as well.

    own : its columns. information : (S, g, g), at the places. tests : made in all.
    most : as of `likeliest_steps`.
    """
    every = np.arange(len(steps.time))
    at = np.interp(every, places, np.arange(len(places)))
    low = np.minimum(at.astype(np.int64), len(places) - 2)
    share = (at - low)[:, None, None]
    between = (1 - share) * information[low] + share * information[low + 1]
    size, score = len(own), steps.score[:, own]
    # What is rounding in the information is no more than this, and gives nothing.
    floor = NOISE_ONLY * np.trace(between, axis1=1, axis2=2) + np.finfo(float).tiny
    between += floor[:, None, None] * np.eye(size)
    curve = np.einsum("ka,kab->k", score, np.linalg.solve(between, score[..., None]))
    place = int(np.argmax(curve))
    sums = steps.sums(place)[own][None]
    ends = [steps.size, steps.size + 1]
    columns, residual, cross = np.split(sums, ends, axis=2)
    best = steps.likeliest(group, support, cross, columns[..., own], residual[..., 0])
    p_value = tests * float(chi2_sf(best.statistic, size))
    if p_value <= most:
        p_value = max(p_value, tests * float(chi2_sf(steps.beyond(place, own), size)))
    if p_value > most:
        return None
    near = np.flatnonzero(curve > curve[place] - _WITHIN)
    begin, end = steps.time[[max(near[0] - 1, 0), min(near[-1] + 1, len(every) - 1)]].tolist()
    wrench = steps.removed(place, own, best.amount, best.move)
    return Step(**vars(best), between=(begin, end), p_value=p_value, wrench=tuple(wrench))


def suspicion_of(steps: Sequence[Step], of: Estimate[MovingFit]) -> Suspicion:
    """The likeliest steps as one suspicion."""
    return change_suspicion(
        of,
        steps,
        [
            step.cause(of.fit.rig, between=[begin, end], until=begin, cut=end)
            for step in steps
            for begin, end in [step.between]
        ],
        p_value=steps[0].p_value,
        kind="slip" if any(step.what == "rotation" for step in steps) else steps[0].kind,
        move=steps[0].move[: int(of.fit.active.sum())],
    )


def refuse_changed_delay(steps: Sequence[Step]) -> None:
    """Raise DataError where forces and positions do not keep one delay."""
    if steps and steps[0].what == "delay":
        change, std = float(steps[0].amount[0]), float(steps[0].std[0])
        values: dict[str, Value] = {"ms": 1e3 * change, "ms_std": 1e3 * std}
        raise DataError(Finding("delay-changed", (), change, "s", values=values))
