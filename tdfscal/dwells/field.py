"""What the search for dwells works on: signals, where they change, noise, drift and ringing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from tdfscal.dwells.bins import Bins
from tdfscal.dwells.change_points import segment, threshold
from tdfscal.dwells.dwell_means import Extent
from tdfscal.dwells.noise_level import (
    LONGEST,
    Noise,
    Signals,
    difference_noise,
    noisier_stops,
    runs,
    signals,
    without_creep,
)
from tdfscal.dwells.ringing import Ringing, find_ringing
from tdfscal.findings import Finding
from tdfscal.records import BoolArray, FloatArray, IntArray, LeftOut
from tdfscal.significance import DRIFT_PER_LOG

_SHORTEST = 0.2  # s
_SHORTEST_BINS = 5
_MANY = 10  # stops that show what is common
_ALIKE = 0.8  # share of them with one sign
_MEDIAN = 1.2533141373155003  # standard error of a median / that of a mean, Gaussian
_LAST = 0.75  # of a stop: what comes before is settling, as a rule
_SHORTEST_SLOPE = 8  # bins


@dataclass(frozen=True, slots=True)
class Field:
    """What the search works on: signals, where they change, their noise, the limits in bins.

    signals : of 6n axes, positions first; a drift of all stops, rate (3n,), N/s, and ringing are
    removed from the forces. visible : (3n,), m, change of a position between two bins that stands
    out of the noise. noisier : see `noisier_stops`.
    """

    bins: Bins
    signals: Signals
    moving: BoolArray
    disturbed: BoolArray
    noisier: FloatArray | None
    noise: Noise
    visible: FloatArray
    shortest: int
    rate: FloatArray
    ringing: Ringing | None

    @property
    def positions(self) -> FloatArray:
        """(3n, B), m."""
        return self.signals.value[: 3 * len(self.bins.supports)]

    @property
    def long_run(self) -> FloatArray:
        """First guess (6n,), from the longest windows whose noise was measured."""
        width = 2 ** (len(self.noise.difference) - 1)
        return np.asarray(self.noise.of_mean(width) * np.sqrt(width))

    def noisier_at(self, index: int) -> FloatArray:
        """How much noisier the rest at a bin is than most, (6n,)."""
        every = np.ones(len(self.signals.value))
        if self.noisier is not None:
            every[len(self.positions) :] = self.noisier[:, index]
        return every

    def time(self, index: int) -> float:
        """Time of a bin's edge, s."""
        if index < len(self.bins):
            return float(self.bins.start[index])
        return float(self.bins.start[-1] + self.bins.width)

    def out(self, begin: int, end: int, reason: Finding) -> LeftOut:
        """A stretch of bins left out; `end` is exclusive."""
        return LeftOut(self.time(begin), self.time(end - 1) + self.bins.width, reason)


def prepare(bins: Bins) -> Field:
    """Noise and changes of all signals."""
    axes = 3 * len(bins.supports)
    every = signals(bins)
    positions, forces = every.axes(slice(axes)), every.axes(slice(axes, None))
    step = np.diff(bins.start, prepend=bins.start[0] - bins.width)
    gap = every.gap | (step > 1.5 * bins.width)  # or a stretch without any sample before it
    moving, position_noise = segment(positions, gap, bins.width)
    moving = _dilated(moving)
    rests = runs(~moving)
    rate = drift_of_rests(forces.value, *rests, bins.width)
    if rate.any():
        time = bins.start - bins.start[0]
        forces = replace(forces, value=forces.value - rate[:, None] * time)
    noisier = noisier_stops(forces, moving)
    disturbed, noise = segment(forces, moving, bins.width, noisier)
    ringing = find_ringing(forces.value, noise.of_mean(1), *rests, bins.width)
    if ringing is not None:
        forces = replace(forces, value=ringing.removed(forces.value))
        noisier = noisier_stops(forces, moving)
        disturbed, _ = segment(forces, moving, bins.width, noisier)
    if rate.any() or ringing is not None:
        every = replace(every, value=np.concatenate([positions.value, forces.value]))
    return Field(
        bins=bins,
        signals=every,
        moving=moving,
        disturbed=disturbed,
        noisier=noisier,
        noise=without_creep(difference_noise(every, disturbed, LONGEST)),
        visible=threshold(positions, position_noise)[0],
        shortest=max(int(np.ceil(_SHORTEST / bins.width - 1e-9)), _SHORTEST_BINS),
        rate=rate,
        ringing=ringing,
    )


def within(field: Field, extents: list[Extent]) -> Field:
    """The field with the noise of the dwells alone: settling no longer counts as noise."""
    out = np.ones(len(field.bins), dtype=np.bool_)
    for extent in extents:
        out[extent.rows] = False
    return replace(field, noise=without_creep(difference_noise(field.signals, out, LONGEST)))


def _dilated(flag: BoolArray) -> BoolArray:
    """One bin more on either side: a bin at the edge of a move may hold its first samples."""
    wide = flag.copy()
    wide[1:] |= flag[:-1]
    wide[:-1] |= flag[1:]
    return wide


def common_drift(slope: FloatArray, length: FloatArray) -> FloatArray:
    """Drift (A,) of slopes (K, A) of stops of some length (K,); 0 where they show none.

    Settling takes the sign of the move before it; the drift of a zero keeps its own. The noise of a
    slope goes with the length to the power of −3/2.
    """
    if len(slope) < _MANY:
        return np.zeros(slope.shape[1])
    weight = length[:, None] ** 1.5
    middle = _median(slope, weight)
    alike = (weight * (np.sign(slope) == np.sign(middle))).sum(axis=0) >= _ALIKE * weight.sum()
    spread = 1.4826 * np.median(np.abs(slope - middle) * weight, axis=0)
    spread = _MEDIAN * spread / np.sqrt((weight**2).sum())
    z = float(-ndtri(0.5 * DRIFT_PER_LOG / len(middle)))
    return np.asarray(np.where(alike & (np.abs(middle) > z * spread), middle, 0.0))


def _median(value: FloatArray, weight: FloatArray) -> FloatArray:
    """(A,) of (K, A), each counted by its weight (K, 1)."""
    order = np.argsort(value, axis=0)
    share = np.cumsum(weight[order, 0], axis=0)
    half = np.argmax(share >= 0.5 * share[-1], axis=0)
    at = np.take_along_axis(order, half[None], axis=0)
    return np.asarray(np.take_along_axis(value, at, axis=0)[0])


def drift_of_rests(value: FloatArray, first: IntArray, last: IntArray, width: float) -> FloatArray:
    """Common drift (A,), N/s, of forces (A, B) over stops [first, last) in bins of width s."""
    slopes, lengths = [], []
    for a, b in zip(first, last, strict=True):
        a = b - round(_LAST * (b - a))
        if b - a >= _SHORTEST_SLOPE:
            t = np.arange(b - a) - 0.5 * (b - a - 1)
            slopes.append(value[:, a:b] @ t / (t @ t) / width)
            lengths.append(b - a)
    return common_drift(np.array(slopes).reshape(-1, len(value)), np.array(lengths, np.float64))
