"""Stretches without a hole, each brought to the frequency domain under a smooth taper.

A block of N instants becomes its Fourier coefficients up to the band's edge. The taper keeps the
power of low frequencies out of the higher ones. Derivatives are taken of the taper, never of the
data: ∫ w x'' e^{−iωt} dt = ∫ (w'' − 2 i ω w' − ω² w) x e^{−iωt} dt (weak form).

A component without a sensor is a force of any course in time, u(t), along a wrench W(t) that turns
with the terminal (theory, section 10). What stands across it says all that can be known: with K the
mean covariance of e for unit forces on all axes and N(t) an orthonormal basis of what K^(-1/2) W
does not reach, carried along in parallel from instant to instant,

    e' = T e,   T(t) = K^(1/2) N₀ N(t)ᵀ K^(-1/2),   T W = 0.

White noise of the forces stays white, and e' keeps to one space of 6 − m dimensions, whatever way
the terminal leans. Where T meets a derivative, that is one of local cubics: T turns, and cannot
stand beside the taper.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tdfscal.errors import NotIdentifiableError
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import State
from tdfscal.model.samples_in_motion import derivatives
from tdfscal.model.statics import Balance, Postures, balance, features, free
from tdfscal.motioncal.streams import Slow
from tdfscal.records import BoolArray, FloatArray

ComplexArray = npt.NDArray[np.complex128]

#: Edge of the band as a share of the time base's rate: 3 Hz at 20 Hz.
BAND = 0.15
#: Length of the taper's ramps, s, and at most as a share of the block.
_RAMP, _RAMP_SHARE = 2.0, 0.12
#: Longest block, s: it bounds the memory, and what a change of the noise within a log does.
LONGEST = 240.0
#: Shortest block, s.
SHORTEST = 4.0
#: Speed of the NCPs below which the terminal rests, m/s, the time over which it is seen, and the
#: shortest rest, s.
_SLOW, _SEEN, _REST = 2.0e-4, 0.5, 1.5
#: Rests at most that have unknowns of their own, the longest first.
_MOST_RESTS = 60
#: Way over which the positioners' errors are still those of the place, m.
_LEAD = 0.01
#: Fewest instants of a block.
_FEWEST = 40
#: Product of the primes below 50: FFTs of a length without any other factor are fast.
_SMALL = 614889782588491410


@record
class Stretch:
    """A stretch of time, s, that is left out, and why."""

    begin: float
    end: float
    reason: Finding

    @property
    def finding(self) -> Finding:
        """That it is left out."""
        values = {**self.reason.values, "begin": self.begin, "end": self.end}
        return replace(self.reason, values=values)


@record
class Block:
    """N consecutive instants of the slow streams.

    index : rows of the streams. taper : (3, N), w, w' (1/s), w'' (1/s²).
    frequency : (F,), Hz, from 0 to the band's edge. step : s. begin : s, of the first row.
    """

    index: slice
    taper: FloatArray
    frequency: FloatArray
    step: float
    begin: float

    def __len__(self) -> int:
        return len(self.taper[0])

    @property
    def seconds(self) -> float:
        """How long it is, s."""
        return len(self) * self.step

    @property
    def share(self) -> float:
        """(Σ w²)² / (N Σ w⁴): how much a coefficient counts; the taper makes neighbours alike."""
        w = self.taper[0]
        return float(np.sum(w**2) ** 2 / (len(w) * np.sum(w**4)))

    def power(self, coefficients: ComplexArray) -> FloatArray:
        """Mean square (c,) over time of what has these coefficients (F, c)."""
        both = np.where(np.arange(len(coefficients)) > 0, 2.0, 1.0)[:, None]
        return np.asarray(np.sum(both * np.abs(coefficients) ** 2, axis=0) / self.seconds)

    @property
    def scale(self) -> float:
        """What makes |coefficient|² a two-sided spectral density."""
        return float(np.sqrt(self.step / np.sum(self.taper[0] ** 2)))

    def transform(self, signal: FloatArray, derivative: int = 0) -> ComplexArray:
        """Coefficients (F, ...) of signal (N, ...), of its first or its second derivative."""
        # An instant beside the next: what FFTs are fast on.
        rows = signal.reshape(len(signal), -1).T
        omega, count = 2 * np.pi * self.frequency, len(self.frequency)

        def fourier(taper: FloatArray) -> ComplexArray:
            return np.asarray(np.fft.rfft(np.multiply(rows, taper, order="C"))[:, :count])

        w, w1, w2 = self.taper
        out = fourier(self.scale * w)
        if derivative == 1:
            out = 1j * omega * out - fourier(self.scale * w1)
        elif derivative == 2:
            out = fourier(self.scale * w2) - 2j * omega * fourier(self.scale * w1) - omega**2 * out
        return np.asarray(out.T.reshape(count, *signal.shape[1:]))


def blocks(slow: Slow, keep: BoolArray) -> tuple[Block, ...]:
    """Cut the kept instants (a mask (N,)) into blocks."""
    out = []
    for run in stretches(slow, keep):
        length = (run.stop - run.start) * slow.step
        parts = max(1, int(np.ceil(length / LONGEST)))
        edges = np.linspace(run.start, run.stop, parts + 1).astype(int).tolist()
        out += [_block(slow, a, a + _fast(b - a)) for a, b in pairwise(edges)]
    return tuple(out)


def _fast(count: int) -> int:
    """The largest length up to `count` whose FFT is fast; the taper leaves little of the rest."""
    while pow(_SMALL, 16, count):
        count -= 1
    return count


def stretches(slow: Slow, keep: BoolArray) -> list[slice]:
    """Rows of every stretch that is kept, without a hole and long enough."""
    rows = np.flatnonzero(keep)
    apart = (np.diff(rows) > 1) | (np.diff(slow.time[rows]) > 1.5 * slow.step)
    least = max(SHORTEST / slow.step, _FEWEST)
    parts = np.split(rows, np.flatnonzero(apart) + 1)
    return [slice(int(p[0]), int(p[-1]) + 1) for p in parts if len(p) >= least]


def runs(flag: BoolArray) -> list[slice]:
    """Rows of every run of True in flags (N,)."""
    edges = np.flatnonzero(np.diff(flag, prepend=False, append=False))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _block(slow: Slow, first: int, last: int) -> Block:
    N = last - first
    frequency = np.asarray(np.fft.rfftfreq(N, slow.step), dtype=np.float64)
    return Block(
        index=slice(first, last),
        taper=_taper(N, slow.step),
        frequency=frequency[frequency <= BAND / slow.step * (1 + 1e-9)],
        step=slow.step,
        begin=float(slow.time[first]),
    )


def _taper(N: int, step: float) -> FloatArray:
    """w, w', w'' (3, N): flat, with ramps of degree 7 whose first three derivatives vanish."""
    ramp = min(_RAMP, _RAMP_SHARE * N * step)
    time = (np.arange(N) + 0.5) * step
    u = np.clip(np.minimum(time, N * step - time) / ramp, 0.0, 1.0)
    side = np.where(time < N * step / 2, 1.0, -1.0)
    w = u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)
    w1 = 140 * u**3 * (1 - u) ** 3
    w2 = 420 * u**2 * (1 - u) ** 2 * (1 - 2 * u)
    return np.stack([w, side * w1 / ramp, w2 / ramp**2])


def rests_of(slow: Slow, blocks: Sequence[Block]) -> tuple[tuple[slice, ...], ...]:
    """Rests of every block, as rows of it, in their order.

    An error of the servo positions is one of the place, not of the time. While the terminal moves
    it is a noise with a spectrum; during a rest it is one unknown constant, and no length of the
    rest tells more about it. So every rest has a turn of its registered pose as an unknown of its
    own, with the positioners' stated uncertainty as its prior.
    """
    found = [(k, run) for k, block in enumerate(blocks) for run in _resting(slow, block)]
    longest = sorted(found, key=lambda item: item[1].start - item[1].stop)[:_MOST_RESTS]
    return tuple(
        tuple(sorted((run for b, run in longest if b == k), key=lambda run: run.start))
        for k in range(len(blocks))
    )


def _resting(slow: Slow, block: Block) -> list[slice]:
    place = slow.position[block.index].reshape(len(block), -1)
    lag = max(1, round(_SEEN / slow.step))
    if len(place) <= lag:
        return []
    way = np.abs(place[lag:] - place[:-lag]).max(axis=1)
    still = [slice(run.start, run.stop + lag) for run in runs(way < _SLOW * lag * slow.step)]
    return [run for run in still if run.stop - run.start >= max(2, round(_REST / slow.step))]


def nearness(slow: Slow, block: Block, resting: Sequence[slice]) -> FloatArray:
    """Share (N, R) of the positioners' error at every rest that each instant has in common."""
    place = slow.position[block.index]
    out = np.zeros((len(place), len(resting)))
    for k, run in enumerate(resting):
        gap = place - place[run].mean(axis=0)
        way = np.sqrt(np.einsum("kna,kna->kn", gap, gap).max(axis=1))
        near = np.exp(-0.5 * (way / _LEAD) ** 2)
        # A place that is come back to counts as another rest.
        far = np.flatnonzero(way > 3 * _LEAD)
        near[: max(far[far < run.start], default=0)] = 0.0
        near[min(far[far >= run.stop], default=len(near)) :] = 0.0
        out[:, k] = near
    return out


#: Instants on either side that a local cubic takes in.
_HALF = 3
#: A direction whose share of the columns is below this is rounding.
_ROUNDING = 1e-9


@record
class Across:
    """T (N, 6, 6) of a block's instants; None where every axis is measured.

    seen : (r, 6), brings e' to its own r coordinates.
    """

    block: Block
    seen: FloatArray
    course: FloatArray | None = None

    def wrench(self, columns: FloatArray) -> FloatArray:
        """T c of wrenches c (N, ..., 6, a)."""
        T = self.course
        if T is None:
            return columns
        return np.asarray(T.reshape(len(T), *(1,) * (columns.ndim - 3), 6, 6) @ columns)

    def transform(self, columns: FloatArray) -> ComplexArray:
        """Coefficients (F, 6, c) of wrenches (N, 6, c), most of which are zero."""
        out = np.zeros((len(self.block.frequency), *columns.shape[1:]), dtype=np.complex128)
        if self.course is not None:
            there = columns.any(axis=(0, 1))
            out[..., there] = self.block.transform(self.wrench(columns[..., there]))
        else:
            some = columns.any(axis=0)
            out[:, some] = self.block.transform(columns[:, some])
        return out

    def shaped(self, shape: FloatArray, wrench: FloatArray) -> ComplexArray:
        """Coefficients (F, 6, R, a) of constant wrenches (R, 6, a), each times a shape (N, R)."""
        columns = np.moveaxis(wrench, 0, 1)
        if self.course is None:
            return np.asarray(self.block.transform(shape)[:, None, :, None] * columns)
        each = (shape[:, None, :, None] * columns).reshape(len(shape), 6, -1)
        return self.transform(each).reshape(len(self.block.frequency), *columns.shape)

    def derivative(self, rows: slice, signal: FloatArray, order: int) -> ComplexArray:
        """Coefficients (F, 6, c) of T times a derivative of signals (N, 3, c) in three rows of e.

        rows : of the force or of the moment. order : 1 or 2.
        """
        N, _, c = signal.shape
        if self.course is None:
            out = np.zeros((len(self.block.frequency), 6, c), dtype=np.complex128)
            out[:, rows] = self.block.transform(signal, derivative=order)
            return out
        both = derivatives(signal.reshape(N, -1), self.block.step, _HALF)
        return self.block.transform(self.course[:, :, rows] @ both[order - 1].reshape(N, 3, c))


def filled(posture: Postures, driven: FloatArray, state: State, g: float) -> Postures:
    """Instants, evenly spaced, with the forces that nobody measures as the balance demands them.

    driven : (N, 6), wrench of inertia and friction about the barycentre.

    They are the levers of the turns alone. Some combinations hardly reach the balance (a push
    along the line between two hinges), so that they come smoothed over as many instants as they
    need: min Σ |e + W u|² / σ² + |u''|² / q², with second differences q of white noise, √6 σ.
    """
    missing = ~posture.measured
    force = np.where(missing, 0.0, posture.force)
    bare = replace(posture, force=force, measured=np.ones_like(missing))
    at = balance(bare, state, state.barycentre, g)
    root = np.linalg.inv(_unit_root(at))
    W = root @ free(at.noise_force, ~missing)
    e = root @ (at.design @ features(state, at, g) + driven)[..., None]
    force[:, missing] = _smooth(np.swapaxes(W, 1, 2) @ W, -(np.swapaxes(W, 1, 2) @ e)[..., 0])
    return replace(bare, force=force)


def _smooth(information: FloatArray, right: FloatArray) -> FloatArray:
    """Solution u (N, m) of H u + D u = right; H (N, m, m), D that of second differences."""
    from scipy.linalg import solveh_banded  # slow to import, seldom needed

    N, m = right.shape
    bands = np.zeros((2 * m + 1, N, m))
    second = np.array([1.0, -2.0, 1.0]) / np.sqrt(6.0)
    for lag in range(3):  # lower bands of DᵀD, second difference by second difference
        for k in range(3 - lag):
            bands[lag * m, k : N - 2 + k] += second[k] * second[k + lag]
    for b in range(m):
        bands[: m - b, :, b] += information[:, b:, b].T
    return np.asarray(
        solveh_banded(bands.reshape(2 * m + 1, N * m), right.ravel(), lower=True).reshape(N, m)
    )


def _unit_root(at: Balance) -> FloatArray:
    """Triangular root (6, 6) of the mean covariance of e for unit forces on all axes."""
    return np.linalg.cholesky(np.einsum("knra,knsa->rs", at.wrench, at.wrench) / len(at.arm))


def across(block: Block, at: Balance, measured: BoolArray) -> Across:
    """What of a block's balance no force on axes that are not measured (n, 3) reaches.

    Raises NotIdentifiableError where they reach all of it.
    """
    if measured.all():
        return Across(block, np.eye(6))
    root = _unit_root(at)
    left, size, _ = np.linalg.svd(np.linalg.solve(root, free(at.noise_force, measured)))
    reached = int(np.median((size > _ROUNDING * size[:, :1]).sum(axis=1)))
    if reached == 6:
        raise NotIdentifiableError(Finding("axes-leave-nothing"))
    basis = _carried(left[:, :, reached:])
    seen = np.linalg.solve(root.T, basis[0]).T
    T = root @ basis[0] @ np.swapaxes(np.linalg.solve(root.T, basis), 1, 2)
    return Across(block, seen, T)


def _carried(basis: FloatArray) -> FloatArray:
    """Orthonormal bases (N, 6, r) of spaces that turn, each turned to meet the one before."""
    out = basis.copy()
    for k in range(1, len(out)):
        u, _, v = np.linalg.svd(out[k].T @ out[k - 1])
        out[k] = out[k] @ (u @ v)
    return out
