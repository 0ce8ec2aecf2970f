"""Where the estimate in motion starts: the mounting, from instants taken as if at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tdfscal.findings import Finding
from tdfscal.model.parameters import State, starting_state
from tdfscal.model.postures import Postures, alike
from tdfscal.motioncal.estimator import MovingFit
from tdfscal.motioncal.streams import Slow
from tdfscal.numerics.distributions import normal_quantile
from tdfscal.records import BoolArray, Rig
from tdfscal.selfcal.estimator import fit as quasi_static
from tdfscal.selfcal.misreadings import check_forces
from tdfscal.selfcal.mounting_search import APART, apart, best_start, describe
from tdfscal.significance import AMBIGUOUS_MOUNTING

#: Instants at most that the quasi-static start is estimated from, and their noise, N and m.
_START_ROWS, _START_FORCE, _START_PLACE = 400, 1.0, 1.0e-5
#: A mounting farther than this from the nominal one was not meant by it, rad.
_MOUNTED_WITHIN = 0.3


def first_fit(
    rig: Rig, seen: Postures, fitted: Callable[[State], MovingFit]
) -> tuple[MovingFit, tuple[Finding, ...]]:
    """Fit from the nominal mounting, and from the one that explains the forces best.

    Where the two are mountings apart the likelier one stands. A motion that hardly tilts shows
    forces and their reverse alike (half a turn of every sensor): then the nominal mounting
    decides, and it is said.

    Raises DataError where units, signs or names of the forces cannot be right.
    """
    begin = starting_state(rig)
    near, best = quasi_static(rig, seen, begin), best_start(rig, seen)
    check_forces(rig, best.postures, best)
    if apart(near.state.rotation, best.state.rotation) <= APART:
        # Without some axes a turn may hardly show at rest, and where that start leads is far off.
        first = fitted(best.state if rig.axes.all() else begin)
        return first if first.converged or rig.axes.all() else fitted(best.state), ()
    far = fitted(best.state)
    if apart(near.state.rotation, begin.rotation) > APART + _MOUNTED_WITHIN:
        return far, ()
    close = fitted(near.state)
    if apart(close.state.still.rotation, far.state.still.rotation) <= APART:
        return close, ()
    # Both by the spectrum of the better one, which the other can only have raised.
    scale = min(close, far, key=lambda f: float(f.noise.variance(f.data.bins).sum())).noise
    gap = replace(close, noise=scale).cost - replace(far, noise=scale).cost
    if gap > float(normal_quantile(1 - AMBIGUOUS_MOUNTING)) ** 2:
        return far, ()
    other = describe(rig, close.state.still, far.state.still)
    return close, (Finding("mounting-ambiguous", values={"other": other}),)


def moments(rig: Rig, slow: Slow, keep: BoolArray) -> Postures:
    """Instants of the motion as if they were postures: for a start, and for the loads' course."""
    rows = np.flatnonzero(keep)
    rows = rows[:: max(1, int(np.ceil(len(rows) / _START_ROWS)))]
    force = np.where(rig.axes, slow.force[rows], 0.0)
    return alike(slow.position[rows], force, rig.axes, place=_START_PLACE, noise=_START_FORCE)
