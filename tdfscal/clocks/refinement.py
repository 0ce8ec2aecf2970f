"""Offset and rate of a clock to a small part of a sample, by the balance while forces change."""

from __future__ import annotations

import numpy as np

from tdfscal.clocks.balance import Balance, Model
from tdfscal.numerics.distributions import widening
from tdfscal.records import FloatArray

_ROUNDS = 4
_FITTED = 600  # instants for the mounting
_FEWEST, _BLOCKS = 6, 24
_SETTLED = 0.05  # of the lag's standard uncertainty
_LEAST = 0.02  # of the slowest stream's period, that no number of moves tells better


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
    some = time[:: max(len(time) // _FITTED, 1)]
    blocks = int(np.clip(rows / 6.0, _FEWEST, _BLOCKS))
    lost = rows / max(rows - balance.parameters, 0.25 * balance.parameters)
    for _ in range(_ROUNDS):
        found = balance.fit(some, line[0] + line[1] * (some - middle), model.rotation)
        model = found or model
        course = line[0] + line[1] * (time - middle)
        left, others = balance.linearised(time, course, model)
        after = balance.residual(time, course, model, h)
        slope = (balance.residual(time, course, model, -h) - after) / (2 * h)
        known = np.isfinite(left).all(axis=1) & np.isfinite(slope).all(axis=1)
        columns = np.stack([left, slope, slope * (time - middle)[:, None]], axis=2)[known]
        columns = _without(columns, others[known])
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
