"""Several campaigns of one rig as one estimate: common constants, zeros of each its own.

Each campaign is fitted with what the others know, so that one which determines nothing alone takes
part; then all are reduced to their information about one common reference, filtered in the order
of time, and each is held against the rest before anything is pooled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tdfscal.comparison.common import (
    Common,
    Walk,
    common,
    others_move,
    scores_of_estimate,
    scores_of_fit,
    scores_of_survey,
    sources_together,
    with_load,
)
from tdfscal.comparison.misfit import Misfit, not_fitting, scatter_of, within
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import (
    Observation,
    eliminate,
    of_estimate,
    of_survey,
    stated,
    unstated,
)
from tdfscal.findings import Finding
from tdfscal.frozen import field, record, replace
from tdfscal.model.calibrated import Calibrated, free_constants, joint_prior, loosened, turned
from tdfscal.model.parameters import (
    CONSTANTS,
    State,
    nominal,
    placed,
    prior_std,
    retract,
    with_motions,
)
from tdfscal.model.statics import Postures
from tdfscal.numerics.information import Information
from tdfscal.records import ExactMoves, FloatArray, IntArray, JointPrior, Rig, Rotations
from tdfscal.selfcal.estimator import Fit, at_state
from tdfscal.selfcal.outliers import fit_robust
from tdfscal.significance import POOL_SHARE, alarm_level

#: Largest step of the common constants, in standard uncertainties, that needs no further round.
_SETTLED = 1e-6
_ROUNDS = 8


@record
class Recorded:
    """A campaign to be pooled: its rig file and its static postures, or what it came to by itself.

    estimate : of a log in motion, by what its rig file states. survey : of a tracker.
    exact : how either moves with errors of what it took as exact. contributions : variances (n, 3)
    of roll, pitch, yaw by source, as it knows them alone; empty where it does not.
    month : when it was measured, in months of 30.4375 days from any common instant.
    """

    name: str
    month: float
    rig: Rig
    postures: Postures | None = None
    estimate: Calibrated | None = None
    survey: Rotations | None = None
    exact: tuple[ExactMoves, ...] = ()
    contributions: Mapping[str, FloatArray] = field(default_factory=dict)


@record
class Member:
    """A campaign within the pool.

    reduced : what it says by itself. fit : at the common constants; None where it has no postures.
    state : its own parameters at the common constants; None for a survey.
    chi2, dof : of its residuals and of its departure from those before it. exact : scores (C,) of
    what it says, by errors of what it takes as exact.
    """

    recorded: Recorded
    reduced: Observation
    fit: Fit | None
    state: State | None
    rejected: dict[int, Finding]
    chi2: float
    dof: int
    exact: tuple[ExactMoves, ...]

    @property
    def name(self) -> str:
        """Its name."""
        return self.recorded.name

    @property
    def month(self) -> float:
        """When it was measured."""
        return self.recorded.month

    @property
    def own(self) -> Information:
        """What it says of the constants by itself."""
        return self.reduced.information


@record
class Pool:
    """Campaigns in the order of time about a common reference of what they have in common.

    references : per campaign, constants alike, and its own terminal.
    walk : what each says of the common parameters (C,), and what the rig files state, counted once.
    """

    common: Common
    references: list[State]
    walk: Walk
    members: tuple[Member, ...]
    misfits: tuple[Misfit, ...]

    @property
    def reference(self) -> State:
        """The last campaign's."""
        return self.references[-1]

    def others(self, rig: Rig, index: int) -> JointPrior:
        """What all other campaigns know of the constants at the time of one."""
        chosen = [m for k, m in enumerate(self.members) if k != index]
        chi2, dof = sum(m.chi2 for m in chosen), sum(m.dof for m in chosen)
        known = self.common.of(index, self.walk.others()[index])
        at = self.common.places[index]
        moved = others_move(self.common, index, [m.exact for m in self.members], self.walk)
        here = [one.by(np.eye(self.common.size)[at]) for one in moved]
        prior = joint_prior(rig, self.references[index], known, chi2, dof, exact=here)
        return replace(prior, sources=sources_together([m.recorded.contributions for m in chosen]))

    def posterior(self, index: int) -> Information:
        """What all campaigns together say of the constants at the time of one."""
        return self.walk.others()[index] + self.members[index].own

    def own_state(self, rig: Rig, index: int) -> tuple[State, State]:
        """What one campaign's own parameters are, and their standard uncertainties, ∞ unknown."""
        member = self.members[index]
        if member.state is None:
            state, std = nominal(rig), prior_std(rig)
        else:
            state, part = member.state, member.reduced
            C = self.posterior(index).covariance
            variance = np.diagonal(part.spread) + np.einsum("oc,cd,od->o", part.give, C, part.give)
            std = np.zeros(len(part.places))
            std[part.places] = np.where(part.open, np.inf, np.sqrt(variance))
            free = np.flatnonzero(free_constants(rig))
            std[free] = np.sqrt(np.diagonal(C)[self.common.places[index]])
        return state, placed(state, std)


def pool(campaigns: Sequence[Recorded]) -> Pool:
    """Pool campaigns whose rig files state the same constants, the latest rig's walk between them.

    Parameters
    ----------
    campaigns : two or more, one of them at least with postures or in motion.

    Returns
    -------
    Pool : with the campaigns that do not fit the others named; whether to pool them all the same
        is the caller's to say.

    References
    ----------
    Theory, section 9.
    """
    ordered = sorted(campaigns, key=lambda item: item.month)
    rig, months = ordered[-1].rig, [item.month for item in ordered]
    gaps = np.maximum(np.diff(months, prepend=months[0]), 0.0)
    shared = common([item.rig for item in ordered])
    steps = [turned(rig, rig.drift.angle * float(np.sqrt(gap)), shared.size) for gap in gaps]
    fits, rejected, references = _first_round(ordered, shared)
    settled = False
    for rounds in range(_ROUNDS + 1):
        reduced = _reduced(ordered, fits, references, shared)
        walk = Walk([part.information for part in reduced], shared.stated(references), steps)
        if settled or rounds == _ROUNDS:
            break
        posterior = walk.others()[-1] + walk.own[-1]
        move = posterior.mean
        fits = [
            None if at is None else _moved(item, at, part, reference, shared.step(k, move), move)
            for k, (item, at, part, reference) in enumerate(
                zip(ordered, fits, reduced, references, strict=True)
            )
        ]
        references = shared.moved(references, move)
        settled = bool(np.all(np.abs(move) < _SETTLED * np.sqrt(np.diag(posterior.covariance))))
    members = []
    for k, (item, known) in enumerate(zip(ordered, walk.before(), strict=True)):
        # Constants of which nothing was stated are determined by the first campaign that has them.
        dof = reduced[k].rows
        if shared.terminal[k] == k:
            dof -= unstated(Priors(item.rig), load_alone=k > 0)
        members.append(
            Member(
                recorded=item,
                reduced=reduced[k],
                fit=fits[k],
                state=_own_state(item, fits[k], reduced[k], references[k]),
                rejected=rejected[k],
                chi2=_fresh(known, reduced[k]),
                dof=dof,
                exact=_exact(item, fits[k], reduced[k], shared.places[k]),
            )
        )
    birge = scatter_of([within(part, walk.prior) for part in reduced])
    own = [item.scaled(ratio) for item, ratio in zip(walk.own, birge, strict=True)]
    names = [item.name for item in ordered]
    level = POOL_SHARE * alarm_level(np.append(gaps[1:2], gaps[1:]))
    scaled = Walk(own, walk.prior.scaled(birge.min()), steps)
    found = not_fitting(shared, names, scaled, level)
    return Pool(shared, references, walk, tuple(members), found)


def _exact(
    item: Recorded, at: Fit | None, part: Observation, places: IntArray
) -> tuple[ExactMoves, ...]:
    """Scores (C,) of what a campaign says, by errors of what it takes as exact."""
    size = len(part.information.score)
    if at is not None:
        return scores_of_fit(at, part, places)
    if item.estimate is not None:
        return scores_of_estimate(item.estimate, item.exact, size, places)
    assert item.survey is not None
    return scores_of_survey(item.survey, item.exact, size)


def _fresh(known: Information, part: Observation) -> float:
    """χ² that a campaign adds to those before it."""
    both = known + part.information
    return max(0.0, float(known.mean @ known.score + part.chi2 - both.mean @ both.score))


def _first_round(
    ordered: Sequence[Recorded], shared: Common
) -> tuple[list[Fit | None], list[dict[int, Finding]], list[State]]:
    """Fit each campaign with what those with more postures know; outliers are left out here.

    Returned with the references: constants of a motion or of the most postures, loads as stated.
    """
    fits: list[Fit | None] = [None] * len(ordered)
    rejected: list[dict[int, Finding]] = [{} for _ in ordered]
    sizes = [0 if item.postures is None else len(item.postures) for item in ordered]
    known: Information | None = None
    references: list[State] = []

    def begin(state: State) -> Information:
        references.extend(with_load(state, nominal(item.rig)) for item in ordered)
        return shared.stated(references)

    for k, item in enumerate(ordered):
        if item.estimate is not None:
            known = begin(item.estimate.state) if known is None else known
            part = _observed(item, None, references[k])
            known = known + shared.embedded(k, part.information)
    for k in np.argsort(sizes)[::-1]:
        item = ordered[k]
        if item.postures is None:
            continue
        rig = item.rig
        if known is not None:
            own = shared.of(k, known)
            rig = replace(rig, earlier=joint_prior(rig, references[k], own))
        robust = fit_robust(loosened(rig), item.postures)
        result, rejected[k] = robust.fit, robust.rejected
        fits[k] = result
        known = begin(with_motions(result.state, 0)) if known is None else known
        known = known + shared.embedded(k, eliminate(result, references[k]).information)
    return fits, rejected, references


def _observed(item: Recorded, at: Fit | None, reference: State) -> Observation:
    """What a campaign says of its own constants (c,), counted from the reference."""
    if at is not None:
        return eliminate(at, reference)
    if item.estimate is not None:
        return of_estimate(item.estimate, stated(Priors(item.rig), reference), reference)
    assert item.survey is not None
    return of_survey(item.survey, reference, int(free_constants(item.rig).sum()))


def _reduced(
    ordered: Sequence[Recorded],
    fits: Sequence[Fit | None],
    references: Sequence[State],
    shared: Common,
) -> list[Observation]:
    """What each campaign says of the common parameters, counted from the references."""
    parts = []
    for k, (item, at, reference) in enumerate(zip(ordered, fits, references, strict=True)):
        part = _observed(item, at, reference)
        give = np.zeros((len(part.own), shared.size))
        give[:, shared.places[k]] = part.give
        parts.append(replace(part, information=shared.embedded(k, part.information), give=give))
    return parts


def _own_state(item: Recorded, at: Fit | None, part: Observation, reference: State) -> State | None:
    """A campaign's own parameters at the reference, whose constants it has."""
    if at is not None:
        return at.state
    if item.estimate is None:
        return None
    step = np.zeros(len(part.places))
    step[part.places] = part.own
    return retract(_with_constants(item.estimate.state, reference), step)


def _moved(
    item: Recorded,
    at: Fit,
    part: Observation,
    reference: State,
    constants: FloatArray,
    move: FloatArray,
) -> Fit:
    """The campaign's fit a step (P,) of the constants from the reference, the others at their best.

    move : (C,), the same step of all that the campaigns have in common.
    """
    state = _with_constants(at.state, reference)
    step = np.pad(constants, (0, len(at.active) - len(constants)))
    step[part.places] = part.own + part.give @ move
    return at_state(item.rig, at.postures, retract(state, step), at.weight)


def _with_constants(state: State, reference: State) -> State:
    return replace(state, **{group: getattr(reference, group) for group in CONSTANTS})
