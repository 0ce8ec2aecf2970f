"""What the search for dwells works on: where signals change, their noise and ringing.

A signal changes its level where a difference of neighbouring window means exceeds its noise; the
rest is found from the quietest windows of the log, alternating with the noise measured on it.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from tdfscal.dwells.bins import Bins
from tdfscal.dwells.dwell_means import Extent
from tdfscal.dwells.noise_level import (
    LONGEST,
    SCALES,
    Noise,
    Signals,
    blocks,
    clean,
    difference_noise,
    differences,
    evened,
    runs,
    signals,
    without_creep,
)
from tdfscal.dwells.ringing import Ringing, find_ringing
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.records import BoolArray, FloatArray, IntArray, LeftOut
from tdfscal.significance import DRIFT_PER_LOG, LEVEL_CHANGES_PER_LOG

_ROUNDS = 4
_SEED_QUANTILE = 0.02  # at least this share of a log is rest
_SEED_WINDOW = 0.2  # s
SHORTEST = 0.2  # s, of a dwell sampled fast
_SHORTEST_BINS = 5
_MANY = 10  # stops that show what is common
_ALIKE = 0.8  # share of them with one sign
_MEDIAN = 1.2533141373155003  # standard error of a median / that of a mean, Gaussian
_LAST = 0.75  # of a stop: what comes before is settling, as a rule
_SHORTEST_SLOPE = 8  # bins
_SMOOTH = 2.0 * np.sqrt(2.0 ** (SCALES - 1))  # growth of differences in a motion


def mark_changes(signal: Signals, noise: Noise, marked: BoolArray) -> BoolArray:
    """Bins that are marked already, or where the level of any axis changes.

    Small windows first: they place a change best, and larger windows then keep clear of it.
    """
    marked = marked.copy()
    limit = threshold(signal, noise)
    for scale, (width, difference) in enumerate(differences(signal.value, SCALES)):
        np.abs(difference, out=difference)
        difference -= limit[scale][:, None]
        excess = difference.max(axis=0)
        free = clean(marked, 2 * width)
        for first, last in zip(*runs((excess > 0) & free), strict=True):
            peak = first + int(np.argmax(excess[first:last]))
            # A step at a bin raises the differences ±W about it, most at the step itself. A peak
            # at the border of what is marked already is the end of a gradual change beyond it.
            begin = min(peak + width - 1, first + width + width // 2)
            end = max(peak + width + 1, last - 1 + width - width // 2)
            if peak == first and (first == 0 or not free[first - 1]):
                begin = first
            if peak == last - 1 and (last == len(free) or not free[last]):
                end = last - 1 + 2 * width
            marked[begin:end] = True
    return marked


def threshold(signal: Signals, noise: Noise) -> FloatArray:
    """Difference that noise and resolution do not explain, (scales, A)."""
    tests = max(signal.value.size, 1) * SCALES
    quantile = float(-ndtri(0.5 * LEVEL_CHANGES_PER_LOG / tests))
    rounding = 8.0 * np.finfo(np.float64).eps * np.abs(signal.value).max(axis=1, initial=0.0)
    difference = np.sqrt(2.0) * noise.of_mean(2 ** np.arange(SCALES))
    return np.asarray(quantile * difference + 1.001 * noise.quantum + rounding)


def quiet_seed(signal: Signals, base: BoolArray, width: float) -> BoolArray:
    """Bins that may be in motion (or are in base), for a first estimate of the noise on the rest.

    The seed of rest are the windows with the smallest range; a range of zero (encoders
    without noise, a servo that is off) counts as quiet, yet does not set the scale.
    """
    size = max(5, round(_SEED_WINDOW / width))
    ends = ((0, 0), (size // 2, size - 1 - size // 2))
    high = low = np.pad(signal.value, ends, mode="symmetric")
    seen = 1  # bins whose highest and lowest these are
    while seen < size:
        more = min(seen, size - seen)
        high = np.maximum(high[:, :-more], high[:, more:])
        low = np.minimum(low[:, :-more], low[:, more:])
        seen += more
    reach = (high - low).max(axis=0)
    tiny = 8.0 * np.finfo(np.float64).eps * np.abs(signal.value).max(initial=0.0)
    alive = reach[(reach > tiny) & ~base]
    if not len(alive):
        return base
    return np.asarray((reach > 2.0 * np.quantile(alive, _SEED_QUANTILE)) | base)


def segment(
    signal: Signals, base: BoolArray, width: float, quiet: Signals | None = None
) -> tuple[BoolArray, Noise]:
    """Alternate noise and marks until they agree; base: bins that are out in any case.

    width : of a bin, s. quiet : the signals in which the last marks are made, their louder rests
    evened. Blocks over the whole log are enough for the noise of a long one.
    """
    sample, out = blocks(signal, base)
    marked = quiet_seed(sample, out, width)
    for _ in range(_ROUNDS):
        noise = difference_noise(sample, marked, SCALES)
        # Differences of windows grow like W in a smooth motion, like √W at most in noise.
        short = np.maximum(noise.difference[0], noise.quantum)
        if np.any(noise.difference[-1] > _SMOOTH * short + 1e-300):
            return np.ones_like(base), noise
        noise = without_creep(noise)
        previous, marked = marked, mark_changes(sample, noise, out)
        if np.array_equal(previous, marked):
            break
    return mark_changes(quiet or signal, noise, base), noise


@record
class Field:
    """What the search works on: signals, where they change, their noise, the limits in bins.

    signals : of 6n axes, positions first; the forces without drift common to all stops, without
    ringing, and of one noise in all stops. positions : (3n, B), m. visible : (3n,), m, change of a
    position between two bins that stands out of the noise.
    """

    bins: Bins
    signals: Signals
    positions: FloatArray
    moving: BoolArray
    disturbed: BoolArray
    noise: Noise
    visible: FloatArray
    shortest: int
    ringing: Ringing | None

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
    positions, forces = (
        Signals(value, every.gap, quantum)
        for value, quantum in zip(
            np.split(every.value, [axes]), np.split(every.quantum, [axes]), strict=True
        )
    )
    step = np.diff(bins.start, prepend=bins.start[0] - bins.width)
    gap = every.gap | (step > 1.5 * bins.width)  # or a stretch without any sample before it
    moving, position_noise = segment(positions, gap, bins.width)
    # A bin at the edge of a move may hold its first samples.
    moving = np.asarray(np.convolve(moving, np.ones(3))[1 : len(moving) + 1] > 0)
    rests = runs(~moving)
    rate = drift_of_rests(forces.value, *rests, bins.width)
    drift = rate[:, None] * (bins.start - bins.start[0])
    forces = replace(forces, value=forces.value - drift)
    quiet = evened(forces, moving)
    disturbed, noise = segment(forces, moving, bins.width, quiet)
    ringing = find_ringing(forces.value, noise.of_mean(1), *rests, bins.width)
    if ringing is not None:
        forces = replace(forces, value=ringing.removed(forces.value))
        quiet = evened(forces, moving)
        disturbed, _ = segment(forces, moving, bins.width, quiet)
    every = replace(every, value=np.concatenate([positions.value, quiet.value]))
    return Field(
        bins=bins,
        signals=every,
        positions=every.value[:axes],
        moving=moving,
        disturbed=disturbed,
        noise=without_creep(difference_noise(every, disturbed, LONGEST)),
        visible=threshold(positions, position_noise)[0],
        shortest=max(int(np.ceil(SHORTEST / bins.width - 1e-9)), _SHORTEST_BINS),
        ringing=ringing,
    )


def within(field: Field, extents: list[Extent]) -> Field:
    """The field with the noise of the dwells alone: settling no longer counts as noise."""
    out = np.ones(len(field.bins), dtype=np.bool_)
    for extent in extents:
        out[extent.rows] = False
    return replace(field, noise=without_creep(difference_noise(field.signals, out, LONGEST)))


def drift_of_rests(value: FloatArray, first: IntArray, last: IntArray, width: float) -> FloatArray:
    """Drift (A,), N/s, that stops [first, last) of forces (A, B) in bins of width s have in common.

    Settling takes the sign of the move before it; the drift of a zero keeps its own. The noise of a
    slope goes with the length to the power of −3/2.
    """
    slopes, lengths = [], []
    for a, b in zip(first, last, strict=True):
        a = b - round(_LAST * (b - a))
        if b - a >= _SHORTEST_SLOPE:
            t = np.arange(b - a) - 0.5 * (b - a - 1)
            slopes.append(value[:, a:b] @ t / (t @ t) / width)
            lengths.append(b - a)
    if len(slopes) < _MANY:
        return np.zeros(len(value))
    slope, weight = np.array(slopes), np.array(lengths)[:, None] ** 1.5
    order = np.argsort(slope, axis=0)
    share = np.cumsum(weight[order, 0], axis=0)
    half = np.argmax(share >= 0.5 * share[-1], axis=0)
    middle = np.take_along_axis(np.sort(slope, axis=0), half[None], axis=0)[0]  # weighted median
    alike = (weight * (np.sign(slope) == np.sign(middle))).sum(axis=0) >= _ALIKE * weight.sum()
    spread = 1.4826 * np.median(np.abs(slope - middle) * weight, axis=0)
    spread = _MEDIAN * spread / np.sqrt((weight**2).sum())
    z = float(-ndtri(0.5 * DRIFT_PER_LOG / len(middle)))
    return np.asarray(np.where(alike & (np.abs(middle) > z * spread), middle, 0.0))
