"""What goes into a pool, by what it says of the rig's constants: campaigns and calibrations.

A campaign at rest says it by its postures, one in motion and a survey by what they came to; a
calibration that stands on an earlier one in the pool only by what its own data added.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tdfscal.estimation.exact_quantities import exact_rows
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import (
    Observation,
    eliminate,
    of_estimate,
    of_survey,
    stated,
)
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
from tdfscal.numerics import so3
from tdfscal.numerics.information import Information, inverse, without
from tdfscal.records import (
    BoolArray,
    ExactMoves,
    FloatArray,
    IntArray,
    Measured,
    Rig,
    Rotations,
)
from tdfscal.selfcal.estimator import Fit, at_state


@record(kw_only=True)
class EarlierCalibration:
    """A calibration with its full covariance, before any scaling by a Birge ratio.

    known : with that covariance. determined : (n,), sensors whose turns it gives. chi2, dof : of
    all the fits behind it. sha256 : of its file. stands_on : digest and date of the calibration
    that it updates; base : that one, where it is in the same pool. exact : how its parameters (P,)
    move with errors of what it took as exact. sources : (n, 3), share of each source in the
    variance of its roll, pitch, yaw; none where that is not told.
    """

    name: str
    known: Calibrated
    determined: BoolArray
    measured: Measured
    sha256: str
    chi2: float
    dof: int
    stands_on: tuple[str, str] | None = None
    base: EarlierCalibration | None = None
    exact: tuple[ExactMoves, ...] = ()
    sources: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def rig(self) -> Rig:
        """As it states it."""
        return self.known.rig

    @property
    def recorded(self) -> Recorded:
        """What it gives to a pool."""
        size = 3 * self.rig.n
        turns = self.known.covariance[:size, :size]
        variance = so3.rpy_variance(self.known.state.rotation, turns)
        return Recorded(
            self.name,
            self.measured.month,
            self.rig,
            estimate=self.known,
            earlier=self,
            exact=self.exact,
            contributions={name: share * variance for name, share in self.sources.items()},
        )

    def about(self, reference: State) -> Information:
        """Information (c,) on its own constants, counted from a reference."""
        matrix = constants_known(self.rig, self.known.covariance).matrix
        away = deviation(self.known.state, reference)[free_constants(self.rig)]
        return Information(matrix, matrix @ away)

    def added(self, reference: State) -> Information:
        """What its own data say (c,), counted from a reference."""
        now, before = self.about(reference), stated(Priors(self.rig), reference)
        if (base := self.base) is None:
            return now - before
        gap = max(self.measured.month - base.measured.month, 0.0)
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


@record
class Recorded:
    """A campaign to be pooled: its rig file and its static postures, or what it came to by itself.

    estimate : of a log in motion, by what its rig file states, or of a calibration: earlier.
    survey : of a tracker. exact : how these move with errors of what they took as exact.
    contributions : variances (n, 3) of roll, pitch, yaw by source, as it knows them alone; empty
    where it does not.
    month : when it was measured, in months of 30.4375 days from any common instant.
    """

    name: str
    month: float
    rig: Rig
    postures: Postures | None = None
    estimate: Calibrated | None = None
    survey: Rotations | None = None
    earlier: EarlierCalibration | None = None
    exact: tuple[ExactMoves, ...] = ()
    contributions: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def start(self) -> State | None:
        """Constants from which others may be counted; None of postures and surveys."""
        return None if self.estimate is None else self.estimate.state

    def observed(self, at: Fit | None, reference: State) -> Observation:
        """What it says of its own constants (c,), counted from the reference.

        at : its fit, where it has postures.
        """
        if at is not None:
            return eliminate(at, reference)
        if self.estimate is not None:
            part = of_estimate(self.estimate, stated(Priors(self.rig), reference), reference)
            own = part.information if self.earlier is None else self.earlier.added(reference)
            return replace(part, information=own)
        assert self.survey is not None
        return of_survey(self.survey, reference, int(free_constants(self.rig).sum()))

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
        free = free_constants(self.rig)
        if self.survey is not None:
            wide = len(self.survey.covariance)
            posterior, columns = inverse(self.survey.covariance), np.arange(wide)
            places = places[:wide]
        else:
            assert self.estimate is not None
            posterior = constants_known(self.rig, self.estimate.covariance).matrix
            wide, columns = len(free), np.flatnonzero(free)
        score = np.zeros((len(part.information.score), wide))
        score[np.ix_(places, columns)] = posterior
        return tuple(one.by(score) for one in self.exact)

    def own_state(self, at: Fit | None, part: Observation, reference: State) -> State | None:
        """Its own parameters at the reference, whose constants it has; None where it has none."""
        if at is not None:
            return at.state
        if self.estimate is None:
            return None
        step = np.zeros(len(part.places))
        step[part.places] = part.own
        return retract(with_constants(self.estimate.state, reference), step)

    def moved(
        self, at: Fit, part: Observation, reference: State, step: FloatArray, move: FloatArray
    ) -> Fit:
        """Its fit a step (P,) of the constants from the reference, the others at their best.

        move : (C,), the same step of all that the campaigns have in common.
        """
        state = with_constants(at.state, reference)
        whole = np.pad(step, (0, len(at.active) - len(step)))
        whole[part.places] = part.own + part.give @ move
        return at_state(self.rig, at.postures, retract(state, whole), at.weight)


def with_constants(state: State, reference: State) -> State:
    """The state with the constants of another one."""
    return replace(state, **{group: getattr(reference, group) for group in CONSTANTS})
