"""What goes into a pool, by what it says of the rig's constants: campaigns and calibrations.

A campaign at rest says it by its postures, one in motion and a survey by what they came to; a
calibration that stands on an earlier one in the pool only by what its own data added.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Self

import numpy as np

from tdfscal.estimation.exact_quantities import exact_rows
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import Observation, eliminate, of_estimate, stated
from tdfscal.frozen import field, record, replace
from tdfscal.model.calibrated import (
    Calibrated,
    constants_known,
    free_constants,
    of_load,
    same_load,
    turned,
)
from tdfscal.model.parameters import CONSTANTS, State, deviation, retract
from tdfscal.model.statics import Postures
from tdfscal.numerics.information import Information, without
from tdfscal.records import BoolArray, ExactMoves, FloatArray, IntArray, Rig
from tdfscal.selfcal.estimator import Fit, at_state


@record(eq=False)
class Recorded:
    """A campaign to be pooled: its rig file and its static postures, or what it came to by itself.

    estimate : of a log in motion, or a survey, by what its rig file states.
    exact : how its parameters (P,) move with errors of what it took as exact.
    contributions : variances (n, 3) of roll, pitch, yaw by source, as it knows them alone; empty
    where it does not.
    month : when it was measured, in months of 30.4375 days from any common instant.
    """

    name: str
    month: float
    rig: Rig
    postures: Postures | None = None
    estimate: Calibrated | None = None
    exact: tuple[ExactMoves, ...] = ()
    contributions: Mapping[str, FloatArray] = field(default_factory=dict)

    def of_rig(self, rig: Rig) -> Self:
        """The same by another account of what its rig has in common with others."""
        own = None if self.estimate is None else replace(self.estimate, rig=rig)
        return replace(self, rig=rig, estimate=own)

    @property
    def start(self) -> State | None:
        """Constants from which others may be counted; None of postures."""
        return None if self.estimate is None else self.estimate.state

    def observed(self, at: Fit | None, reference: State) -> Observation:
        """What it says of its own constants (c,), counted from the reference.

        at : its fit, where it has postures.
        """
        if at is not None:
            return eliminate(at, reference)
        assert self.estimate is not None
        return of_estimate(self.estimate, stated(Priors(self.rig), reference), reference)

    def scores(self, at: Fit | None, part: Observation, places: IntArray) -> tuple[ExactMoves, ...]:
        """Scores (C,) of the common parameters by errors of what it takes as exact.

        part : what it says, its own parameters eliminated. places : of its constants among the
        common.
        """
        if at is not None:
            J = at.whitened()[1]
            own = part.places[at.active]
            reduced = part.give.T @ J[:, own].T
            reduced[places] += J[:, ~own].T
            return tuple(one.by(reduced) for one in exact_rows(at))
        assert self.estimate is not None
        posterior = constants_known(self.rig, self.estimate.covariance).matrix
        free = free_constants(self.rig)
        score = np.zeros((len(part.information.score), len(free)))
        score[np.ix_(places, np.flatnonzero(free))] = posterior
        return tuple(one.by(score) for one in self.exact)

    def own_state(self, at: Fit | None, part: Observation, reference: State) -> State:
        """Its own parameters at the reference, whose constants it has."""
        if at is not None:
            return at.state
        assert self.estimate is not None
        step = np.zeros(len(part.places))
        step[part.places] = part.own
        return retract(self.with_constants(self.estimate.state, reference), step)

    def with_constants(self, state: State, reference: State) -> State:
        """The state with the constants of another one."""
        shared = (*CONSTANTS, "zero") if self.rig.zeros_common else CONSTANTS
        return replace(state, **{group: getattr(reference, group) for group in shared})

    def moved(
        self, at: Fit, part: Observation, reference: State, step: FloatArray, move: FloatArray
    ) -> Fit:
        """Its fit a step (P,) of the constants from the reference, the others at their best.

        move : (C,), the same step of all that the campaigns have in common.
        """
        state = self.with_constants(at.state, reference)
        whole = np.pad(step, (0, len(at.active) - len(step)))
        whole[part.places] = part.own + part.give @ move
        return at_state(self.rig, at.postures, retract(state, whole), at.weight)


@record(kw_only=True)
class EarlierCalibration(Recorded):
    """A calibration with its full covariance, before any scaling by a Birge ratio: its estimate.

    determined : (n,), sensors whose turns it gives. chi2, dof : of all the fits behind it. base :
    the calibration that it updates, where it is in the same pool.
    """

    estimate: Calibrated
    determined: BoolArray
    chi2: float
    dof: int
    base: EarlierCalibration | None = None

    def observed(self, at: Fit | None, reference: State) -> Observation:
        """What its own data say of its constants."""
        part = super().observed(at, reference)
        return replace(part, information=self.added(reference))

    def about(self, reference: State) -> Information:
        """Information (c,) on its own constants, counted from a reference."""
        known = constants_known(self.rig, self.estimate.covariance)
        away = deviation(self.estimate.state, reference)[free_constants(self.rig)]
        return Information(known.matrix, known.matrix @ away)

    def added(self, reference: State) -> Information:
        """What its own data say (c,), counted from a reference."""
        now, before = self.about(reference), stated(Priors(self.rig), reference)
        if (base := self.base) is None:
            return now - before
        gap = max(self.month - base.month, 0.0)
        walk = self.rig.drift.angle * float(np.sqrt(gap))
        known = base.about(reference)
        stood = known.walked(turned(self.rig, walk, len(known.score)))
        if same_load(base.rig, self.rig):
            before = stood
        else:  # of the terminal its own rig file spoke
            spoken, kept = ~of_load(self.rig), ~of_load(base.rig)
            rest = stood.without(~kept)
            before.matrix[np.ix_(spoken, spoken)] = rest.matrix[np.ix_(kept, kept)]
            before.score[spoken] = rest.score[kept]
        return added_to(self.rig, now, before, self.determined & base.determined)


def added_to(rig: Rig, now: Information, before: Information, told: BoolArray) -> Information:
    """What was added to what was known before, but for turns of sensors (n,) that are not told."""
    lost = np.zeros(len(now.score), dtype=np.bool_)
    lost[: 3 * rig.n] = np.repeat(~told, 3)
    return without(now.without(lost), before.without(lost))


def first_turns(
    ordered: Sequence[Recorded], fits: Iterable[Fit | None], rotation: FloatArray
) -> FloatArray:
    """Rotations (n, 3, 3), each sensor's of the first calibration that gives it, or of a fit."""
    found, told = rotation.copy(), np.zeros(len(rotation), dtype=np.bool_)
    earlier = [item for item in ordered if isinstance(item, EarlierCalibration)]
    known = [(item.determined, item.start) for item in earlier]
    moved = [(~told, item.start) for item in ordered if item not in earlier]
    fitted = [(~told, at.state) for at in fits if at is not None]
    for sensors, state in (*known, *moved, *fitted):
        if state is not None:
            found[sensors & ~told], told = state.rotation[sensors & ~told], told | sensors
    return found
