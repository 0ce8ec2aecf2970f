"""Are the forces what their fields are called? Judged at the mounting that fits them best.

A mounting that nobody stated is for the estimator to find; a unit, a sign, exchanged sensors or
axes, a tare on the way are not. So the forces are held against the weight where they fit best, and
against what they would be without one mistake where they fit nowhere.
"""

from __future__ import annotations

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.errors import DataError
from tdfscal.findings import Finding
from tdfscal.model.parameters import nominal
from tdfscal.model.statics import Postures
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.selfcal.covariance import estimate
from tdfscal.selfcal.estimator import Fit, spread
from tdfscal.selfcal.misreadings import Misreading, likeliest_misreading, refusal
from tdfscal.selfcal.slip import find_slip

#: Variance of the residuals, in units of the one stated, above which no mounting explains them.
_LOST = 100.0


def check_forces(
    rig: Rig,
    observed: Postures,
    start: Fit,
    number: IntArray | None = None,
    time: FloatArray | None = None,
) -> None:
    """Raise where units, signs or names of the forces cannot be right at any mounting.

    Parameters
    ----------
    start : the best that can be made of the forces as they are named.
    number, time : (K,), by which the postures go, and s, when each was held, where they are rests.

    Raises
    ------
    DataError
        Forces and weight differ, or one mistake explains what the readings as they are do not.
    """
    strongest = np.linalg.norm(observed.force - rig.zero.value, axis=2).sum(axis=1)
    weak = bool(np.median(strongest) < _weakest(rig))
    held = log_against_rig.weight_share(nominal(rig), rig.gravity, observed.force)
    if weak and log_against_rig.unit_of(float(np.median(held))):
        log_against_rig.check_weight(rig, observed, nominal(rig))
    if spread(start.distance, start.at.rows) > _LOST:
        check_readings(rig, observed, start, number, time)
        log_against_rig.check_weight(rig, observed, nominal(rig))
    if start.state.mass <= 0:
        raise _mirrored(rig, start)
    log_against_rig.check_weight(rig, observed, start.state)


def _mirrored(rig: Rig, start: Fit) -> DataError:
    """The error for forces that hold up a negative mass: an odd number of axes is of opposite sign.

    Which one is a matter of quarter turns: the one whose sensors are turned least is named.
    """
    back = np.swapaxes(nominal(rig).rotation, 1, 2)
    turn = {
        f"F{axis}": float(np.linalg.norm(so3.log(-start.state.rotation @ M @ back), axis=1).max())
        for axis, M in zip("xyz", np.eye(3) - 2 * np.eye(3)[:, :, None] * np.eye(3), strict=True)
    }
    axis = min(turn, key=turn.__getitem__)
    mass = float(start.state.mass)
    return DataError(Finding("forces-mirrored", size=mass, unit="kg", values={"axis": axis}))


def _weakest(rig: Rig) -> float:
    """Sum of the forces' lengths, N, below which no mounting makes them carry the weight."""
    mass, std = float(rig.mass.value), float(rig.mass.std)
    return mass * rig.gravity * (1 - log_against_rig.weight_tolerance(std / mass))


def check_readings(
    rig: Rig,
    observed: Postures,
    present: Fit,
    number: IntArray | None = None,
    time: FloatArray | None = None,
) -> None:
    """Raise DataError where one mistake in the readings explains the postures.

    Several may, each with sensors that are turned by quarters: the least turned is the likely one.
    Parameters as in `check_forces`.
    """
    if (found := misreading(rig, observed, present, number, time)) is not None:
        raise misread(rig, found, present, number, time)


def misreading(
    rig: Rig,
    observed: Postures,
    present: Fit,
    number: IntArray | None = None,
    time: FloatArray | None = None,
) -> Misreading | None:
    """The one mistake that explains the postures, which a sensor that turned does not.

    present : the best that can be made of them as they are. number, time as in `check_forces`.
    """
    found = likeliest_misreading(rig, observed, present, None if number is None else time)
    if found is None or found.jump is None or found.tared:
        return found
    assert number is not None  # without them no jump is looked for
    assert time is not None
    step = find_slip(estimate(present), time, number)
    # A sensor that turned is for the gate to say.
    return None if step is not None and step.kind == "slip" else found


def misread(
    rig: Rig,
    found: Misreading,
    present: Fit,
    number: IntArray | None = None,
    time: FloatArray | None = None,
) -> DataError:
    """The error that names a mistake with its evidence; parameters as in `misreading`."""
    if found.names == log_against_rig.REACTION.format(log_against_rig.EVERYONE):
        allowed = log_against_rig.weight_tolerance(0.0)
        return log_against_rig.weight_error(-1.0, allowed, float(rig.mass.value))
    number = np.arange(len(present.postures)) + 1 if number is None else number
    return refusal(rig, found, spread(present.distance, present.at.rows), number, time)
