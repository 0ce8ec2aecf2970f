"""From a rig and its limits to the postures to drive, and the uncertainty to expect of them."""

from __future__ import annotations

import numpy as np

from tdfscal.errors import NotIdentifiableError, UsageError
from tdfscal.planning.choice import Planner
from tdfscal.planning.plan import Plan, Request
from tdfscal.records import Rig
from tdfscal.selfcal.estimator import Fit

#: Most postures that a target may ask for.
MOST = 400


def make_plan(
    rig: Rig,
    request: Request,
    postures: int,
    rng: np.random.Generator,
    *,
    given: Fit | None = None,
) -> Plan:
    """Choose postures and squeezes: exchange over a random pool, then moved freely.

    postures : how many rows to drive, returns included. given : the fit of postures recorded
    already; the plan adds the best next ones.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : the objective stays unobservable.
    """
    return Planner(rig, request, rng, given).plan(postures)


def plan_for_target(
    rig: Rig,
    request: Request,
    target: float,
    rng: np.random.Generator,
    *,
    given: Fit | None = None,
) -> Plan:
    """Plan with the fewest postures whose every angle is expected within `target`, rad.

    Raises
    ------
    UsageError : infeasible limits. NotIdentifiableError : no number of postures gets there.
    """
    if not 0.0 < target < np.inf:
        raise UsageError(f"the target is {target:g} rad", hint="give a number above zero")
    planner = Planner(rig, request, rng, given)
    floor = planner.scaled(MOST)
    if floor > target:
        raise NotIdentifiableError(
            f"{MOST} postures leave about ±{1e3 * floor:.3g} mrad on the weakest angle, and "
            f"{1e3 * target:.3g} mrad is asked for",
            hint="squeeze harder, average longer, or know zeros, mass and barycentre better",
        )
    # The search goes by the pool alone, which is quick; free postures do better by some share.
    count = _fewest(planner, target)
    plan = planner.plan(count)
    share = plan.expected.largest / planner.largest(count)
    fewer = _fewest(planner, target / min(1.0, share))
    while fewer < count:
        better = planner.plan(fewer)
        if better.expected.largest <= target:
            return better
        fewer += 1
    return plan


def _fewest(planner: Planner, target: float) -> int:
    """Fewest postures within the target: a guess by scaling, a bracket about it, bisection."""
    guess = next(count for count in range(1, MOST + 1) if planner.scaled(count) <= target)
    step = max(1, guess // 16)
    low, high = guess - 1, guess
    while planner.largest(high) > target:
        low, high = high, high + step
    while low > 0 and planner.largest(low) <= target:
        low, high = max(0, low - step), low
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if planner.largest(middle) <= target else (middle, high)
    return high
