"""The one mistake in a log without which forces fit that fit nowhere as they are.

Are the forces what their fields are called? A mounting that nobody stated is for the estimator to
find; a unit, a sign, exchanged sensors or axes, a tare on the way are not. So the forces are held
against the weight where they fit best, and against what they would be without one mistake where
they fit nowhere: sensors or channels exchanged, an axis of the opposite sign, a sensor or a channel
of another unit or scale, a zero that jumped on the way. Each is undone, and of each the cost over
all mountings is searched (`misreading_search`), and the few that fall lowest are fitted in full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tdfscal.checks import log_against_rig
from tdfscal.checks.log_against_rig import REACTION
from tdfscal.errors import DataError
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.parameters import nominal, starting_state
from tdfscal.model.postures import ZeroMotion
from tdfscal.model.statics import Postures
from tdfscal.records import FloatArray, IntArray, Rig
from tdfscal.selfcal.changes import find_change
from tdfscal.selfcal.estimator import Fit, estimate, fit, spread
from tdfscal.selfcal.mounting_search import apart, robust_cost
from tdfscal.significance import CAUSES_APART

if TYPE_CHECKING:
    from tdfscal.selfcal.misreading_search import Undone

#: A mistake is believed when without it the residuals' variance is below the present one's by
#: this, and not above what is stated by as much.
BETTER = 9.0
#: Postures that are looked at, at most, evenly spread over the log.
MOST_POSTURES = 60
#: Share of a tare by which it may miss the load, at most.
_TARED = 0.1


@record
class Rests:
    """Of K postures at rest the number (K,) by which each goes, and when it was held, s (K,)."""

    number: IntArray
    time: FloatArray


@record
class Misreading:
    """A mistake in the readings, and the fit without it.

    jump : (3,), N, by which a zero jumped between the postures `between`, `tared`: to nothing.
    """

    mistake: Undone
    fit: Fit
    jump: FloatArray | None = None
    between: tuple[int, int] = (0, 0)
    tared: bool = False

    @property
    def misfit(self) -> float:
        """Variance of the residuals in units of the stated one."""
        return spread(self.fit.distance, self.fit.at.rows)

    @property
    def exact(self) -> bool:
        """Whether no number was fitted to it: an exchange, a sign, a unit."""
        unit = any(log_against_rig.unit_of(self.mistake.factor))
        return bool(self.mistake.names or (self.jump is None and unit))


def _fitted(
    rig: Rig, seen: Postures, undone: Undone, near: FloatArray, order: IntArray
) -> Misreading:
    """Fit in full from a mounting; order : (K,), the numbers of the postures."""
    postures = undone.postures
    if undone.first:
        postures = _drifting(seen, undone.support, undone.first)
    result = fit(rig, postures, replace(starting_state(rig, postures.motions), rotation=near))
    if not undone.first:
        return Misreading(undone, result)
    jump, first = result.state.drift[-1, undone.support], undone.first
    tared = _is_tare(jump, seen.force[first - 1 : first + 1, undone.support])
    return Misreading(undone, result, jump, (int(order[first - 1]), int(order[first])), tared)


def _is_tare(jump: FloatArray, read: FloatArray) -> bool:
    """A jump (3,) takes away the load of some moment between the readings (2, 3) beside it."""
    before, after = read[0], read[1] - jump
    way = after - before
    share = np.clip(-(jump + before) @ way / max(float(way @ way), np.finfo(float).tiny), 0, 1)
    left = np.linalg.norm(before + share * way + jump)
    return bool(left < _TARED * np.linalg.norm(jump))


def _likeliest(found: list[Misreading]) -> Misreading:
    """The likeliest; among those about as likely the one with the sensors least turned.

    A mirrored axis and two that are exchanged differ by a quarter turn alone.
    """
    scale = min(mistake.misfit for mistake in found)
    cost = [robust_cost(mistake.fit, scale) for mistake in found]
    near = [m for m, own in zip(found, cost, strict=True) if own < min(cost) + CAUSES_APART]
    start = nominal(found[0].fit.rig).rotation
    return min(near, key=lambda mistake: float(apart(mistake.fit.state.rotation, start)))


def _drifting(seen: Postures, sensor: int, first: int) -> Postures:
    """Postures with a zero whose step at one of them is a parameter."""
    step = np.zeros((*seen.force.shape[:2], 1))
    step[first:, sensor] = 1.0
    wide = 10.0 * float(np.median(np.linalg.norm(seen.force, axis=2)))
    motion = ZeroMotion(("step",), step, np.array([wide]))
    if (own := seen.motion) is not None:
        motion = replace(
            own,
            kind=(*own.kind, "step"),
            value=np.concatenate([own.value, step], axis=2),
            std=np.append(own.std, wide),
        )
    return replace(seen, motion=motion)


#: Variance of the residuals, in units of the one stated, above which no mounting explains them.
_LOST = 100.0


def check_forces(rig: Rig, observed: Postures, start: Fit, rests: Rests | None = None) -> None:
    """Raise where units, signs or names of the forces cannot be right at any mounting.

    Parameters
    ----------
    start : the best that can be made of the forces as they are named.
    rests : what the postures are; none of a motion.

    Raises
    ------
    DataError
        Forces and weight differ, or one mistake explains what the readings as they are do not.
    """
    strongest = np.linalg.norm(observed.force - rig.zero.value, axis=2).sum(axis=1)
    weak = bool(np.median(strongest) < _weakest(rig))
    held = log_against_rig.weight_share(nominal(rig), rig.gravity, observed.force)
    if weak and any(log_against_rig.unit_of(float(np.median(held)))):
        log_against_rig.check_weight(rig, observed, nominal(rig))
    if spread(start.distance, start.at.rows) > _LOST:
        check_readings(rig, observed, start, rests)
        log_against_rig.check_weight(rig, observed, nominal(rig))
    if start.state.mass <= 0:
        raise _mirrored(rig, start)
    log_against_rig.check_weight(rig, observed, start.state)


def _mirrored(rig: Rig, start: Fit) -> DataError:
    """The error for forces that hold up a negative mass: an odd number of axes is of opposite sign.

    Which one is a matter of quarter turns: the one whose sensors are turned least is named.
    """
    turn = {
        f"F{axis}": float(apart(-start.state.rotation @ M, nominal(rig).rotation))
        for axis, M in zip("xyz", np.eye(3) - 2 * np.eye(3)[:, :, None] * np.eye(3), strict=True)
    }
    axis = min(turn, key=turn.__getitem__)
    mass = float(start.state.mass)
    return DataError(Finding("forces-mirrored", size=mass, unit="kg", values={"axis": axis}))


def _weakest(rig: Rig) -> float:
    """Sum of the forces' lengths, N, below which no mounting makes them carry the weight."""
    mass, std = float(rig.mass.value), float(rig.mass.std)
    return mass * rig.gravity * (1 - log_against_rig.weight_tolerance(std / mass))


def check_readings(rig: Rig, observed: Postures, present: Fit, rests: Rests | None = None) -> None:
    """Raise DataError where one mistake in the readings explains the postures.

    Several may, each with sensors that are turned by quarters: the least turned is the likely one.
    Parameters as in `check_forces`.
    """
    if (found := misreading(rig, observed, present, rests)) is not None:
        raise misread(rig, found, present, rests)


def misreading(
    rig: Rig, observed: Postures, present: Fit, rests: Rests | None = None
) -> Misreading | None:
    """The one mistake that explains the postures, which a sensor that turned does not.

    present : the best that can be made of them as they are. rests : as in `check_forces`; without
    them no jump is looked for.
    """
    from tdfscal.selfcal.misreading_search import lowest  # of misread logs alone

    order = np.arange(len(observed)) if rests is None else np.argsort(rests.time, kind="stable")
    some = np.unique(np.linspace(0, len(order) - 1, MOST_POSTURES).round().astype(np.int64))
    seen, misfit = observed.subset(order[some]), spread(present.distance, present.at.rows)
    if misfit < BETTER:
        return None
    starts = np.stack([nominal(rig).rotation, present.state.rotation])
    tried = [
        _fitted(rig, seen, each, rotation, order[some])
        for each, rotation in lowest(rig, seen, starts, timed=rests is not None)
    ]
    better = [m for m in tried if BETTER * m.misfit < misfit and m.misfit < BETTER]
    if not better:
        return None
    found = _likeliest(better)
    if rests is None or found.jump is None or found.tared:
        return found
    step = find_change(estimate(present), rests.time, rests.number)
    # A sensor that turned is for the gate to say.
    return None if step is not None and step.kind == "slip" else found


def misread(
    rig: Rig,
    found: Misreading,
    present: Fit,
    rests: Rests | None = None,
    *,
    check: bool = False,
) -> DataError:
    """The error that names a mistake with its evidence; parameters as in `misreading`.

    check : the postures are those of a check, which has no zeros to calibrate.
    """
    mistake = found.mistake
    if mistake.names == REACTION:
        allowed = log_against_rig.weight_tolerance(0.0)
        return log_against_rig.weight_error(-1.0, allowed, float(rig.mass.value))
    values: dict[str, Value] = {
        "before": float(np.sqrt(spread(present.distance, present.at.rows))),
        "after": float(np.sqrt(found.misfit)),
    }
    if mistake.names:
        values |= {"exchange": mistake.names, **mistake.signs}
        return DataError(Finding("forces-exchanged", values=values))
    subject = (rig.supports[mistake.support],)
    if rests is None or found.jump is None:
        axis = "" if mistake.axis is None else "xyz"[mistake.axis]
        unit, declared = log_against_rig.unit_of(mistake.factor)
        values |= {"axis": axis, "unit": unit, "declared": declared}
        return DataError(Finding("force-rescaled", subject, mistake.factor, values=values))
    last, first = found.between
    values |= {
        "jump": [f"{value:.3g}" for value in found.jump],
        "first": float(rests.number[first]),
        "tared": found.tared,
        "check": check,
    }
    if not np.array_equal(rests.time, rests.number - 1):  # a row that is a posture has no other
        values |= {"between": rests.time[[last, first]].tolist(), "cut": float(rests.time[first])}
    size = float(np.linalg.norm(found.jump))
    return DataError(Finding("zero-tared", subject, size, "N", values=values))
