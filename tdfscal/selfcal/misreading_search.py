"""Logs without one mistake each, and how low the cost over all mountings falls without it.

Everything but the rotations is eliminated once, about the nominal mounting: of a mistake only the
readings are its own. A channel's scale is not guessed: its column of the rotation is left free,
and its length says the scale. A jump is tried between all postures, its size eliminated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.checks.log_against_rig import exchanged_channels, rewired_sensors
from tdfscal.estimation.fit import Priors
from tdfscal.findings import Value
from tdfscal.frozen import field, record, replace
from tdfscal.model.parameters import starting_state
from tdfscal.model.statics import Postures, balance, features_jacobian
from tdfscal.numerics.least_squares import spectrum
from tdfscal.numerics.rotation_fits import descend, stacked
from tdfscal.records import FloatArray, Rig
from tdfscal.selfcal.mounting_search import apart, linear_in_rotations, turns_from
from tdfscal.significance import CAUSES_APART

#: Mistakes whose cost is searched at once; pursued to its minimum; returned.
_TOGETHER, _PURSUED, _RETURNED = 256, 40, 4
#: Steps from each start: to look, and to a minimum at most.
_LOOK, _DESCENT = 8, 40
#: Costs that differ by less, relative, are one.
_ONE_COST = 1e-3
#: Share of the trace that keeps a Gram matrix positive. |y| is the same for all rotations: it adds
#: a constant.
_RIDGE = 1e-12
#: Postures on either side of a jump.
_FEWEST = 2
#: Logarithm of a scale below which it is a sensor's gain, and no mistake.
_GAIN = np.log(1.2)


@record
class Undone:
    """The postures without a mistake.

    names : what is named otherwise, in words, where that is the mistake; signs : whose axes have
    the opposite one, and each axis' own. support, axis : whose readings are `factor` times what
    they should be, every axis where None; `free`: that scale is still in them. first : posture from
    which the support's zero jumped, which still is, too.
    """

    postures: Postures
    names: str = ""
    signs: Mapping[str, Value] = field(default_factory=dict)
    support: int = 0
    axis: int | None = None
    factor: float = 1.0
    first: int = 0
    free: bool = False

    @property
    def column(self) -> slice:
        """Of the mounting y, what a channel's readings are multiplied by."""
        assert self.axis is not None
        return slice(9 * self.support + self.axis, 9 * self.support + 9, 3)


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
        self._filled, self._measured = at.seen.force, at.seen.measured

    def root(self, undone: Undone) -> FloatArray:
        """A (9n + 1, 9n + 1) with |A y|² the cost of mountings y; see `mounting_search.profile`."""
        K, n = self._filled.shape[:2]
        force = np.where(self._measured, undone.postures.force, self._filled)
        by = self._wrench.reshape(K, 6, n, 3, 1) * force[:, None, :, None, :]
        whole = self._rest.copy()
        whole[: 6 * K, :-1] += by.reshape(6 * K, 9 * n)
        whole -= self._explained @ (self._explained.T @ whole)
        gram = whole.T @ whole
        if undone.first:
            step = np.zeros((len(whole), 3))
            own = slice(3 * undone.support, 3 * undone.support + 3)
            step[6 * undone.first : 6 * K] = self._wrench[undone.first :, :, own].reshape(-1, 3)
            step -= self._explained @ (self._explained.T @ step)
            gram -= _explaining(step.T @ step, step.T @ whole)
        elif undone.free:
            own = undone.column
            gram -= _explaining(gram[own, own], gram[own])
        gram.ravel()[:: 9 * n + 2] += _RIDGE * np.trace(gram)
        return np.linalg.cholesky(gram).T

    def scale(self, undone: Undone, rotation: FloatArray) -> float:
        """How many times too small a channel's readings are, by a mounting of the others."""
        root, own = self.root(replace(undone, free=False)), undone.column
        y = stacked(rotation)
        y[own] = 0.0
        assert undone.axis is not None
        column = -np.linalg.lstsq(root[:, own], root @ y, rcond=None)[0]
        return float(column @ rotation[undone.support, :, undone.axis])


def _explaining(gram: FloatArray, across: FloatArray) -> FloatArray:
    """What free columns take of the Gram matrix; gram (3, 3) their own, across (3, 9n + 1)."""
    return np.asarray(across.T @ np.linalg.pinv(gram, hermitian=True) @ across)


def lowest(
    rig: Rig, seen: Postures, starts: FloatArray, *, timed: bool
) -> list[tuple[Undone, FloatArray]]:
    """The mistakes without which the cost falls lowest, each with its mounting (n, 3, 3).

    starts : (s, n, 3, 3). timed : the postures are in the order of time, and zeros may jump.
    """
    undone = [*_renamed(rig, seen), *_in_other_units(rig, seen), *_rescaled(rig, seen)]
    if timed:
        undone += _with_jump(rig, seen)
    landscape = _Landscape(rig, seen)
    ends: list[tuple[float, int, FloatArray]] = []
    for first in range(0, len(undone), _TOGETHER):
        roots = np.stack([landscape.root(each) for each in undone[first : first + _TOGETHER]])
        ends += [(c, first + k, R) for c, k, R in _descended(roots, starts[None], _LOOK)]
    ends = sorted(ends, key=lambda end: end[0])[:_PURSUED]
    roots = np.stack([landscape.root(undone[k]) for _, k, _ in ends])
    near = np.stack([R for _, _, R in ends])[:, None]
    result = []
    for which, rotation in _least_turned(_descended(roots, near, _DESCENT), starts[0]):
        each = undone[ends[which][1]]
        if each.free and each.axis is not None:
            factor = 1 / landscape.scale(each, rotation)
            if not np.isfinite(factor) or abs(np.log(abs(factor))) < _GAIN:
                continue
            each = replace(
                each,
                postures=_divided(seen, each.support, each.axis, factor),
                factor=factor,
                free=False,
            )
        result.append((each, rotation))
    return result


def _least_turned(
    ends: list[tuple[float, int, FloatArray]], nominal: FloatArray
) -> list[tuple[int, FloatArray]]:
    """The few of the lowest cost; of those with one cost the least turned from a mounting.

    All mirrors of a sensor's axes differ by its turns alone.
    """
    cost = np.array([end[0] for end in ends])
    turn = apart(np.stack([end[2] for end in ends]), nominal)
    found: list[tuple[int, FloatArray]] = []
    while len(found) < _RETURNED and np.isfinite(cost).any():
        alike = cost < (1 + _ONE_COST) * cost.min() + CAUSES_APART
        k = int(np.argmin(np.where(alike, turn, np.inf)))
        found.append(ends[k][1:])
        cost[k] = np.inf
    return found


def _descended(
    roots: FloatArray, starts: FloatArray, iterations: int
) -> list[tuple[float, int, FloatArray]]:
    """Cost, number, mounting of each root (T, m, 9n + 1), the best from starts (1 or T, s, …)."""
    T, s = len(roots), starts.shape[1]
    every = np.broadcast_to(starts, (T, *starts.shape[1:])).reshape(T * s, *starts.shape[2:])
    found = descend(np.repeat(roots, s, axis=0), every, iterations=iterations, tolerance=1e-3)
    cost = found.cost.reshape(T, s)
    best = cost.argmin(axis=1)
    ends = found.rotation.reshape(T, s, *starts.shape[2:])
    return [(float(cost[k, b]), k, ends[k, b]) for k, b in enumerate(best)]


def _renamed(rig: Rig, seen: Postures) -> Iterator[Undone]:
    for other in chain(rewired_sensors(rig.supports), exchanged_channels(rig.supports, rig.axes)):
        yield Undone(other.postures(seen), other.words, other.turned(rig.supports))


def _in_other_units(rig: Rig, seen: Postures) -> Iterator[Undone]:
    """One sensor whose every axis is in another unit."""
    for i in range(rig.n):
        for factor in log_against_rig.UNITS:
            yield Undone(_divided(seen, i, None, factor), support=i, factor=factor)


def _divided(seen: Postures, sensor: int, axis: int | None, factor: float) -> Postures:
    """Postures whose readings were too large by a factor; noise never below what is stated."""
    scale, noise = np.ones(seen.measured.shape), np.ones(seen.measured.shape)
    own = slice(None) if axis is None else axis
    scale[sensor, own], noise[sensor, own] = 1 / factor, max(1.0, 1 / abs(factor))
    grown = noise[:, :, None] * noise[:, None, :]
    return replace(seen, force=seen.force * scale, force_cov=seen.force_cov * grown)


def _rescaled(rig: Rig, seen: Postures) -> Iterator[Undone]:
    """Channels of another scale, which is left free."""
    for i, a in np.argwhere(rig.axes).tolist():
        yield Undone(seen, support=i, axis=a, free=True)


def _with_jump(rig: Rig, seen: Postures) -> Iterator[Undone]:
    """Zeros that may have jumped between two postures, which are in the order of time."""
    for i in range(rig.n):
        for first in range(_FEWEST, len(seen) - _FEWEST + 1):
            yield Undone(seen, support=i, first=first)
