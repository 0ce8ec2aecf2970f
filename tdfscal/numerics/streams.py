"""Values over time: a spline, when a move passes its levels, how a lag grows, what spans cover.

Projected onto its own change, whatever moves from rest to rest runs from 0 to 1; two of them are
compared by when they pass the same levels. The rate is the median slope over all pairs of moves
(Sen, J. Am. Stat. Assoc. 63, 1968).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from tdfscal.frozen import record
from tdfscal.numerics.distributions import widening
from tdfscal.records import BoolArray, FloatArray


def even_spline(value: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Cubic spline through values (N, ...) at 0, 1, …, N − 1, N ≥ 4, as a function of places (M,).

    Its third derivative does not jump at the second and the last but one of them ("not a knot").
    """
    from scipy.linalg import solve_banded  # slow to import, seldom needed

    N, change = len(value), np.diff(value, axis=0)
    bands = np.ones((3, N))
    bands[1, 1:-1] = 4.0
    bands[0, 1] = bands[2, -2] = 2.0
    right = np.empty(value.shape)
    right[1:-1] = 3 * (change[1:] + change[:-1])
    right[0], right[-1] = (5 * change[0] + change[1]) / 2, (5 * change[-1] + change[-2]) / 2
    slope = solve_banded((1, 1), bands, right.reshape(N, -1)).reshape(value.shape)

    def at(place: FloatArray) -> FloatArray:
        k = np.clip(np.floor(place).astype(int), 0, N - 2)
        t = (place - k).reshape(-1, *(1,) * (value.ndim - 1))
        bend = slope[k] - change[k], slope[k + 1] - change[k]
        return np.asarray(
            value[k] + t * change[k] + t * (1 - t) * ((1 - t) * bend[0] - t * bend[1])
        )

    return at


_CLEAR = 40.0  # change / noise, from which a move shows its time
_FEWEST = 4  # instants of a rest that tell the noise
_LEVELS = (0.25, 0.5, 0.75)
_EFFICIENCY = 0.4  # of a median deviation as a standard deviation: degrees of freedom per value
_MEDIAN = 1.2533141373155003  # standard error of a median / that of a mean, Gaussian


@record
class Line:
    """What moves show: seconds at their middle, s, its growth, rate; standard errors; span, s.

    Three standard errors cover 99.73 %: those of few moves are wider by Student's distribution.
    """

    seconds: float
    std: float
    rate: float
    rate_std: float
    middle: float
    span: float
    moves: int


def times_of_passing(
    value: FloatArray, time: FloatArray, ends: FloatArray, rests: Sequence[BoolArray]
) -> FloatArray | None:
    """Times (3,) at which streams (T, c), at times (T,), pass the levels on their way.

    ends : (2, c), where they rest before and after. rests : which instants (T,) are of rests.
    None where a level is passed more than once or never, or noise hides when.
    """
    change = ends[1] - ends[0]
    size = float(change @ change)
    if size == 0.0 or min(rest.sum() for rest in rests) < _FEWEST:
        return None
    share = (value - ends[0]) @ change / size
    if max(float(np.std(share[rest])) for rest in rests) * _CLEAR > 1.0:
        return None
    times = []
    for level in _LEVELS:
        across = np.flatnonzero(np.diff(np.sign(share - level)) != 0)
        if len(across) != 1:
            return None
        a = int(across[0])
        part = (level - share[a]) / (share[a + 1] - share[a])
        times.append(time[a] + part * (time[a + 1] - time[a]))
    return np.array(times)


def line_through(time: FloatArray, value: FloatArray, least: float) -> Line:
    """Line of values (M,), s, of moves at ascending times (M,), s.

    least : s, what no number of moves tells better.
    """
    span = float(np.ptp(time))
    middle = float(time[0]) + span / 2
    away = time - middle
    i, j = np.triu_indices(len(time), 1)
    rate = float(np.median((value[j] - value[i]) / (time[j] - time[i])))
    left = value - rate * away
    offset = float(np.median(left))
    spread = _MEDIAN * 1.4826 * float(np.median(np.abs(left - offset)))
    spread *= widening(_EFFICIENCY * (len(time) - 2))
    std = float(np.hypot(spread / np.sqrt(len(time)), least))
    rate_std = float(np.hypot(spread / np.linalg.norm(away - away.mean()), least / span))
    return Line(offset, std, rate, rate_std, middle, span, len(time))


def covered(spans: Iterable[Any]) -> float:
    """Length of what spans, each with its begin and end, cover together."""
    total, reached = 0.0, -np.inf
    for span in sorted(spans, key=lambda span: span.begin):
        total += max(0.0, span.end - max(span.begin, reached))
        reached = max(reached, span.end)
    return float(total)
