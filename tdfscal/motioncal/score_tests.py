"""Does the rig file keep something from us? Score tests on the residual of a motion.

As for postures: each suspect is a set of columns that the model does not have, in the Fourier
coefficients whitened by the noise's own spectrum.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tdfscal.model.parameters import prior_std
from tdfscal.motioncal.covariance import MovingUncertainty
from tdfscal.motioncal.design import drifting, suspected
from tdfscal.motioncal.estimator import MovingFit, slope_of
from tdfscal.motioncal.rows import stacked, weights
from tdfscal.numerics.least_squares import spectrum
from tdfscal.records import FloatArray
from tdfscal.selfcal.covariance import Quality
from tdfscal.selfcal.score_tests import (
    ask,
    likeliest,
    rounded_up,
    stated_suspects,
    suspicion,
    worst_zero,
)
from tdfscal.selfcal.suspicion import OF_THE_RIG, WORDS, Suspicion
from tdfscal.significance import UNDECLARED_GRAVITY_SHARE, UNDECLARED_IN_MOTION

#: Group, support, whitened columns (rows, g), and what they are per unit.
Suspect = tuple[str, int, FloatArray, float | FloatArray]


def suspicions(
    fit: MovingFit, uncertainty: MovingUncertainty, stats: Quality
) -> tuple[Suspicion, ...]:
    """Ask for every suspect, and return the likeliest with those that are about as likely."""
    residual, jacobian = fit.whitened()
    parts, turns = spectrum(jacobian), uncertainty.turns
    suspects = [*_stated(fit), *_drifts(fit)]
    angles = np.flatnonzero(np.flatnonzero(fit.active) < 3 * fit.rig.n)
    std, worth = np.sqrt(np.diagonal(turns.covariance)), float(np.log(max(len(residual), 2)))
    others = (1 - UNDECLARED_GRAVITY_SHARE) / max(1, len(suspects) - 1)
    found = []
    for group, index, columns, unit in suspects:
        known = parts.left.T @ columns
        asked = ask(columns - parts.left @ known, columns, residual, np.zeros(columns.shape[1]))
        share = UNDECLARED_GRAVITY_SHARE if group == "tilt" else others
        if asked is None or asked.p_value(stats) > UNDECLARED_IN_MOTION * share:
            continue
        # The other parameters, angles among them, give way to the suspect's amount.
        move = -parts.root @ (known @ asked.amount)
        size = rounded_up(float(np.abs(asked.amount * unit).max()))
        what, advice = (words.format(fit.rig.supports[index], size) for words in WORDS[group])
        doubt = suspicion(fit, what, advice, asked.p_value(stats), move[angles] / std)
        zero_shift, zero = worst_zero(fit, move[: int(fit.active.sum())], turns)
        found.append(
            replace(
                doubt,
                kind=group,
                support=None if group in OF_THE_RIG else index,
                weight=asked.statistic - asked.unknowns * worth,
                zero_shift=zero_shift,
                zero=zero,
            )
        )
    return likeliest(found) if found else ()


def _white(fit: MovingFit, slope: FloatArray) -> FloatArray:
    """Columns (rows, c) of the features' slopes (q + 12, c), the priors' rows 0."""
    weight = weights(fit.rows.bins, fit.noise.variance(fit.rows.bins))
    columns = fit.rows.design @ slope
    real = stacked(columns, weight)
    return np.concatenate([real, np.zeros((len(fit.prior_residual), real.shape[1]))])


def _stated(fit: MovingFit) -> Iterator[Suspect]:
    """What the rig file states: exact values as free columns, others as a shift of the prior."""
    std = prior_std(fit.rig, drifting(fit.rig, fit.slow))
    slope = slope_of(fit.rig, fit.state, fit.origin, len(fit.psi))[:, : len(std)]
    columns = _white(fit, slope)
    columns[:, std != 0] = 0.0
    held = np.flatnonzero(np.isfinite(std) & (std > 0))
    first = len(columns) - len(fit.prior_residual)
    columns[first + np.arange(len(held)), held] = 1.0
    yield from stated_suspects(fit.rig, columns, std, fit.state.still.motions)


def _drifts(fit: MovingFit) -> Iterator[Suspect]:
    """Zeros that move with time or temperature, where the rig file declares none that move."""
    motion, n = suspected(fit.rig, fit.slow), fit.rig.n
    if motion is None:
        return
    names = ["drift" if kind == "time" else kind for kind in motion.kind]
    last = len(fit.psi) - fit.rests
    columns = _white(fit, np.eye(len(fit.psi))[:, last - 3 * n * len(names) : last])
    for name, part in zip(names, np.split(columns, len(names), axis=1), strict=True):
        for i in range(n):
            yield name, i, part[:, 3 * i : 3 * i + 3], 1.0
        yield f"all {name}", 0, part, 1.0
