"""When something moves: the log of how fast the streams of a recorder change, and its correlation.

The cross-correlation of two such courses has a peak at every lag that brings their moves together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.clocks.tracks import Track
from tdfscal.records import FloatArray, RecorderActivity

_STRIDE = 3  # bins over which a change is taken
_FLOOR = 3.0  # times the noise, below which a change is none
_SHOWN = 300.0  # s of both recordings that are kept for a look,
_DRAWN = 400  # in as many bins at most


@dataclass(frozen=True, slots=True)
class Peak:
    """A lag, s, at which two courses are alike; r : their correlation over the overlap, s."""

    lag: float
    r: float
    overlap: float

    @property
    def evidence(self) -> float:
        """Log-likelihood ratio against chance, of as many independent values as seconds."""
        return -self.overlap * float(np.log1p(-(min(self.r, 0.9999) ** 2)))


def activity(tracks: Sequence[Track], width: float, end: float) -> FloatArray:
    """Log-activity (B,) in bins of `width` s from time 0 to `end`; NaN where it is not known."""
    bins = int(end / width) + 1
    middle = width * np.arange(0.5, bins, dtype=np.float64)
    ahead, behind = middle + 0.5 * _STRIDE * width, middle - 0.5 * _STRIDE * width
    total, floor, known = np.zeros(bins), 0.0, np.ones(bins, dtype=np.bool_)
    for track in tracks:
        mean = _averaged(track, width)
        after, there = mean.at(ahead)
        before, here = mean.at(behind)
        known &= there & here
        change = after - before
        scale = np.sqrt(np.mean(change[there & here] ** 2, axis=0)) if known.any() else np.ones(3)
        scale = np.where(scale > 0, scale, np.inf)
        bend = np.abs(np.diff(mean.value, n=2, axis=0))
        noise = np.median(bend, axis=0) / (0.6745 * np.sqrt(6.0)) if len(bend) else np.zeros(3)
        total += np.sum((change / scale) ** 2, axis=1)
        floor += float(np.sum(2.0 * (noise / scale) ** 2))
    channels = 3 * max(len(tracks), 1)
    course = np.log(total / channels + _FLOOR**2 * floor / channels + 1e-4)
    return np.where(known, course, np.nan)


def _averaged(track: Track, width: float) -> Track:
    """Means over bins of `width`; of a track that is sparser, itself."""
    number = np.floor(track.time / width)
    first = np.flatnonzero(np.diff(number, prepend=-np.inf))
    count = np.diff(first, append=len(number))
    time = np.add.reduceat(track.time, first) / count
    return Track.of(time, np.add.reduceat(track.value, first, axis=0) / count[:, None])


def peaks(a: FloatArray, b: FloatArray, width: float, least: float, most: int) -> list[Peak]:
    """Lags at which course b (B′,) follows course a (B,), the likeliest first.

    A lag is positive where b's own clock, from its begin, shows the same move later.
    least : s, shortest overlap. Correlation over the overlap alone, by masks (Padfield 2012).
    """
    lag, r, overlap = _correlation(a, b)
    evidence = -overlap * np.log1p(-(np.clip(r, 0.0, 0.9999) ** 2))
    evidence[overlap * width < least] = 0.0
    crest = np.ones(len(lag), dtype=np.bool_)
    crest[1:] &= evidence[1:] > evidence[:-1]
    crest[:-1] &= evidence[:-1] >= evidence[1:]
    order = np.flatnonzero(crest & (evidence > 0))
    order = order[np.argsort(-evidence[order])]
    found: list[Peak] = []
    for k in order.tolist():
        if len(found) == most:
            break
        if all(abs(lag[k] * width - peak.lag) > 2 * _STRIDE * width for peak in found):
            found.append(Peak(float(lag[k] * width), float(r[k]), float(overlap[k] * width)))
    return found


def during(a: FloatArray, b: FloatArray, width: float, lag: float) -> RecorderActivity:
    """Keep of courses a (B,) and b (B′,) the first minutes in which both recorders ran."""
    shift = round(lag / width)
    begin = max(0, -shift)
    count = min(len(a) - begin, len(b) - begin - shift, int(_SHOWN / width))
    wide = max(1, -(-count // _DRAWN))
    cut = max(count - count % wide, 0)

    def thinned(course: FloatArray, start: int) -> FloatArray:
        return np.asarray(course[start : start + cut].reshape(-1, wide).mean(axis=1))

    return RecorderActivity(
        width * wide,
        lag,
        begin * width,
        thinned(a, begin),
        (begin + shift) * width,
        thinned(b, begin + shift),
    )


def _correlation(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lags (L,) in bins, correlation over the overlap, and its bins."""
    known = [np.isfinite(x).astype(float) for x in (a, b)]
    level = [np.where(m > 0, x - np.mean(x[m > 0]) if m.any() else 0.0, 0.0)
             for x, m in zip((a, b), known, strict=True)]  # fmt: skip
    size = 1 << (len(a) + len(b) - 1).bit_length()

    def together(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)

    count = np.rint(together(known[0], known[1]))
    n = np.maximum(count, 1.0)
    sum_a, sum_b = together(level[0], known[1]), together(known[0], level[1])
    square_a = together(level[0] ** 2, known[1]) - sum_a**2 / n
    square_b = together(known[0], level[1] ** 2) - sum_b**2 / n
    least_a, least_b = (1e-3 * np.mean(x**2) for x in level)
    size_of = np.sqrt(np.maximum(square_a, least_a * n) * np.maximum(square_b, least_b * n))
    product = together(level[0], level[1]) - sum_a * sum_b / n
    r = np.divide(product, size_of, out=np.zeros(size), where=(size_of > 0) & (count > 2))
    lag = np.arange(size)
    lag[lag > size // 2] -= size
    order = np.argsort(lag)
    return lag[order].astype(float), np.clip(r[order], -1, 1), count[order]
