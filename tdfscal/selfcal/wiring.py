"""Are the forces what their fields are called? Judged at the mounting that fits them best.

A mounting that nobody stated is for the estimator to find; a unit, a sign, exchanged sensors or
axes are not. So the forces are held against the weight where they fit best, and against other
wirings where they fit nowhere.
"""

from __future__ import annotations

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.errors import DataError
from tdfscal.model.parameters import nominal
from tdfscal.model.statics import Postures
from tdfscal.numerics import so3
from tdfscal.records import Rig
from tdfscal.selfcal.estimator import Fit, spread
from tdfscal.selfcal.mounting_search import best_start

#: Variance of the residuals, in units of the one stated, above which no mounting explains them.
_LOST = 100.0
#: Another wiring is believed when its residuals' variance is below the present one's by this.
_BETTER = 9.0


def check_forces(rig: Rig, observed: Postures, start: Fit) -> None:
    """Raise where units, signs or names of the forces cannot be right at any mounting.

    Parameters
    ----------
    start : the best that can be made of the forces as they are named.

    Raises
    ------
    DataError
        Forces and weight differ, or another wiring explains what the stated one does not.
    """
    strongest = np.linalg.norm(observed.force - rig.zero.value, axis=2).sum(axis=1)
    if np.median(strongest) < _weakest(rig):
        log_against_rig.check_weight(rig, observed, nominal(rig))
    misfit = spread(start.distance, start.at.rows)
    if misfit > _LOST:
        _check_names(rig, observed, misfit)
        log_against_rig.check_weight(rig, observed, nominal(rig))
    log_against_rig.check_weight(rig, observed, start.state)


def _weakest(rig: Rig) -> float:
    """Sum of the forces' lengths, N, below which no mounting makes them carry the weight."""
    mass, std = float(rig.mass.value), float(rig.mass.std)
    return mass * rig.gravity * (1 - log_against_rig.weight_tolerance(std / mass))


def _check_names(rig: Rig, observed: Postures, misfit: float) -> None:
    """Raise DataError where the forces' fields, named otherwise, explain the postures.

    Several may, each with sensors that are turned by quarters: the least turned is the likely one.
    """
    back, fitting = np.swapaxes(nominal(rig).rotation, 1, 2), []
    for words, other in log_against_rig.rewired(rig, observed):
        started = best_start(rig, other, mountings=False)
        if _BETTER * spread(started.distance, started.at.rows) < misfit:
            turn = np.linalg.norm(so3.log(started.state.rotation @ back), axis=1)
            fitting.append((spread(started.distance, started.at.rows), float(turn.max()), words))
    if not fitting:
        return
    best = min(left for left, _, _ in fitting)
    words = min((turn, words) for left, turn, words in fitting if left <= _BETTER * best)[1]
    if words == log_against_rig.REACTION.format(log_against_rig.EVERYONE):
        allowed = log_against_rig.weight_tolerance(0.0)
        raise log_against_rig.weight_error(-1.0, allowed, float(rig.mass.value))
    raise DataError(
        f"the forces fit with {words}, and not as they are named",
        where="log forces",
        hint="correct the force fields of the log block in rig.yaml, or the cabling",
    )
