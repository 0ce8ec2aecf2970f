"""The one mistake in a log without which forces fit that fit nowhere as they are.

Are the forces what their fields are called? A mounting that nobody stated is for the estimator to
find; a unit, a sign, exchanged sensors or axes, a tare on the way are not. So the forces are held
against the weight where they fit best, and against what they would be without one mistake where
they fit nowhere: sensors or channels exchanged, axes of the opposite sign, two of these, a sensor
or a channel of another unit or scale, a zero that jumped on the way. Each is undone, of each the
cost over all mountings is searched, and the few that fall lowest are fitted in full.

Everything but the rotations is eliminated once, about the nominal mounting: of a mistake only the
readings are its own. A channel's scale is not guessed: its column of the rotation is left free,
and its length says the scale. A jump is tried between all postures, its size eliminated.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.checks.wiring import Wiring, rewired_forces
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.uncertainty import estimate
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import nominal, starting_state
from tdfscal.model.postures import Rests, ZeroMotion
from tdfscal.model.statics import Postures, balance, features_jacobian
from tdfscal.numerics.least_squares import spectrum
from tdfscal.numerics.rotation_fits import descend, stacked
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.selfcal.changes import find_change
from tdfscal.selfcal.estimator import Fit, fit
from tdfscal.selfcal.mounting_search import apart, linear_in_rotations, robust_cost, turns_from
from tdfscal.significance import BETTER, CAUSES_APART, MOST_POSTURES

#: Share of a tare by which it may miss the load, at most.
_TARED = 0.1
#: Postures on either side of a jump.
_FEWEST = 2
#: Logarithm of a scale below which it is a sensor's gain, and no mistake.
_GAIN = np.log(1.2)
#: Mistakes whose cost is searched at once; pursued to its minimum; fitted.
_TOGETHER, _PURSUED, _FITTED = 256, 60, 4
#: Steps from each start: to look, and to a minimum at most.
_LOOK, _DESCENT = 8, 40
#: Costs that differ by less, relative, are one.
_ONE_COST = 1e-3
#: Share of the trace that keeps a Gram matrix positive. |y| is the same for all rotations: it adds
#: a constant.
_RIDGE = 1e-12


@record
class Mistake:
    """One mistake: a wiring, or a support's readings of another scale, or its zero that jumped.

    support, axis : whose readings are `factor` times what they should be, every axis where None;
    0 is a scale that is not known yet. first : posture from which the support's zero jumped.
    """

    wiring: Wiring | None = None
    support: int = 0
    axis: int | None = None
    factor: float = 1.0
    first: int = 0

    @property
    def column(self) -> slice:
        """Of the mounting y, what a channel's readings are multiplied by."""
        assert self.axis is not None
        return slice(9 * self.support + self.axis, 9 * self.support + 9, 3)

    def scale(self, shape: tuple[int, ...]) -> FloatArray:
        """What readings (…, n, 3) are to be multiplied by, (n, 3)."""
        scale, axis = np.ones(shape[-2:]), slice(None) if self.axis is None else self.axis
        scale[self.support, axis] = 1 / self.factor if self.factor else 1.0
        return scale

    def undone(self, seen: Postures) -> Postures:
        """Postures without it, a jump's size a parameter; noise never below what is stated."""
        if self.wiring is not None:
            return self.wiring.postures(seen)
        if self.first:
            return _drifting(seen, self.support, self.first)
        scale = self.scale(seen.force.shape)
        noise = np.maximum(1.0, np.abs(scale))
        grown = noise[:, :, None] * noise[:, None, :]
        return replace(seen, force=seen.force * scale, force_cov=seen.force_cov * grown)


@record
class Misreading:
    """A mistake in the readings, and the fit without it.

    jump : (3,), N, by which a zero jumped between the postures `between`, `tared`: to nothing.
    """

    mistake: Mistake
    fit: Fit
    jump: FloatArray | None = None
    between: tuple[int, int] = (0, 0)
    tared: bool = False

    @property
    def exact(self) -> bool:
        """Whether no number was fitted to it: an exchange, a sign, a unit."""
        unit = any(log_against_rig.unit_of(self.mistake.factor))
        return self.mistake.wiring is not None or (self.jump is None and unit)


def _fitted(
    rig: Rig, seen: Postures, mistake: Mistake, near: FloatArray, order: IntArray
) -> Misreading:
    """Fit in full from a mounting; order : (K,), the numbers of the postures."""
    postures, first = mistake.undone(seen), mistake.first
    result = fit(rig, postures, replace(starting_state(rig, postures.motions), rotation=near))
    if not first:
        return Misreading(mistake, result)
    jump = result.state.drift[-1, mistake.support]
    tared = _is_tare(jump, seen.force[first - 1 : first + 1, mistake.support])
    return Misreading(mistake, result, jump, (int(order[first - 1]), int(order[first])), tared)


def _is_tare(jump: FloatArray, read: FloatArray) -> bool:
    """A jump (3,) takes away the load of some moment between the readings (2, 3) beside it."""
    before, after = read[0], read[1] - jump
    way = after - before
    share = np.clip(-(jump + before) @ way / max(float(way @ way), np.finfo(float).tiny), 0, 1)
    left = np.linalg.norm(before + share * way + jump)
    return bool(left < _TARED * np.linalg.norm(jump))


def _drifting(seen: Postures, sensor: int, first: int) -> Postures:
    """Postures with a zero whose step at one of them is a parameter."""
    step = np.zeros((*seen.force.shape[:2], 1))
    step[first:, sensor] = 1.0
    wide = 10.0 * float(np.median(np.linalg.norm(seen.force, axis=2)))
    motion = ZeroMotion(("step",), step, np.array([wide]))
    if (own := seen.motion) is not None:
        motion = replace(
            own,
            kind=(*own.kind, "step"),
            value=np.concatenate([own.value, step], axis=2),
            std=np.append(own.std, wide),
        )
    return replace(seen, motion=motion)


def misreading(
    rig: Rig, observed: Postures, present: Fit, rests: Rests | None = None
) -> Misreading | None:
    """The one mistake that explains the postures, which a sensor that turned does not.

    present : the best that can be made of them as they are. rests : what the postures are; without
    them no jump is looked for.
    """
    order = np.arange(len(observed)) if rests is None else np.argsort(rests.time, kind="stable")
    some = np.unique(np.linspace(0, len(order) - 1, MOST_POSTURES).round().astype(np.int64))
    seen, misfit = observed.subset(order[some]), present.misfit
    if misfit < BETTER:
        return None
    starts = np.stack([nominal(rig).rotation, present.state.rotation])
    likely = _lowest(rig, seen, starts, timed=rests is not None)
    tried = [_fitted(rig, seen, mistake, near, order[some]) for mistake, near in likely]
    better = [m for m in tried if BETTER * m.fit.misfit < misfit and m.fit.misfit < BETTER]
    if not better:
        return None
    found = _likeliest(better)
    if rests is None or found.jump is None or found.tared:
        return found
    step = find_change(estimate(present), rests.time, rests.number)
    # A sensor that turned is for the gate to say.
    return None if step is not None and step.kind == "slip" else found


def _likeliest(found: list[Misreading]) -> Misreading:
    """The likeliest; among those about as likely what has no number, the sensors least turned.

    A mirrored axis and two that are exchanged differ by a quarter turn alone.
    """
    scale = min(mistake.fit.misfit for mistake in found)
    cost = [robust_cost(mistake.fit, scale) for mistake in found]
    near = [m for m, own in zip(found, cost, strict=True) if own < min(cost) + CAUSES_APART]
    start = nominal(found[0].fit.rig).rotation
    return min(near, key=lambda m: (not m.exact, float(apart(m.fit.state.rotation, start))))


def _mistakes(rig: Rig, postures: int, *, timed: bool) -> Iterator[Mistake]:
    yield from (Mistake(wiring) for wiring in rewired_forces(rig.supports, rig.axes))
    for i in range(rig.n):
        yield from (Mistake(support=i, factor=factor) for factor in log_against_rig.UNITS)
        yield from (Mistake(support=i, axis=int(a), factor=0) for a in np.flatnonzero(rig.axes[i]))
        for first in range(_FEWEST, postures - _FEWEST + 1) if timed else ():
            yield Mistake(support=i, first=first)


def _lowest(
    rig: Rig, seen: Postures, starts: FloatArray, *, timed: bool
) -> list[tuple[Mistake, FloatArray]]:
    """The mistakes without which the cost falls lowest, each with its mounting (n, 3, 3).

    starts : (s, n, 3, 3). timed : the postures are in the order of time, and zeros may jump. Of
    those with one cost the least turned come first: mirrors of a sensor's axes differ by its turns.
    """
    mistakes, landscape = list(_mistakes(rig, len(seen), timed=timed)), _Landscape(rig, seen)
    ends: list[tuple[float, Mistake, FloatArray]] = []
    for begin in range(0, len(mistakes), _TOGETHER):
        some = mistakes[begin : begin + _TOGETHER]
        ends += landscape.descended(some, starts[None], _LOOK)
    ends = sorted(ends, key=lambda end: end[0])[:_PURSUED]
    near = np.stack([rotation for *_, rotation in ends])[:, None]
    ends = landscape.descended([mistake for _, mistake, _ in ends], near, _DESCENT)
    cost = np.array([end[0] for end in ends])
    turn = apart(np.stack([rotation for *_, rotation in ends]), starts[0])
    result = []
    for _ in range(min(_FITTED, len(ends))):
        alike = cost < (1 + _ONE_COST) * cost.min() + CAUSES_APART
        k = int(np.argmin(np.where(alike, turn, np.inf)))
        cost[k] = np.inf
        mistake, rotation = ends[k][1:]
        if not mistake.factor:
            factor = 1 / landscape.scale(mistake, rotation)
            if not np.isfinite(factor) or abs(np.log(abs(factor))) < _GAIN:
                continue
            mistake = replace(mistake, factor=factor)
        result.append((mistake, rotation))
    return result


class _Landscape:
    """Cost over all mountings of the postures without a mistake, weighted as they are with it.

    The wrenches of unit forces, their weights and what every other parameter explains are common
    to all mistakes: only the readings differ, or what a jump explains beside.
    """

    def __init__(self, rig: Rig, seen: Postures) -> None:
        start, n = starting_state(rig, seen.motions), rig.n
        at = balance(seen, start, rig.barycentre.value, rig.gravity)
        priors = Priors(rig, seen.motion)
        residual, rows = priors(start)
        other = np.flatnonzero(priors.active) >= 3 * n
        nuisance = features_jacobian(start, at, rig.gravity)[:, priors.active][:, other]
        below = rows[:, ~other] @ turns_from(start)
        below[:, -1] += residual
        design = at.whitener @ at.design
        explained = (design @ nuisance).reshape(6 * len(seen), -1)
        self._explained = spectrum(np.concatenate([explained, rows[:, other]])).left
        rest = design[..., 9 * n :] @ linear_in_rotations(start, at, rig.gravity)[9 * n :]
        self._rest = np.concatenate([rest.reshape(-1, 9 * n + 1), below])
        self._wrench = at.whitener @ np.moveaxis(at.wrench, 1, 2).reshape(len(seen), 6, 3 * n)
        self._seen, self._filled = seen, at.seen

    def descended(
        self, mistakes: list[Mistake], starts: FloatArray, steps: int
    ) -> list[tuple[float, Mistake, FloatArray]]:
        """Cost and mounting without each mistake, the best from starts (1 or T, s, …)."""
        T, s = len(mistakes), starts.shape[1]
        roots = np.repeat(np.stack([self._root(each) for each in mistakes]), s, axis=0)
        every = np.broadcast_to(starts, (T, *starts.shape[1:])).reshape(T * s, *starts.shape[2:])
        found = descend(roots, every, iterations=steps, tolerance=1e-3)
        best = s * np.arange(T) + found.cost.reshape(T, s).argmin(axis=1)
        return [
            (float(found.cost[k]), mistake, found.rotation[k])
            for k, mistake in zip(best, mistakes, strict=True)
        ]

    def scale(self, mistake: Mistake, rotation: FloatArray) -> float:
        """How many times too small a channel's readings are, by a mounting of the others."""
        root, own, y = self._root(Mistake()), mistake.column, stacked(rotation)
        y[own] = 0.0
        column = -np.linalg.lstsq(root[:, own], root @ y, rcond=None)[0]
        return float(column @ rotation[mistake.support, :, mistake.axis])

    def _root(self, mistake: Mistake) -> FloatArray:
        """A (9n + 1, 9n + 1) with |A y|² the cost of mountings y; see `mounting_search.profile`."""
        read, (K, n) = self._seen.force, self._seen.force.shape[:2]
        read = mistake.wiring.signals(read) if mistake.wiring else mistake.scale(read.shape) * read
        force = np.where(self._filled.measured, read, self._filled.force)
        by = self._wrench.reshape(K, 6, n, 3, 1) * force[:, None, :, None, :]
        whole = self._rest.copy()
        whole[: 6 * K, :-1] += by.reshape(6 * K, 9 * n)
        whole -= self._explained @ (self._explained.T @ whole)
        gram = whole.T @ whole
        if mistake.first:
            step, own = np.zeros((len(whole), 3)), 3 * mistake.support
            after = self._wrench[mistake.first :, :, own : own + 3]
            step[6 * mistake.first : 6 * K] = after.reshape(-1, 3)
            step -= self._explained @ (self._explained.T @ step)
            gram -= _explaining(step.T @ step, step.T @ whole)
        elif not mistake.factor:
            gram -= _explaining(gram[mistake.column, mistake.column], gram[mistake.column])
        gram.ravel()[:: 9 * n + 2] += _RIDGE * np.trace(gram)
        return np.linalg.cholesky(gram).T


def _explaining(gram: FloatArray, across: FloatArray) -> FloatArray:
    """What free columns take of the Gram matrix; gram (3, 3) their own, across (3, 9n + 1)."""
    return np.asarray(across.T @ np.linalg.pinv(gram, hermitian=True) @ across)
