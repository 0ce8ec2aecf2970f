"""What adds to the uncertainty of a contact wrench after the calibration: noise, moved zeros.

By all of it the wrench at stops is held against chance: what is larger at most of them is contact
there, or no calibration of this rig as it is.

The scatter of the wrench itself within static dwells holds the noise of all channels with their
correlation, what a filter leaves of it, and the noise of accelerations. What is slower than a
dwell shows in the residuals of the calibration's own postures, and in what the rig file declares.
Noise that is alike and independent along the three axes of each sensor makes a wrench whose
variance does not depend on the pose: in the LCS it is Σ_i [I; [r_i]×] [I; [r_i]×]ᵀ times theirs.

1/f noise of one-sided spectral density A/f has the generalised autocovariance −A ln|τ|. The zero of
a calibration is the mean of this noise over its campaign of length T. At a time u from the middle
of the campaign the noise differs from that mean by a variance which exceeds the one that the
campaign's own postures show by

    A [2 g(u/T) + 3],    g(x) = ∫ ln|x − s| ds over −½ … ½.

It grows with the logarithm of the age, as far as the spectrum goes on as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from tdfscal.dwells import dwells_of_bins, reduce_to_bins
from tdfscal.errors import TdfscalError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.postures import ZeroAge
from tdfscal.model.samples_in_motion import Samples
from tdfscal.model.statics import wrench
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import BoolArray, Drift, FloatArray, Log, Series
from tdfscal.significance import CONTACT_ON_PATH
from tdfscal.wrench.contact_wrench import COMPONENTS, Wrenches

#: Where nothing rests: windows whose scatter about a parabola counts, s and samples at least.
_WINDOW, FEWEST = 0.5, 32
#: Time after a move in which forces settle, s.
_SETTLED = 1.0
#: Samples that the noise is measured on.
HEAD = 65_536
#: Differences of neighbouring means per channel behind an Allan variance, at least.
_DIFFERENCES = 4

#: Variance (N, n or 1), N², at times (N,), s.
ZeroVariance = Callable[[FloatArray], FloatArray]


@record
class LogHead:
    """The first samples of a log, and the static dwells among them.

    start, end : (D,), s. mean_variance : N², of a dwell's mean force, mean over dwells and axes.
    averaged : each row is a posture's mean already, in which no noise shows.
    """

    samples: Samples
    start: FloatArray
    end: FloatArray
    mean_variance: float
    averaged: bool

    def dwells(self, time: FloatArray) -> Iterator[slice]:
        """Rows of ascending times (N,), s, that lie in each dwell."""
        for a, b in zip(self.start, self.end, strict=True):
            first, last = np.searchsorted(time, [a, b])
            if last - first > 1:
                yield slice(int(first), int(last))


def take_head(
    samples: Iterable[Samples], supports: tuple[str, ...], *, averaged: bool
) -> tuple[LogHead | None, Iterator[Samples]]:
    """Read ahead, and return the beginning and the samples from their first on.

    averaged : as in `LogHead`. None where there is no sample.
    """
    source, first, count = iter(samples), list[Samples](), 0
    while count < HEAD and (piece := next(source, None)) is not None:
        first.append(piece)
        count += piece.time.size
    if not first:
        return None, source
    head = Samples.joined(first).rows(slice(HEAD))
    return _searched(head, supports, averaged=averaged), chain(first, source)


def _searched(head: Samples, supports: tuple[str, ...], *, averaged: bool) -> LogHead:
    none = LogHead(head, np.empty(0), np.empty(0), 0.0, averaged)
    if averaged:
        return none
    position, force = (
        tuple(Series(head.time, np.ascontiguousarray(v[:, i])) for i in range(len(supports)))
        for v in (head.position, head.force)
    )
    try:
        found = dwells_of_bins(reduce_to_bins([Log(supports, position, force)]))
    except TdfscalError:
        return none
    if not len(found):
        return none
    variance = np.diagonal(found.force_cov, axis1=2, axis2=3)
    return LogHead(head, found.start, found.end, float(variance.mean()), averaged)


@record
class SampleNoise:
    """Standard deviation (6,) of a sample's contact wrench by its own noise, N and N·m, LCS.

    NaN where the samples are too few to show any. slow_std : of it what stays in the mean of a
    stop. dwells : static dwells behind it; without any it is the scatter of `windows` short
    windows, which noise slower than these escapes.
    """

    std: FloatArray
    slow_std: FloatArray
    dwells: int
    windows: int


def with_sample_noise(
    pieces: Iterator[Wrenches],
    head: LogHead,
    given: Calibrated,
    *,
    posture_std: float,
    zero_variance: ZeroVariance | None,
    tell: Callable[[SampleNoise], None],
) -> Iterator[Wrenches]:
    """Add the noise of a sample, and zeros that move, to the standard uncertainties.

    posture_std : N per axis, by which the calibration's own postures scattered beyond the
    calibration.
    zero_variance : by which zeros have moved since.
    tell : is told the noise before the first piece comes.
    """
    held = list[Wrenches]()
    for piece in pieces:
        held.append(piece)
        if piece.time[-1] >= head.samples.time[-1]:
            break
    if not held:
        return
    each = by_sensor(given)
    slow = posture_std**2 - given.rig.declared.force_noise**2
    noise = _noise(held, head, each.sum(axis=0), slow)
    tell(noise)
    for piece in chain(held, pieces):
        variance = piece.std**2 + noise.std**2
        if zero_variance is not None:
            moved = np.broadcast_to(zero_variance(piece.time), (len(variance), len(each)))
            variance = variance + moved @ each
        yield replace(piece, std=np.sqrt(variance))


def by_sensor(given: Calibrated) -> FloatArray:
    """Variance (n, 6) of the wrench by one of each axis of a sensor, per N²."""
    B = wrench(given.state.hinge)
    return np.asarray(np.einsum("nab,nab->na", B, B))


def _noise(held: list[Wrenches], head: LogHead, each: FloatArray, slow: float) -> SampleNoise:
    time = np.concatenate([piece.time for piece in held])
    value = np.concatenate([piece.value for piece in held])
    rows = list(head.dwells(time))
    # The mean of a dwell takes the slow part of the noise away.
    lost = max(head.mean_variance, slow)
    if head.averaged:
        variance, windows = np.zeros(value.shape[1]), 0
    elif rows:
        squares = sum(np.sum((value[r] - value[r].mean(axis=0)) ** 2, axis=0) for r in rows)
        variance, windows = squares / sum(r.stop - r.start for r in rows), 0
    else:
        variance, windows = scatter_in_windows(time, value)
    kept = lost * each
    return SampleNoise(np.sqrt(variance + kept), np.sqrt(kept), len(rows), windows)


@dataclass(slots=True)
class StopWrenches:
    """Mean wrenches of the stops of a log, each from a while after the last move on.

    averaged : each row is a stop by itself.
    """

    averaged: bool
    _moved: float = -np.inf
    _sums: list[FloatArray] = field(default_factory=list)

    def add(self, piece: Wrenches, still: BoolArray) -> None:
        """Take in the wrenches of a piece; which (N,) of its samples lie at a stop."""
        time, each = piece.time, [piece.value, piece.raw, piece.std**2]
        moved = np.append(self._moved, np.where(still, -np.inf, time))
        since = np.maximum.accumulate(moved)[1:]
        self._moved, rests = float(since[-1]), still & (time - since > _SETTLED)
        if self.averaged:
            since, rests = time, np.ones_like(still)
        rows = np.column_stack([np.ones_like(time), *each])[rests]
        self._sums += [np.column_stack(_by_stop(since[rests], rows))] if len(rows) else []

    def means(self, noise: SampleNoise) -> FloatArray:
        """Mean wrench of K stops, uncalibrated too, and its standard uncertainty: (3, K, 6).

        No average takes away what the calibration leaves open, what the rig file declares of a
        posture, and slow noise.
        """
        if not self._sums:
            return np.zeros((3, 0, 6))
        stop, *sums = np.concatenate(self._sums).T
        count, total = np.split(_by_stop(stop, np.array(sums).T)[1], [1], axis=1)
        value, raw, variance = np.split(total / count, 3, axis=1)
        own = np.maximum(noise.slow_std**2, noise.std**2 / count)  # of a brief stop more
        return np.array([value, raw, np.sqrt(variance - noise.std**2 + own)])

    def beyond(self, noise: SampleNoise) -> Finding | None:
        """Name the components that are beyond chance at half of the stops and more.

        At most of these there is no contact, as a rule; the error of a calibration is common to
        all, so that each stop is asked at the level of the whole log.
        """
        value, raw, std = self.means(noise)
        if not len(value):
            return None
        ratio = np.median(np.abs(value) / std, axis=0)
        far = ratio > normal_quantile(1.0 - CONTACT_ON_PATH / (2 * len(ratio)))
        if not far.any():
            return None
        worst = int(np.argmax(np.where(far, ratio, 0.0)))
        size, bare, stated = (float(np.sqrt(np.mean(v[:, worst] ** 2))) for v in (value, raw, std))
        values: dict[str, Value] = {
            "axis": COMPONENTS[worst],
            "expected": stated,
            "stops": str(len(value)) if len(value) > 1 else "",
        }
        values["bare"] = bare if bare < size else None
        axes = tuple(name for name, there in zip(COMPONENTS, far, strict=True) if there)
        return Finding("wrench-at-stops", axes, size, "N" if worst < 3 else "N·m", values=values)


def _by_stop(stop: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stops (K,) that follow each other, and the sums (K, c) of the rows of each."""
    first = np.flatnonzero(np.append(True, stop[1:] != stop[:-1]))
    return stop[first], np.add.reduceat(rows, first, axis=0)


def scatter_in_windows(time: FloatArray, value: FloatArray) -> tuple[FloatArray, int]:
    """Median over short windows of the variance (C,) of (N, C) about a parabola; their number."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    size = max(FEWEST, round(_WINDOW / step)) if np.isfinite(step) else FEWEST
    count = len(time) // size
    if not count:
        return np.full(value.shape[1], np.nan), 0
    parts = value[: count * size].reshape(count, size, -1)
    Q = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 3))[0]
    rest = parts - Q @ (Q.T @ parts)
    freedom = size - 3
    # Wilson and Hilferty: the median of χ² over its degrees of freedom.
    median = (1.0 - 2.0 / (9.0 * freedom)) ** 3
    return np.median(np.sum(rest**2, axis=1), axis=0) / freedom / median, count


def moved_zeros(
    drift: Drift,
    start: float,
    age: ZeroAge,
    temperature: Callable[[FloatArray], FloatArray | None] | None,
) -> ZeroVariance | None:
    """Variance by which zeros have moved since they held; None where they stay.

    start : s, first sample of the log, and age : of the zeros then. temperature : °C, (N, n) at
    times (N,).
    """
    if not (drift.time > 0 or drift.walk > 0 or (drift.temperature > 0 and temperature)):
        return None

    def variance(time: FloatArray) -> FloatArray:
        elapsed = (time - start + age.seconds)[:, None]
        out = _square(drift.time, elapsed) + drift.walk**2 * np.abs(elapsed)
        if drift.temperature > 0 and temperature is not None:
            now, first = temperature(time), temperature(np.array([start]))
            if now is not None and first is not None:
                out = out + _square(drift.temperature, now - first + age.warming)
        return np.asarray(out)

    return variance


def flicker_level(
    head: LogHead, axes: BoolArray, posture_variance: float, span: float, dwell: float
) -> float:
    """A of 1/f noise, N²: the lesser of what dwells and what the calibration's postures show.

    axes : (n, 3), which components are measured. posture_variance : N² per axis, by which the
    calibration's postures scatter beyond what is declared; they span a time, and each lasts a
    dwell, s. Within dwells 1/f noise has the Allan variance 2 ln 2 A at every averaging time; the
    means of dwells scatter over a campaign by A ln(span / dwell). Noise that is white, of short
    memory or constant within a posture shows at one of both scales only.
    """
    if head.averaged or not span > 2 * dwell > 0:
        return 0.0
    within = _allan_variance(head, axes)
    if within is None:
        within = np.inf
    # Of what the means of dwells are stated to scatter by, short memory makes no more than half of
    # what means of half a dwell show; the rest is the 1/f noise itself.
    brief = min(head.mean_variance, within / 2)
    between = max(posture_variance - brief, 0.0) / np.log(span / dwell)
    return float(min(between, within / (2 * np.log(2))))


def flicker(level: float, start: float, age: ZeroAge, span: float) -> ZeroVariance | None:
    """Variance of 1/f noise since the calibration; None where there is none.

    level : A, N². start, age : as for `moved_zeros`. span : s, of the calibration's postures.
    """
    if not level > 0:
        return None

    def variance(time: FloatArray) -> FloatArray:
        x = np.abs(time - start + age.seconds - span / 2) / span
        return np.asarray(level * np.maximum(2.0 * _mean_log(x) + 3.0, 0.0)[:, None])

    return variance


def _mean_log(x: FloatArray) -> FloatArray:
    """∫ ln|x − s| ds over s from −½ to ½."""
    a, b = x + 0.5, x - 0.5
    size = np.abs(b)
    log = np.log(size, where=size > 0, out=np.zeros_like(size))
    return np.asarray(a * np.log(a) - b * log - 1.0)


def _allan_variance(head: LogHead, axes: BoolArray) -> float | None:
    """Of the measured channels, at the longest averaging time that dwells allow; N²."""
    parts = [head.samples.force[row][:, axes] for row in head.dwells(head.samples.time)]
    size = max((len(part) for part in parts), default=0) // 2
    while size:
        whole = [part[: len(part) // size * size].reshape(-1, size, axes.sum()) for part in parts]
        squares = [np.diff(part.mean(axis=1), axis=0) ** 2 for part in whole]
        count = sum(map(len, squares))
        if count >= _DIFFERENCES:
            return float(sum(each.sum() for each in squares) / (2 * count * axes.sum()))
        size //= 2
    return None


def _square(slope: float, change: FloatArray) -> FloatArray:
    """(slope · change)², 0 where nothing has changed, however unknown the slope."""
    moved = change != 0
    return np.square(np.multiply(slope, change, where=moved, out=np.zeros(change.shape)))
