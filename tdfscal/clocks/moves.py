"""Offset and rate of two clocks from single moves, in which forces and positions pass in step.

Projected onto their own change, both run from 0 to 1 in a move from rest to rest; when they pass
the same levels tells the lag. How it changes from move to move tells the rate: the median slope
over all pairs of moves (Sen, J. Am. Stat. Assoc. 63, 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tdfscal.clocks.tracks import Track
from tdfscal.records import FloatArray

_LEVELS = (0.25, 0.5, 0.75)
_CLEAR = 40.0  # change / noise, from which a move shows its time
_LONGEST = 60.0  # s; a longer way from rest to rest is no single move
_REST = 0.6  # s, shortest
_EDGE = 0.2  # s next to a move, in which forces are not yet settled or the lag is not yet known
_FEWEST, _MOST = 5, 400  # moves
_SPAN = 0.1  # s, over which a change shows motion
_MOVING, _SHARE = 8.0, 5e-3  # times the noise, and share of the usual speed of the moves
_MEDIAN = 1.2533141373155003  # standard error of a median / that of a mean, Gaussian
_LEAST = 0.1  # of a period, that no number of moves tells better


def moves(positions: Sequence[Track], span: float, period: float) -> list[tuple[float, float]]:
    """Times (end of a rest, start of the next), s, between which the terminal moves."""
    step = max(0.02, period)
    time = np.arange(0.0, span, step)
    place = np.hstack([track.at(time)[0] for track in positions])
    reach = max(round(_SPAN / step), 1)
    change = np.linalg.norm(place[2 * reach :] - place[: -2 * reach], axis=1)
    bend = np.median(np.abs(np.diff(place, n=2, axis=0)), axis=0) / (0.6745 * np.sqrt(6.0))
    limit = max(_MOVING * float(np.linalg.norm(bend)), _SHARE * float(np.quantile(change, 0.98)))
    still = np.concatenate([[False], change < limit, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    rests = [(time[a + reach], time[b - 1 + reach]) for a, b in zip(edges[::2], edges[1::2],
             strict=True) if (b - a) * step >= _REST]  # fmt: skip
    between = [(float(a[1]), float(b[0])) for a, b in pairwise(rests)]
    return [m for m in between if m[1] - m[0] <= _LONGEST]


def lag_by_moves(
    positions: Sequence[tuple[Track, bool]],
    forces: Sequence[tuple[Track, bool]],
    way: Sequence[tuple[float, float]],
    lag: float,
    period: float,
) -> tuple[FloatArray, FloatArray, float] | None:
    """Line of the lag (2,), in the middle of the moves, s, and its rate; stds (2,); that middle.

    None where too few moves show it. positions, forces : with whether each is on the second clock.
    way : moves, s, of the first clock. lag : to begin with, right to a part of a rest.
    """
    found = []
    for begin, end in way[:: max(len(way) // _MOST, 1)]:
        time = np.arange(begin - _REST, end + _REST, max(0.005, 0.25 * period))
        passed = []
        for streams in (positions, forces):
            value = [track.at(time + (lag if second else 0.0)) for track, second in streams]
            if not all(known.all() for _, known in value):
                break
            passed.append(_passing(np.hstack([v for v, _ in value]), time, begin, end))
        if len(passed) == 2 and passed[0] is not None and passed[1] is not None:
            found.append((float(np.mean(passed[0])), float(np.mean(passed[1] - passed[0]))))
    if len(found) < _FEWEST:
        return None
    time, late = np.array(found).T
    # Forces on the second clock pass late where it is ahead; positions, early.
    sign = 1.0 if any(second for _, second in forces) else -1.0
    return _line(time, lag + sign * late, _LEAST * period)


def _passing(value: FloatArray, time: FloatArray, begin: float, end: float) -> FloatArray | None:
    """Times at which streams (N, C) pass the levels on their way; None where it is unclear."""
    before, after = time < begin - _EDGE, time > end + _EDGE
    low, high = value[before].mean(axis=0), value[after].mean(axis=0)
    size = float((high - low) @ (high - low))
    if size == 0.0:
        return None
    share = (value - low) @ (high - low) / size
    if max(np.std(share[before]), np.std(share[after])) * _CLEAR > 1.0:
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


def _line(time: FloatArray, lag: FloatArray, least: float) -> tuple[FloatArray, FloatArray, float]:
    """Line of lags (M,), s, of moves at times (M,), s; least : s, what they tell at best."""
    middle = 0.5 * float(time[0] + time[-1])
    away = time - middle
    i, j = np.triu_indices(len(time), 1)
    rate = float(np.median((lag[j] - lag[i]) / (time[j] - time[i])))
    left = lag - rate * away
    offset = float(np.median(left))
    spread = _MEDIAN * 1.4826 * float(np.median(np.abs(left - offset)))
    std = float(np.hypot(spread / np.sqrt(len(time)), least))
    rate_std = float(np.hypot(spread / np.linalg.norm(away - away.mean()), least / np.ptp(time)))
    return np.array([offset, rate]), np.array([std, rate_std]), middle
