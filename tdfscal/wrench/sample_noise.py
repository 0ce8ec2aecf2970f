"""What a single sample adds to the uncertainty of the contact wrench, whatever makes it.

The scatter of the wrench itself within static dwells holds the noise of all channels with their
correlation, what a filter leaves of it, and the noise of accelerations. What is slower than a
dwell shows in the residuals of the calibration's own postures, and in what the rig file declares.

Noise that is alike and independent along the three axes of each sensor makes a wrench whose
variance does not depend on the pose: in the LCS it is Σ_i [I; [r_i]×] [I; [r_i]×]ᵀ times theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain

import numpy as np

from tdfscal.dwells import dwells_of_bins, reduce_to_bins
from tdfscal.errors import TdfscalError
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.statics import wrench
from tdfscal.records import FloatArray, Log, Series
from tdfscal.wrench.contact_wrench import Wrenches
from tdfscal.wrench.resampling import Samples

#: Where nothing rests: windows whose scatter about a parabola counts, s and samples at least.
_WINDOW, _FEWEST = 0.5, 32
#: Samples that the noise is measured on.
HEAD = 65_536


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

    NaN where the samples are too few to show any. dwells : static dwells behind it; without any it
    is the scatter of `windows` short windows, which noise slower than these escapes.
    """

    std: FloatArray
    dwells: int
    windows: int


def with_sample_noise(
    pieces: Iterator[Wrenches],
    head: LogHead,
    given: Calibrated,
    *,
    posture_std: float,
    zero_variance: Callable[[FloatArray], FloatArray] | None,
    tell: Callable[[SampleNoise], None],
) -> Iterator[Wrenches]:
    """Add the noise of a sample, and zeros that move, to the standard uncertainties.

    posture_std : N per axis, by which the calibration's own postures scattered beyond the
    calibration.
    zero_variance : N², (N, n or 1) at times (N,), s, by which zeros have moved since.
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
        variance, windows = _scatter_in_windows(time, value)
    return SampleNoise(np.sqrt(variance + lost * each), len(rows), windows)


def _scatter_in_windows(time: FloatArray, value: FloatArray) -> tuple[FloatArray, int]:
    """Median over short windows of the variance (6,) about a parabola, and their number."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    size = max(_FEWEST, round(_WINDOW / step)) if np.isfinite(step) else _FEWEST
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
