"""Samples of all streams at common times, and how the terminal moves at them.

The time base is the first force's. The pose follows from the servo positions as at rest (Eq. 1).
Its derivatives come from a local cubic fitted to a window that lies symmetrically about the
sample: a filter of zero phase. Where the terminal stands still, what a free wrench has more
elsewhere is the motion's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray, Log, Series

#: Nothing is interpolated over a gap longer than this many sampling intervals, and than this time.
_GAP = 20.0
_GAP_TIME = 0.1


@record
class Samples:
    """A stretch of a log on one time base.

    time : (N,), s, ascending. position : (N, n, 3), m, BCS. force : (N, n, 3), N, readings.
    """

    time: FloatArray
    position: FloatArray
    force: FloatArray

    def rows(self, which: slice | BoolArray) -> Samples:
        """Some of the samples."""
        return Samples(self.time[which], self.position[which], self.force[which])

    def stretches(self, longest: float) -> list[Samples]:
        """Parts without a step of time above `longest`, s."""
        cuts = np.flatnonzero(np.diff(self.time) > longest) + 1
        return [self.rows(slice(a, b)) for a, b in pairwise([0, *cuts.tolist(), len(self.time)])]

    @classmethod
    def joined(cls, parts: Sequence[Samples]) -> Samples:
        """Parts that follow each other."""
        return cls(
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.position for part in parts]),
            np.concatenate([part.force for part in parts]),
        )


@dataclass(slots=True)
class Tally:
    """Samples of the time base that could not be used, and those that could.

    uncovered : another stream has a gap there, or has not begun, or has ended.
    unreadable : a reading is not a number.
    """

    used: int = 0
    uncovered: int = 0
    unreadable: int = 0


def together(streams: Sequence[Series]) -> bool:
    """Whether all streams have the same stamps."""
    stamps = streams[0].time
    return all(s.time is stamps or np.array_equal(s.time, stamps) for s in streams)


def aligned(pieces: Iterable[Log], tally: Tally) -> Iterator[Samples]:
    """Bring the pieces of a log to one time base, in bounded memory.

    The base is the first support's force; the other streams are interpolated linearly between
    their samples, across the borders of pieces. tally : counts on.
    """
    held: list[Series] = []
    for piece in pieces:
        streams = [*piece.position, *piece.force]
        held = [joined(a, b) for a, b in zip(held, streams, strict=True)] if held else streams
        base = len(piece.position)
        if together(held):
            yield from _sound(held[base].time, [s.value for s in held], tally)
            held = [Series(s.time[:0], s.value[:0]) for s in held]
        elif min(s.time.size for s in held):
            yield from _common(held, base, tally)
            reach = min(float(s.time[-1]) for s in held)
            held = [_rest(s, reach, whole=i != base) for i, s in enumerate(held)]
    if held:
        tally.uncovered += held[len(held) // 2].time.size


def joined(a: Series, b: Series) -> Series:
    """One stream from two pieces of it."""
    if not a.time.size or not b.time.size:
        return b if b.time.size else a
    return Series(np.concatenate([a.time, b.time]), np.concatenate([a.value, b.value]))


def _rest(stream: Series, reach: float, *, whole: bool) -> Series:
    """What is still needed after `reach`; with whole, from the sample at or before it."""
    first = int(np.searchsorted(stream.time, reach, side="right")) - whole
    return Series(stream.time[max(first, 0) :], stream.value[max(first, 0) :])


def _common(held: list[Series], base: int, tally: Tally) -> Iterator[Samples]:
    """Samples at the base's instants that all streams reach."""
    reach = min(float(s.time[-1]) for s in held)
    time = held[base].time
    time = time[: int(np.searchsorted(time, reach, side="right"))]
    if not time.size:
        return
    covered = np.ones(time.size, dtype=np.bool_)
    values = []
    for stream in held:
        covered &= _covers(stream.time, time)
        values.append(
            np.stack([np.interp(time, stream.time, stream.value[:, c]) for c in range(3)], axis=1)
        )
    tally.uncovered += int(np.sum(~covered))
    yield from _sound(time[covered], [v[covered] for v in values], tally)


def _covers(node: FloatArray, time: FloatArray) -> BoolArray:
    """Whether each time, none after the last node, lies on one or between two close ones."""
    after = np.searchsorted(node, time)
    here = node[after] == time
    if node.size < 2:
        return np.asarray(here)
    step = np.diff(node)
    close = step <= max(_GAP * float(np.median(step)), _GAP_TIME)
    return np.asarray(here | ((after > 0) & close[np.maximum(after - 1, 0)]))


def _sound(time: FloatArray, values: list[FloatArray], tally: Tally) -> Iterator[Samples]:
    """Leave out samples that are not numbers."""
    n = len(values) // 2
    found = Samples(time, np.stack(values[:n], axis=1), np.stack(values[n:], axis=1))
    good = np.isfinite(found.position.sum(axis=(1, 2)) + found.force.sum(axis=(1, 2)))
    if not good.all():
        tally.unreadable += int(np.sum(~good))
        found = found.rows(good)
    tally.used += found.time.size
    if found.time.size:
        yield found


#: Samples that share one exact registration; the others follow it by Gauss–Newton.
_BLOCK = 128
#: Largest last Gauss–Newton step, rad: the next one were its square.
_CLOSE = 5.0e-6
_STEPS = 12
#: Degree of the local polynomial; an odd one costs the second derivative nothing.
_DEGREE = 3
#: A hinge that is slower than this, m/s, over this time, s, stands.
_SLOW, _SPAN = 2e-4, 0.2


@record
class Motion:
    """Motion of the terminal, components in the LCS.

    turning : (N, 3), ω, rad/s. turning_rate : (N, 3), ω̇, rad/s².
    acceleration : (N, 3), of the LCS origin, m/s².
    """

    turning: FloatArray
    turning_rate: FloatArray
    acceleration: FloatArray

    def rows(self, which: slice) -> Motion:
        """Some of the instants."""
        return Motion(self.turning[which], self.turning_rate[which], self.acceleration[which])


def poses(hinge: FloatArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R (N, 3, 3), LCS → BCS, and T (N, 3), m, of the poses at servo positions (N, n, 3), BCS.

    hinge : (n, 3), m, LCS.
    """
    R = rotations(hinge, position)
    return R, position.mean(axis=1) - R @ hinge.mean(axis=0)


def rotations(
    hinge: FloatArray, position: FloatArray, near: FloatArray | None = None
) -> FloatArray:
    """Rotations (N, 3, 3), LCS → BCS, of the poses; arguments as `poses`, near : rotations by them.

    The least-squares registration of `register`, some times faster: one singular value
    decomposition per block of samples, Gauss–Newton from there. Seen from the terminal the hinges
    lie at spokes ρ about their middle; a turn by I⁻¹ Σ ρ × Rᵀp, I their inertia, takes them there.
    """
    if (R := near) is None:
        first = np.arange(0, len(position), _BLOCK)
        count = np.diff(np.append(first, len(position)))
        start, _ = register(hinge, np.add.reduceat(position, first) / count[:, None, None])
        R = np.repeat(start, count, axis=0)
    spoke = hinge - hinge.mean(axis=0)
    square = spoke.T @ spoke
    back = np.linalg.inv(np.trace(square) * np.eye(3) - square)
    moments = np.einsum("kna,nb->kab", position, spoke)
    for _ in range(_STEPS):
        step = -so3.axial(np.swapaxes(R, 1, 2) @ moments) @ back
        R = R @ so3.exp(step)
        if np.abs(step).max(initial=0.0) < _CLOSE:
            break
    return np.asarray(R)


def derivative_kernels(half: int) -> FloatArray:
    """Weights (3, 2 half + 1) of value, first and second derivative, for a step of 1.

    Least squares of a cubic (Savitzky and Golay, Anal. Chem. 36, 1964); half ≥ 2.
    """
    x = np.arange(-half, half + 1.0) / half
    fit = np.linalg.pinv(np.vander(x, _DEGREE + 1, increasing=True))
    return np.asarray(fit[:3] * np.array([1.0, 1.0 / half, 2.0 / half**2])[:, None])


def derivatives(signal: FloatArray, step: float, half: int) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of (N, c) at an even step, s; the ends take the last full fit."""
    N = len(signal)
    kernels = derivative_kernels(half) / step ** np.arange(3)[:, None]
    windows = np.lib.stride_tricks.sliding_window_view(signal, 2 * half + 1, axis=0)
    first, second = np.empty_like(signal), np.empty_like(signal)
    inner = slice(half, N - half)
    first[inner] = windows @ kernels[1]
    second[inner] = windows @ kernels[2]
    x = np.arange(-half, half + 1.0)
    for rows, centre in ((np.arange(half), half), (np.arange(N - half, N), N - 1 - half)):
        part = signal[centre - half : centre + half + 1]
        c = np.linalg.lstsq(np.vander(x, _DEGREE + 1, increasing=True), part, rcond=None)[0]
        u = (rows - centre)[:, None]
        first[rows] = (c[1] + 2 * c[2] * u + 3 * c[3] * u**2) / step
        second[rows] = (2 * c[2] + 6 * c[3] * u) / step**2
    return first, second


def motion(R: FloatArray, place: FloatArray, step: float, half: int) -> Motion | None:
    """Velocities and accelerations of N evenly sampled poses, step in s.

    R : (N, 3, 3). place : (N, 3), m, of the point that accelerates. half : samples on either side
    that a fit takes in. None where N ≤ 2 half.
    """
    N = len(place)
    if 2 * half >= N:
        return None
    signal = np.concatenate([place, R.reshape(N, 9)], axis=1)
    first, second = derivatives(signal, step, half)
    back = np.swapaxes(R, 1, 2)
    # In the LCS Rᵀ Ṙ = [ω]× and Rᵀ R̈ = [ω̇]× + [ω]×², whose second term is symmetric.
    return Motion(
        turning=-0.5 * so3.axial(back @ first[:, 3:].reshape(N, 3, 3)),
        turning_rate=-0.5 * so3.axial(back @ second[:, 3:].reshape(N, 3, 3)),
        acceleration=(back @ second[:, :3, None])[..., 0],
    )


@dataclass(slots=True)
class Standstill:
    """Watches samples pass, and tells of later times which of them lie at a stop."""

    _time: FloatArray = field(default_factory=lambda: np.empty(0))
    _still: BoolArray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    def watch(self, samples: Iterable[Samples]) -> Iterator[Samples]:
        """Hand samples on; remembers those that `at` has not been asked for."""
        for piece in samples:
            self._time = np.concatenate([self._time, piece.time])
            self._still = np.concatenate([self._still, still(piece)])
            yield piece

    def at(self, time: FloatArray) -> BoolArray:
        """Tell which times, ascending from call to call, lie at a stop; forgets earlier ones."""
        if not len(self._time) or not len(time):
            return np.zeros(len(time), dtype=np.bool_)
        place = np.minimum(np.searchsorted(self._time, time), len(self._time) - 1)
        found = self._still[place]
        self._time, self._still = self._time[place[-1] :], self._still[place[-1] :]
        return found


def still(samples: Samples) -> BoolArray:
    """Which (N,) samples lie at a stop: every hinge slower than 0.2 mm/s over 0.2 s about them."""
    time = samples.time
    early = np.searchsorted(time, time - _SPAN / 2)
    late = np.minimum(np.searchsorted(time, time + _SPAN / 2), len(time) - 1)
    way = np.linalg.norm(samples.position[late] - samples.position[early], axis=2).max(axis=1)
    return np.asarray(way <= _SLOW * np.maximum(time[late] - time[early], _SPAN / 2))
