"""How the terminal moves: its pose at every sample, velocity and acceleration without delay; stops.

The pose follows from the servo positions as at rest (Eq. 1). Its derivatives come from a local
cubic fitted to a window that lies symmetrically about the sample: a filter of zero phase. Where
the terminal stands still, what a free wrench has more elsewhere is the motion's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from tdfscal.frozen import record
from tdfscal.model.postures import register
from tdfscal.numerics import so3
from tdfscal.records import BoolArray, FloatArray
from tdfscal.wrench.resampling import Samples

#: Samples that share one exact registration; the others follow it by Gauss–Newton.
_BLOCK = 128
#: Largest last Gauss–Newton step, rad; its square, and its product with the hinges' relative
#: misfit, is what remains.
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
    turned = np.tensordot(hinge.mean(axis=0), np.moveaxis(R, 0, 2), (0, 1)).T
    return R, position.mean(axis=1) - turned


def rotations(hinge: FloatArray, position: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3), LCS → BCS, of the poses; arguments as `poses`.

    The least-squares registration of `statics.register` to 1e-10 rad, many times faster: one
    singular value decomposition per block of samples, Gauss–Newton from there. In memory each
    component is one row.
    """
    N, n = position.shape[:2]
    flat = position.reshape(N, 3 * n)
    blocks = -(-N // _BLOCK)
    rest = blocks * _BLOCK - N
    whole = np.concatenate([flat, np.repeat(flat[-1:], rest, axis=0)]) if rest else flat
    whole = whole.reshape(blocks, _BLOCK, 3 * n)
    start, _ = register(hinge, whole.mean(axis=1).reshape(blocks, n, 3))
    turned = _follow((hinge - hinge.mean(axis=0)) @ np.swapaxes(start, 1, 2), whole)
    R = _product(turned, np.moveaxis(start, 0, 2)[..., None])
    return np.moveaxis(R.reshape(3, 3, -1)[..., :N], 2, 0)


def _product(A: FloatArray, B: FloatArray) -> FloatArray:
    """Matrix products (3, 3, ...) of matrices (3, 3, ...)."""
    out, part = np.empty(A.shape), np.empty(A.shape[2:])
    for a, c in product(range(3), range(3)):
        dot(A[a], B[:, c], out[a, c], part)
    return out


def _follow(arm: FloatArray, position: FloatArray) -> FloatArray:
    """Rotations (3, 3, b, B) that turn arm (b, n, 3) on position (b, B, 3n), all near the identity.

    arm : about the hinges' middle, which makes the gains blind to where the terminal stands.
    Components come first: numpy is fast along long last axes only.
    """
    lever = so3.hat(arm)
    inertia = np.einsum("bnca,bncd->bad", lever, lever)
    gain = np.linalg.solve(inertia[:, None], lever)  # δφ = Σ gain_i ε_i
    gain = np.swapaxes(gain, 2, 3).reshape(len(arm), -1, 3)
    step = position @ gain  # of the arms themselves no gain makes a turn: ρ × ρ = 0
    turned = _small_turn(step)
    far = np.flatnonzero(np.abs(step).max(axis=(1, 2)) > _CLOSE)
    for _ in range(_STEPS):
        if not far.size:
            break
        # Seen from the turned frame, the same fixed arms and gains serve again.
        here = turned[:, :, far]
        there = np.moveaxis(position[far].reshape(*position[far].shape[:2], -1, 3), (2, 3), (0, 1))
        seen, part = np.empty(there.shape), np.empty(there.shape[2:])
        for i, d in product(range(len(there)), range(3)):
            dot(there[i], here[:, d], seen[i, d], part)
        step = np.moveaxis(seen.reshape(-1, *seen.shape[2:]), 0, 2) @ gain[far]
        turned[:, :, far] = _product(here, _small_turn(step))
        far = far[np.abs(step).max(axis=(1, 2)) > _CLOSE]
    return turned


def _small_turn(v: FloatArray) -> FloatArray:
    """Rotations (3, 3, b, B) by vectors (b, B, 3), exact for |v| < 2: the unit quaternion
    (v/2, √(1 − v²/4)) turns by 2 asin(|v|/2), which is |v| to the third order.
    """
    v = np.ascontiguousarray(np.moveaxis(v, 2, 0))
    square = np.sum(v * v, axis=0)
    w = np.sqrt(np.maximum(1.0 - 0.25 * square, 0.0))
    out = 0.5 * v[:, None] * v
    for a, (b, c) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[a, a] += 1.0 - 0.5 * square
        turned = w * v[a]
        out[c, b] += turned
        out[b, c] -= turned
    return np.asarray(out)


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
        turning=vee(back @ first[:, 3:].reshape(N, 3, 3)),
        turning_rate=vee(back @ second[:, 3:].reshape(N, 3, 3)),
        acceleration=(back @ second[:, :3, None])[..., 0],
    )


def vee(M: FloatArray) -> FloatArray:
    """Vector (N, 3) of the skew part of M (N, 3, 3)."""
    skew = (M - np.swapaxes(M, 1, 2)) / 2
    return np.asarray(skew[:, [2, 0, 1], [1, 2, 0]])


def dot(
    a: Sequence[FloatArray] | FloatArray,
    b: Sequence[FloatArray] | FloatArray,
    out: FloatArray,
    part: FloatArray,
) -> None:
    """Write Σ aₖ bₖ into out; part, of the same shape, is overwritten."""
    np.multiply(a[0], b[0], out=out)
    for x, y in zip(a[1:], b[1:], strict=True):
        np.multiply(x, y, out=part)
        out += part


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
