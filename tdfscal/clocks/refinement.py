"""Offset and rate of a clock to a part of a sample: by single moves, and by the balance.

When forces and positions pass the same levels on their way from rest to rest tells the lag, and
how it changes from move to move the rate (`numerics.streams`). In motion the balance tells them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tdfscal.clocks.balance import Balance, Model
from tdfscal.clocks.tracks import Track
from tdfscal.numerics.distributions import widening
from tdfscal.numerics.streams import Line, line_through, times_of_passing
from tdfscal.records import FloatArray

_LONGEST = 60.0  # s; a longer way from rest to rest is no single move
_REST = 0.6  # s, shortest
_EDGE = 0.2  # s next to a move, in which forces are not yet settled or the lag is not yet known
_FEW_MOVES, _MOST = 5, 400  # moves
_SPAN = 0.1  # s, over which a change shows motion
_MOVING, _SHARE = 8.0, 5e-3  # times the noise, and share of the usual speed of the moves
_LEAST_OF_MOVES = 0.1  # of a period, that no number of moves tells better
_ROUNDS = 4
_FITTED = 600  # instants for the mounting
_FEWEST, _BLOCKS = 6, 24
_SETTLED = 0.05  # of the lag's standard uncertainty
_LEAST = 0.02  # of the slowest stream's period, that no balance tells better


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
    return [(float(a[1]), float(b[0])) for a, b in pairwise(rests)]


def lag_by_moves(
    positions: Sequence[tuple[Track, bool]],
    forces: Sequence[tuple[Track, bool]],
    way: Sequence[tuple[float, float]],
    lag: float,
    period: float,
) -> Line | None:
    """Line of the lag, s, through the moves that show it; None where too few do.

    positions, forces : with whether each is on the second clock.
    way : moves, s, of the first clock. lag : to begin with, right to a part of a rest.
    """
    found = []
    single = [(begin, end) for begin, end in way if end - begin <= _LONGEST]
    for begin, end in single[:: max(-(-len(single) // _MOST), 1)]:
        time = np.arange(begin - _REST, end + _REST, max(0.005, 0.25 * period))
        passed = []
        for streams in (positions, forces):
            value = [track.at(time + (lag if second else 0.0)) for track, second in streams]
            if not all(known.all() for _, known in value):
                break
            passed.append(_passing(np.hstack([v for v, _ in value]), time, begin, end))
        if len(passed) == 2 and passed[0] is not None and passed[1] is not None:
            found.append((float(np.mean(passed[0])), float(np.mean(passed[1] - passed[0]))))
    if len(found) < _FEW_MOVES:
        return None
    time, late = np.array(found).T
    # Forces on the second clock pass late where it is ahead; positions, early.
    sign = 1.0 if any(second for _, second in forces) else -1.0
    return line_through(time, lag + sign * late, _LEAST_OF_MOVES * period)


def _passing(value: FloatArray, time: FloatArray, begin: float, end: float) -> FloatArray | None:
    """Times at which streams (N, C) pass the levels on their way; None where it is unclear."""
    rests = [time < begin - _EDGE, time > end + _EDGE]
    ends = np.stack([value[rest].mean(axis=0) for rest in rests])
    return times_of_passing(value, time, ends, rests)


def refine(
    balance: Balance,
    model: Model,
    time: FloatArray,
    lag: float,
    rows: float,
    rate_std: float,
    slowest: float,
) -> tuple[FloatArray, FloatArray]:
    """Line of the lag (2,): in the middle of the instants, s, and its rate; covariance (2, 2).

    The residual changes with the lag as the arms of the forces change with time: a parameter of
    the poses (theory, section 8), whose noise is too small to weaken it. Gauss–Newton with all that
    balances eliminated; standard uncertainties by blocks of equal information, as what is left is
    correlated in time, and for the degrees of freedom that the balance has taken.

    time : (N,), s, even instants. rows : independent equations that they are. rate_std : stated.
    slowest : s, period of the slowest stream.
    """
    middle = 0.5 * (time[0] + time[-1])
    line, covariance = np.array([lag, 0.0]), np.zeros((2, 2))
    h = max(0.02, 0.5 * slowest)
    some = slice(None, None, max(len(time) // _FITTED, 1))
    blocks = int(np.clip(rows / 6.0, _FEWEST, _BLOCKS))
    lost = rows / max(rows - balance.parameters, 0.25 * balance.parameters)
    for _ in range(_ROUNDS):
        course = line[0] + line[1] * (time - middle)
        model = balance.fit([time[some]], [course[some]], model.rotation)[0] or model
        left = balance.residual(time, course, model)
        after = balance.residual(time, course, model, h)
        slope = (balance.residual(time, course, model, -h) - after) / (2 * h)
        known = np.isfinite(left).all(axis=1) & np.isfinite(slope).all(axis=1)
        columns = np.stack([left, slope, slope * (time - middle)[:, None]], axis=2)[known]
        columns = _without(columns, balance.slopes(time, course, model)[known])
        step, covariance = _step(columns, blocks, lost, line[1], rate_std)
        line = line + step
        if step[0] ** 2 < _SETTLED**2 * covariance[0, 0]:
            break
    covariance[0, 0] += (_LEAST * slowest) ** 2
    return line, covariance


def _without(columns: FloatArray, others: FloatArray) -> FloatArray:
    """What is left of columns (N, 6, c) where others (N, 6, p) may take up what they can."""
    flat, by = columns.reshape(-1, columns.shape[2]), others.reshape(-1, others.shape[2])
    gram = by.T @ by
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    ridge = 1e-10 * np.eye(len(gram))
    taken = np.linalg.solve(gram / np.outer(scale, scale) + ridge, (by.T @ flat) / scale[:, None])
    return np.asarray((flat - by @ (taken / scale[:, None])).reshape(columns.shape))


def _step(
    columns: FloatArray, blocks: int, lost: float, rate: float, rate_std: float
) -> tuple[FloatArray, FloatArray]:
    """Change of lag and rate, and the covariance of both.

    columns : (N, 6, 3), residual and its slopes. lost : variance that the balance has taken up.
    """
    gram = np.einsum("nai,naj->nij", columns, columns)
    share = np.cumsum(gram[:, 1, 1])
    block = np.minimum((blocks * share / share[-1]).astype(int), blocks - 1)
    sums = np.zeros((blocks, 3, 3))
    np.add.at(sums, block, gram)
    G, pulls = sums[:, 1:, 1:], -sums[:, 1:, 0]
    inverse = np.linalg.inv(G.sum(axis=0))
    step = inverse @ pulls.sum(axis=0)
    scores = pulls - G @ step
    lost *= widening(blocks - 2) ** 2
    covariance = lost * inverse @ (scores.T @ scores) @ inverse
    # With what is stated of the rate.
    information = np.linalg.inv(covariance)
    stated = np.diag([0.0, 1.0 / max(rate_std, 1e-12) ** 2])
    covariance = np.linalg.inv(information + stated)
    step = covariance @ (information @ step + stated @ np.array([0.0, -rate]))
    return step, covariance
