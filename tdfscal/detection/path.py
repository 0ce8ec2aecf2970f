"""What one machine has on the contact wrench along a path by what its calibration leaves open."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.special import stdtr

from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.parameters import gravity, layout, sensing
from tdfscal.model.postures import ZeroAge, zero_motion
from tdfscal.model.samples_in_motion import Samples, rotations
from tdfscal.model.statics import carrying
from tdfscal.records import BoolArray, Drift, FloatArray, IntArray
from tdfscal.significance import CONTACT_ON_PATH
from tdfscal.wrench.contact_wrench import Linear, linearised, wrenches
from tdfscal.wrench.wrench_noise import ZeroVariance

#: Means over this time are looked at, s; every other one is dropped where there are more.
_BLOCK, _MOST = 0.25, 256
#: Speed of a hinge below which the terminal rests, m/s, and blocks in which it settles.
_RESTING, _SETTLES = 2e-4, 4
#: Way, m, over which a positioner's errors and the friction of hinges stay what they are.
_SAME_PLACE = 0.02
#: Postures whose own errors are drawn one by one, at most; of more they count as slow noise.
_APART = 48
#: Zeros that differ in what they do by less, relative, are not told apart.
_ALIKE = 1e-2
#: Means of blocks whose noise is alike, where it is slow.
_SLOW = 8.0
#: Stretches whose means tell how a path's mean wrench scatters; places, at least.
_STRETCHES, _FEWEST = 16, 4


@dataclass(slots=True)
class PathPoints:
    """Places of a log that are kept while it passes, in bounded memory.

    averaged : every row is a posture. used : samples that passed.
    """

    averaged: bool
    _kept: list[tuple[int, float, FloatArray, FloatArray]] = field(default_factory=list)
    _stride: int = 1
    _first: float = np.nan
    _last: tuple[float, FloatArray] | None = None
    _begin: list[FloatArray] = field(default_factory=list)
    _moves: list[BoolArray] = field(default_factory=list)
    used: int = 0

    def passing(self, samples: Iterable[Samples]) -> Iterator[Samples]:
        """Keep means of short blocks as the pieces of a log pass."""
        for piece in samples:
            self._add(piece)
            yield piece

    def _add(self, piece: Samples) -> None:
        if not self.used:
            self._first = float(piece.time[0])
        block = np.floor((piece.time - self._first) / _BLOCK)
        if self.averaged:
            block = self.used + np.arange(len(block))
        self.used += len(piece.time)
        new = np.flatnonzero(np.append(True, np.diff(block) > 0))
        count = np.diff(np.append(new, len(block)))[:, None, None]
        position = np.add.reduceat(piece.position, new) / count
        force = np.add.reduceat(piece.force, new) / count
        self._note_moves(piece.time[new], position)
        for index, *place in zip(block[new], piece.time[new], position, force, strict=True):
            if index % self._stride:
                continue
            self._kept.append((int(index), *place))
            if len(self._kept) > _MOST:
                self._stride *= 2
                self._kept = [one for one in self._kept if one[0] % self._stride == 0]

    def _note_moves(self, time: FloatArray, position: FloatArray) -> None:
        # What was before the log is not known: it begins as if it had just stopped.
        before = self._last or (float(time[0]), position[0] + 1.0)
        self._last = float(time[-1]), position[-1]
        step = np.linalg.norm(np.diff(position, axis=0, prepend=before[1][None]), axis=2)
        elapsed = np.diff(time, prepend=before[0])
        self._begin.append(time)
        self._moves.append(step.max(axis=1) > _RESTING * elapsed)

    def resting(self, time: FloatArray) -> BoolArray:
        """Whether the terminal rests at times (N,), s, that have passed, and has settled."""
        begin, moves = np.concatenate(self._begin), np.concatenate(self._moves)
        busy = np.convolve(moves, np.ones(_SETTLES + 2))[1 : len(moves) + 1] > 0.5
        return np.asarray(~busy[np.maximum(np.searchsorted(begin, time, side="right") - 1, 0)])

    def path(self) -> Path:
        """Return the path along these places."""
        _, time, position, force = zip(*self._kept, strict=True)
        return Path(np.array(time), np.stack(position), np.stack(force), self.averaged)


@record
class Path:
    """Places of a path without contact, each for as long as any other.

    time : (B,), s. position, force : (B, n, 3), m, BCS, and N, readings. averaged : postures, in
    no time that is known.
    """

    time: FloatArray
    position: FloatArray
    force: FloatArray
    averaged: bool

    @property
    def posture(self) -> IntArray:
        """Number (B,) of the posture at each place: another one after some way."""
        if self.averaged:
            return np.arange(len(self.time))
        step = np.linalg.norm(np.diff(self.position, axis=0), axis=2).max(axis=1)
        way = np.append(0.0, np.cumsum(np.where(step > 0.1 * _SAME_PLACE, step, 0.0)))
        return np.asarray(np.unique(np.floor(way / _SAME_PLACE), return_inverse=True)[1])


@dataclass(slots=True)
class Largest:
    """Largest size (C,) of each of some things, a wrench's six components, and when, s."""

    of: int = 6
    size: FloatArray = field(init=False)
    when: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.size, self.when = np.zeros(self.of), np.full(self.of, np.nan)

    def add(self, time: FloatArray, size: FloatArray) -> None:
        """Take in sizes (N, C) at times (N,)."""
        if len(time):
            place = np.argmax(size, axis=0)
            new = size[place, np.arange(self.of)]
            self.when = np.where(new > self.size, time[place], self.when)
            self.size = np.maximum(self.size, new)


@record
class ByZeros:
    """What zeros that are free to have moved explain of the wrench along a path.

    change : N, how far one has moved at most. taken, left : (6,), N and N·m, the largest that they
    explain, and that they do not. steady : (6,), size of the mean wrench; 0 where noise and what
    the calibration leaves open make as much.
    """

    change: float
    taken: FloatArray
    left: FloatArray
    steady: FloatArray

    def suffice(self, largest: FloatArray, limit: FloatArray) -> bool:
        """Whether no more than limit (6,) is left of largest (6,)."""
        return bool(np.all(self.left <= limit) and np.all(largest - self.taken <= limit))


@record
class ZeroChange:
    """How the zeros have moved since they were calibrated: as declared, and by 1/f noise.

    temperature : (B, n), °C, along the path; None where none is recorded.
    """

    drift: Drift
    age: ZeroAge
    temperature: FloatArray | None
    flicker: ZeroVariance | None


@record
class Errors:
    """What stands on the wrench at B places of a path, N and N·m, by standard normal draws.

    calibration : (B, 6, r), by the calibration's covariance. zeros : (B, 6, m), by zeros that have
    moved since. postures : (B, 6, p), by what is declared per posture; slow : (6,), the variance of
    that where postures are too many. open : (6,), nothing bounds the component.
    linear : the calibration's Jacobians.
    """

    calibration: FloatArray
    zeros: FloatArray
    postures: FloatArray
    slow: FloatArray
    open: BoolArray
    linear: Linear

    @property
    def factor(self) -> FloatArray:
        """All of them side by side, (B, 6, R)."""
        return np.concatenate([self.calibration, self.zeros, self.postures], axis=2)


def errors(
    given: Calibrated, path: Path, zeros: ZeroChange | None, posture_variance: FloatArray
) -> Errors:
    """Work out what stands on the wrench along a path.

    zeros : None where they hold. posture_variance : (6,), N² and (N·m)², that each posture has
    beyond what the rig file declares.
    """
    linear = linearised(given, path.position, path.force)
    calibration = linear.jacobian @ given.root
    moved = np.zeros((len(path.time), 6, 0))
    unknown: BoolArray = np.asarray(linear.open.any(axis=0))
    if zeros is not None:
        moved, unbounded = _moved(given, path, zeros, linear)
        unknown = unknown | unbounded
    own = np.diagonal(linear.declared, axis1=1, axis2=2) + posture_variance
    posture = path.posture
    count = int(posture.max()) + 1
    apart = np.zeros((len(own), 6, count if count <= _APART else 0))
    slow = np.zeros(6)
    if count <= _APART:
        apart[np.arange(len(own)), :, posture] = np.sqrt(own)
    else:
        slow = own.mean(axis=0)
    return Errors(calibration, moved, apart, slow, unknown, linear)


def explained_by_zeros(
    given: Calibrated, path: Path, resting: BoolArray, errors: Errors
) -> ByZeros | None:
    """Fit zeros to the wrench where the path rests (B,), everywhere if nowhere.

    None where the places are too few, or a component knows no zero.
    """
    resting = resting if resting.any() else ~resting
    seen = wrenches(given, path.time, path.position, path.force).value
    zero = layout(given.rig.n)["zero"]
    columns = errors.linear.jacobian[:, :, zero] * given.rig.axes.ravel()
    scale = np.linalg.norm(columns, axis=2).mean(axis=0)  # newton metres beside newtons
    if not (scale > 0).all() or len(seen) < _FEWEST:
        return None
    white = (columns[resting] / scale[:, None]).reshape(-1, columns.shape[2])
    change = np.linalg.lstsq(white, (seen[resting] / scale).ravel(), rcond=_ALIKE)[0]
    taken = columns @ change
    left = seen - taken
    # What is left is correlated in time: the mean is known as means over stretches tell.
    stretches = np.array_split(left[resting], min(resting.sum(), _STRETCHES))
    means = np.array([part.mean(axis=0) for part in stretches])
    noise = means.var(axis=0, ddof=1) * len(stretches[0]) / resting.sum() + errors.slow / len(means)
    known = np.sum(errors.factor[resting].mean(axis=0) ** 2, axis=1)
    mean = np.abs(seen[resting].mean(axis=0))
    freedom = (len(means) - 1) * ((known + noise) / (noise + 1e-300)) ** 2  # Welch, Satterthwaite
    chance = 12.0 * stdtr(freedom, -mean / np.sqrt(known + noise + 1e-300))
    steady = np.where(chance < CONTACT_ON_PATH, mean, 0.0)
    taken, left = (np.abs(part[resting]).max(axis=0) for part in (taken, left))
    return ByZeros(float(np.abs(change).max()), taken, left, steady)


def _moved(
    given: Calibrated, path: Path, zeros: ZeroChange, linear: Linear
) -> tuple[FloatArray, BoolArray]:
    """Columns (B, 6, m) of zeros that moved; components (6,) that an unknown slope reaches."""
    n, B = given.rig.n, len(path.time)
    by_zero = linear.jacobian[:, :, layout(n)["zero"]].reshape(B, 6, n, 3)
    by_zero = by_zero * given.rig.axes
    unknown, parts = np.zeros(6, dtype=np.bool_), [np.zeros((B, 6, 0))]
    motion = zero_motion(zeros.drift, path.time, zeros.temperature, n, zeros.age)
    if motion is not None:
        bounded = np.isfinite(motion.std)
        wild = motion.value[:, :, ~bounded].any(axis=(0, 2))
        reach = np.abs(by_zero[:, :, wild]).max(axis=(0, 2, 3), initial=0.0)
        unknown = unknown | np.asarray(reach > 0)
        amplitude = motion.value[:, :, bounded] * motion.std[bounded]
        parts.append(np.einsum("kanc,kng->kancg", by_zero, amplitude).reshape(B, 6, -1))
    if zeros.flicker is not None:
        size = np.sqrt(zeros.flicker(path.time))[:, :, None]  # (B, 1, 1)
        parts.append((by_zero * size[:, None]).reshape(B, 6, -1))
    return np.concatenate(parts, axis=2), unknown


def unexplained(errors: Errors, path: Path, time: FloatArray, value: FloatArray) -> FloatArray:
    """Wrench (N, 6) at times (N,), s, less what the calibration's errors explain of it.

    It is what noise is measured on where the terminal moves. Draws are fitted with their own
    spread as prior, so that no more is taken off than the calibration leaves open.
    """
    factor = np.concatenate([errors.calibration, errors.zeros], axis=2)
    within = np.flatnonzero((path.time >= time[0]) & (path.time + _BLOCK <= time[-1]))
    if len(within) < 3 or not factor.shape[2]:
        return value
    ends = np.searchsorted(time, np.stack([path.time[within], path.time[within] + _BLOCK]))
    total = np.concatenate([np.zeros((1, 6)), np.cumsum(value, axis=0)])
    count = np.maximum(ends[1] - ends[0], 1)[:, None]
    seen = (total[ends[1]] - total[ends[0]]) / count
    # What varies from one place to the next is noise, and counts as slow.
    scatter = np.mean(np.diff(seen, axis=0) ** 2, axis=0) / 2 * _SLOW
    scatter = scatter + 1e-12 * np.var(seen) + 1e-300
    A = (factor[within] / np.sqrt(scatter)[:, None]).reshape(-1, factor.shape[2])
    b = (seen / np.sqrt(scatter)).ravel()
    x = np.linalg.solve(A.T @ A + np.eye(A.shape[1]), A.T @ b)
    there = factor @ x
    at = path.time + _BLOCK / 2
    taken = [np.interp(time, at, there[:, c]) for c in range(6)]
    return np.asarray(value - np.stack(taken, axis=1))


def planned_readings(given: Calibrated, position: FloatArray, squeeze: FloatArray) -> FloatArray:
    """Return readings (K, n, 3), N, at postures (K, n, 3), m, at rest under internal forces, N."""
    state = given.state
    R = rotations(state.hinge, position - state.datum)
    weight = state.mass * gravity(state, given.rig.gravity)
    middle = state.hinge.mean(axis=0)
    arm, arm_m = (
        (place - middle) @ np.swapaxes(R, 1, 2) for place in (state.hinge, state.barycentre[None])
    )
    force = carrying(arm, arm_m[:, 0], weight) + squeeze
    return np.asarray(np.linalg.solve(sensing(state), force[..., None])[..., 0] + state.zero)
