"""Offset and rate of a clock to a small part of a sample, by the balance while forces change."""

from __future__ import annotations

import numpy as np

from tdfscal.clocks.balance import Balance, Model
from tdfscal.records import FloatArray

_ROUNDS = 4
_DENSE = 20_000  # instants
_FITTED = 1500  # of them for the mounting
_BLOCKS = 24
_SETTLED = 1e-5  # s
_LEAST = 0.02  # of the slowest stream's period, that no number of moves tells better


def refine(
    balance: Balance, model: Model, time: FloatArray, lag: float, rate_std: float, slowest: float
) -> tuple[FloatArray, FloatArray]:
    """Line of the lag (2,): in the middle of the instants, s, and its rate; covariance (2, 2).

    The residual changes with the lag as the arms of the forces change with time: a parameter of
    the poses (theory, section 8), whose noise is too small to weaken it. Gauss–Newton; standard
    uncertainties by blocks of equal information, as what is left is correlated in time.

    time : (N,), s, even instants. rate_std : stated. slowest : s, period of the slowest stream.
    """
    middle = 0.5 * (time[0] + time[-1])
    line, covariance = np.array([lag, 0.0]), np.zeros((2, 2))
    h = max(0.02, 0.5 * slowest)
    some = time[:: max(len(time) // _FITTED, 1)]
    for _ in range(_ROUNDS):
        found = balance.fit(some, line[0] + line[1] * (some - middle), model.rotation)
        model = found or model
        course = line[0] + line[1] * (time - middle)
        left = balance.residual(time, course, model)
        after = balance.residual(time, course, model, h)
        slope = (balance.residual(time, course, model, -h) - after) / (2 * h)
        known = np.isfinite(left).all(axis=1) & np.isfinite(slope).all(axis=1)
        away = (time - middle)[known]
        step, covariance = _step(left[known], slope[known], away, line[1], rate_std)
        line = line + step
        if abs(step[0]) < _SETTLED:
            break
    covariance[0, 0] += (_LEAST * slowest) ** 2
    return line, covariance


def _step(
    left: FloatArray, slope: FloatArray, away: FloatArray, rate: float, rate_std: float
) -> tuple[FloatArray, FloatArray]:
    """Change of lag and rate, and the covariance of both."""
    columns = np.stack([slope, slope * away[:, None]], axis=2)  # (N, 6, 2)
    gram = np.einsum("nai,naj->nij", columns, columns)
    pull = -np.einsum("nai,na->ni", columns, left)
    share = np.cumsum(gram[:, 0, 0])
    block = np.minimum((_BLOCKS * share / share[-1]).astype(int), _BLOCKS - 1)
    grams = np.stack([np.bincount(block, gram[:, i, j], _BLOCKS) for i in (0, 1) for j in (0, 1)])
    grams = grams.T.reshape(_BLOCKS, 2, 2)
    pulls = np.stack([np.bincount(block, pull[:, i], _BLOCKS) for i in (0, 1)], axis=1)
    G, p = grams.sum(axis=0), pulls.sum(axis=0)
    step = np.linalg.solve(G, p)
    scores = pulls - np.einsum("bij,j->bi", grams, step)
    inverse = np.linalg.inv(G)
    covariance = inverse @ (scores.T @ scores) @ inverse * _BLOCKS / (_BLOCKS - 2)
    # With what is stated of the rate.
    information = np.linalg.inv(covariance)
    stated = np.diag([0.0, 1.0 / max(rate_std, 1e-12) ** 2])
    covariance = np.linalg.inv(information + stated)
    step = covariance @ (information @ step + stated @ np.array([0.0, -rate]))
    return step, covariance
