"""Did a sensor turn, its zero jump, or the delay change, at some instant of a motion?

As at rest (`selfcal/slip`): from an instant on a sensor has another rotation or zero, or the forces
another delay, and all else stays common. The columns of such a step are those of the model from
that instant on, zero before it, in the Fourier coefficients of the blocks. They are asked for at
instants all over the log, then at closer ones about the likeliest (Rao, Proc. Camb. Phil. Soc. 44,
1948; `numerics.least_squares.ask`).
"""

from __future__ import annotations

import numpy as np

from tdfscal.estimation.fit import factored_information
from tdfscal.estimation.score_tests import NOISE_ONLY, Suspicion, worst_angle
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record
from tdfscal.model import statics
from tdfscal.model.parameters import sensing
from tdfscal.motioncal.blocks import ComplexArray
from tdfscal.motioncal.design import BlockDesign
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.uncertainty import MovingEstimate
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import INTERVAL_FACTOR, chi2_quantile, chi2_sf
from tdfscal.numerics.least_squares import Asked, ask
from tdfscal.records import BoolArray, FloatArray, IntArray
from tdfscal.significance import CHANGED_RIG
from tdfscal.wrench.samples_in_motion import derivatives

#: Instants all over the log that are asked for, and those about the likeliest, again and again.
_SPLITS, _CLOSER = 24, 12
#: Instants on either side that a local cubic takes in for the change of a force.
_HALF = 3
#: Fall of χ² within which the instant lies with 95 %.
_WITHIN = float(chi2_quantile(0.95, 1))


@record
class Step:
    """A change at its likeliest instant.

    group : rotation, zero or delay. support : of which sensor. between : s, times between which it
    lies with 95 %. amount, std : (g,), rad in the BCS, N in the sensor's frame, or s. move :
    (p + rests,), of the other unknowns with it. statistic : fall of χ². p_value : that noise gives
    as much anywhere in the log. wrench : (F, 6) of every block, by the step and the move.
    """

    group: str
    support: int
    between: tuple[float, float]
    amount: FloatArray
    std: FloatArray
    move: FloatArray
    statistic: float
    p_value: float
    wrench: tuple[ComplexArray, ...]


class _Steps:
    """Columns of steps in all blocks of a fit, and the sums that their tests need.

    An instant is told by its place among all that are used, block after block.
    """

    def __init__(self, fit: MovingFit) -> None:
        self.fit, self.root = fit, factored_information(fit).root
        self.time = np.concatenate([fit.slow.time[block.index] for block in fit.blocks])
        self.first = np.cumsum([0, *map(len, fit.blocks)])
        self.columns = [_columns(fit, item) for item in fit.designs]
        both = np.concatenate([fit.psi[:, None], fit.slope], axis=1)
        self.white = [item.white(item.wrench(both), fit.noise) for item in fit.designs]
        every = np.arange(self.columns[0].shape[2])
        whole = [self._of_block(k, 0, every) for k in range(len(fit.designs))]
        #: Sums over all blocks behind each.
        self.behind = [sum(whole[k + 1 :], 0.0 * whole[0]) for k in range(len(whole))]

    def wrench(self, block: int, first: int, some: IntArray) -> ComplexArray:
        """Coefficients (F, 6, k) of some columns of a block, from its instant `first` on."""
        columns = self.columns[block][:, :, some].copy()
        columns[: max(first, 0)] = 0.0
        return self.fit.designs[block].block.transform(columns)

    def _of_block(self, block: int, first: int, some: IntArray) -> FloatArray:
        c = self.fit.designs[block].white(self.wrench(block, first, some), self.fit.noise)
        return np.asarray(c.T @ np.concatenate([c, self.white[block]], axis=1))

    def sums(self, places: IntArray, some: IntArray) -> FloatArray:
        """cᵀ(c, r, J), (S, k, k + 1 + p), of some columns c from each of these places on."""
        K, width = self.behind[0].shape
        wanted, out = np.concatenate([some, np.arange(K, width)]), []
        for place, block in zip(places, self._blocks(places), strict=True):
            own = self._of_block(block, int(place - self.first[block]), some)
            out.append(own + self.behind[block][np.ix_(some, wanted)])
        return np.array(out)

    def _blocks(self, places: IntArray) -> IntArray:
        return np.searchsorted(self.first, places, side="right") - 1

    def asked(self, sums: FloatArray) -> Asked:
        """The tests of columns with these sums (S, k, k + 1 + p)."""
        k = sums.shape[1]
        own, score, known = sums[:, :, :k], sums[:, :, k], sums[:, :, k + 1 :] @ self.root
        left = own - known @ np.swapaxes(known, 1, 2)
        return ask(left, score, NOISE_ONLY * np.trace(own, axis1=1, axis2=2))

    def removed(
        self, place: int, some: IntArray, amount: FloatArray, move: FloatArray
    ) -> list[ComplexArray]:
        """Wrench (F, 6) of every block by a step from a place on, and by the move with it."""
        out = []
        for k, item in enumerate(self.fit.designs):
            e, first = item.wrench(self.fit.slope @ move), place - int(self.first[k])
            if first < len(item.block):
                e = e + self.wrench(k, first, some) @ amount
            out.append(e)
        return out


def _columns(fit: MovingFit, item: BlockDesign) -> FloatArray:
    """Change of e (N, 6, 6 n + 1) by turns and zeros of all sensors, and by the forces' delay."""
    F, B = item.force, statics.wrench(item.arm)
    zeros = -B @ sensing(fit.still)
    change = derivatives(F.reshape(len(F), -1), item.block.step, _HALF)[0].reshape(F.shape)
    delay = np.einsum("knra,kna->kr", B, change)
    both = np.concatenate([B @ -so3.hat(F), zeros], axis=1)
    columns = np.moveaxis(both, 1, 2).reshape(len(F), 6, -1)
    return item.across.wrench(np.concatenate([columns, delay[..., None]], axis=2))


def likeliest_step(fit: MovingFit, determined: BoolArray | None = None) -> Step | None:
    """Find the likeliest step; None where noise does as well.

    determined : (n,), sensors whose turns the data show, by default all; the others stand.
    """
    n, steps = fit.rig.n, _Steps(fit)
    suspects = [("delay", 0, np.array([6 * n]))]
    for i in range(n):
        suspects.append(("zero", i, np.arange(3 * (n + i), 3 * (n + i) + 3)))
        if determined is None or determined[i]:
            suspects.append(("rotation", i, np.arange(3 * i, 3 * i + 3)))
    places = np.linspace(0, len(steps.time), _SPLITS + 1).astype(np.int64)[1:-1]
    sums = steps.sums(places, np.arange(6 * n + 1))
    beside = np.arange(6 * n + 1, sums.shape[2])
    found = [steps.asked(sums[:, own[:, None], np.append(own, beside)]) for *_, own in suspects]
    # Unknowns count as in `likeliest` (Schwarz 1978).
    worth = [asked.statistic.max() - len(own) * np.log(fit.rows)
             for asked, (*_, own) in zip(found, suspects, strict=True)]  # fmt: skip
    best = int(np.argmax(worth))
    group, support, own = suspects[best]
    tests, size = len(places) * len(suspects), len(own)
    places, sums = _closest(steps, own, places, found[best].statistic)
    asked = steps.asked(sums)
    at, last = int(np.argmax(asked.statistic)), len(places) - 1
    statistic = float(asked.statistic[at])
    p_value = min(1.0, tests * float(chi2_sf(statistic, size)))
    if p_value > CHANGED_RIG:
        return None
    near = np.flatnonzero(asked.statistic > statistic - _WITHIN)
    ends = places[[max(near[0] - 1, 0), min(near[-1] + 1, last)]]
    amount = -asked.amount[at]
    move = -steps.root @ (steps.root.T @ (sums[at, :, size + 1 :].T @ amount))
    return Step(
        group=group,
        support=support,
        between=(float(steps.time[ends[0]]), float(steps.time[ends[1]])),
        amount=amount,
        std=asked.std[at],
        move=move,
        statistic=statistic,
        p_value=p_value,
        wrench=tuple(steps.removed(int(places[at]), own, amount, move)),
    )


def _closest(
    steps: _Steps, own: IntArray, places: IntArray, statistic: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Places ever closer about the likeliest one, in order, and the sums of a suspect there.

    A step that is misplaced by some instants leaves a pulse, which shrinks it.
    """
    found: dict[int, FloatArray] = {}
    at = int(np.argmax(statistic))
    low, high = places[max(at - 1, 0)], places[min(at + 1, len(places) - 1)]
    while True:
        more = np.linspace(low, high, _CLOSER).astype(np.int64)
        more = np.setdiff1d(more, list(found))
        if not len(more):
            break
        found |= dict(zip(more.tolist(), steps.sums(more, own), strict=True))
        places = np.array(sorted(found))
        sums = np.array([found[place] for place in places.tolist()])
        at = int(np.argmax(steps.asked(sums).statistic))
        low, high = places[max(at - 1, 0)], places[min(at + 1, len(places) - 1)]
    return places, sums


def suspicion_of(step: Step, of: MovingEstimate) -> Suspicion:
    """The step as a suspicion, with the angle that it spoils most, before or after."""
    rig, p = of.fit.rig, len(of.drawn)
    before = step.move[: 3 * rig.n]
    after = before.copy()
    code, kind, unit = "zero-jumped", "jump", "N"
    if step.group == "rotation":
        after[3 * step.support : 3 * step.support + 3] += step.amount
        code, kind, unit = "sensor-slipped", "slip", "rad"
    values: dict[str, Value] = {
        "change": step.amount.tolist(),
        "change_95": (INTERVAL_FACTOR * step.std).tolist(),
        "between": list(step.between),
    }
    size, subject = float(np.linalg.norm(step.amount)), (rig.supports[step.support],)
    shift, harm, angle = worst_angle(rig, of.uncertainty, np.maximum(np.abs(before), np.abs(after)))
    return Suspicion(
        causes=(Finding(code, subject, size, unit, values=values),),
        p_value=step.p_value,
        shift=shift,
        harm=harm,
        angle=angle,
        kind=kind,
        support=step.support,
        weight=step.statistic - len(step.amount) * float(np.log(max(of.fit.rows, 2))),
        move=step.move[:p],
    )
