"""Offset and rate of two clocks from single moves, in which forces and positions pass in step.

When both pass the same levels on their way tells the lag, and how it changes from move to move the
rate (`numerics.passing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tdfscal.clocks.tracks import Track
from tdfscal.numerics.passing import line_through, times_of_passing
from tdfscal.records import FloatArray

_CLEAR = 40.0  # change / noise, from which a move shows its time
_LONGEST = 60.0  # s; a longer way from rest to rest is no single move
_REST = 0.6  # s, shortest
_EDGE = 0.2  # s next to a move, in which forces are not yet settled or the lag is not yet known
_FEWEST, _MOST = 5, 400  # moves
_SPAN = 0.1  # s, over which a change shows motion
_MOVING, _SHARE = 8.0, 5e-3  # times the noise, and share of the usual speed of the moves
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
    line = line_through(time, lag + sign * late, _LEAST * period)
    return np.array([line.value, line.rate]), np.array([line.std, line.rate_std]), line.middle


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
    return times_of_passing(share, time)
