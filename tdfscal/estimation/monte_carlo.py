"""Monte Carlo of the angles (JCGM 101); how rotations are drawn is each kind's own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tdfscal.estimation.uncertainty import Uncertainty
from tdfscal.numerics import so3
from tdfscal.numerics.distributions import MonteCarlo, propagate
from tdfscal.records import BoolArray, FloatArray
from tdfscal.significance import INTERVAL_COVERAGE


def simulate_angles(
    draw: Callable[[int], FloatArray],
    rotation: FloatArray,
    linear: Uncertainty,
    known: BoolArray,
    max_trials: int,
    *,
    chunk: int,
) -> MonteCarlo:
    """Draw until the averages are stable or the trials run out.

    draw : rotations (T, n, 3, 3) of T trials, at most `chunk` of them, about the estimate
    `rotation` (n, 3, 3). known : (n,), sensors whose angles the data determine; those of the
    others are not followed.
    """
    followed = known[:, None].astype(np.float64)

    def angles(size: int) -> FloatArray:
        drawn = [draw(min(chunk, size - start)) for start in range(0, size, chunk)]
        return np.concatenate([followed * so3.deviations(each, rotation) for each in drawn])

    found = propagate(angles, linear.rpy_std, INTERVAL_COVERAGE, max_trials)
    half = followed * linear.coverage_factor * linear.rpy_std
    return found.about(so3.to_rpy(rotation), half)
