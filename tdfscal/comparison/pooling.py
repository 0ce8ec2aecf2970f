"""Several campaigns of one rig as one estimate: common constants, zeros and load of each its own.

Each campaign is fitted with what the others know, so that one which determines nothing alone takes
part; then all are reduced to their information about one common reference, filtered in the order
of time, and each is held against the rest before anything is pooled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.comparison.eliminated import (
    Eliminated,
    eliminate,
    of_estimate,
    of_survey,
    stated,
    unstated,
)
from tdfscal.comparison.misfit import Misfit, birge_of, not_fitting, within
from tdfscal.comparison.walk import forward, others
from tdfscal.model.calibrated import Calibrated
from tdfscal.model.earlier import free_constants, joint_prior, loosened, turned
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
from tdfscal.records import FloatArray, JointPrior, Rig, Rotations
from tdfscal.selfcal.estimator import Fit, Priors, at_state
from tdfscal.selfcal.outliers import fit_robust

#: Largest step of the common constants, in standard uncertainties, that needs no further round.
_SETTLED = 1e-4
_ROUNDS = 8


@dataclass(frozen=True, slots=True)
class Recorded:
    """A campaign to be pooled: its rig file and its static postures, or what it came to by itself.

    estimate : of a log in motion, by what its rig file states. survey : of a tracker.
    month : when it was measured, in months of 30.4375 days from any common instant.
    """

    name: str
    month: float
    rig: Rig
    postures: Postures | None = None
    estimate: Calibrated | None = None
    survey: Rotations | None = None


@dataclass(frozen=True, slots=True)
class Member:
    """A campaign within the pool.

    reduced : what it says by itself. fit : at the common constants; None where it has no postures.
    state : its own parameters at the common constants; None for a survey.
    chi2, dof : of its residuals and of its departure from those before it.
    """

    name: str
    month: float
    reduced: Eliminated
    fit: Fit | None
    state: State | None
    rejected: dict[int, str]
    chi2: float
    dof: int

    @property
    def own(self) -> Information:
        """What it says of the constants by itself."""
        return self.reduced.information


@dataclass(frozen=True, slots=True)
class Pool:
    """Campaigns in the order of time about a common reference of the constants.

    prior : what the rig file states of the constants, counted once.
    steps : variance (C,) of the walk before each campaign.
    """

    reference: State
    prior: Information
    steps: list[FloatArray]
    members: tuple[Member, ...]
    misfits: tuple[Misfit, ...]

    def _rest(self, index: int) -> Information:
        return others([member.own for member in self.members], self.prior, self.steps)[index]

    def others(self, rig: Rig, index: int) -> JointPrior:
        """What all other campaigns know of the constants at the time of one."""
        chosen = [m for k, m in enumerate(self.members) if k != index]
        chi2, dof = sum(m.chi2 for m in chosen), sum(m.dof for m in chosen)
        return joint_prior(rig, self.reference, self._rest(index), chi2, dof)

    def posterior(self, index: int) -> Information:
        """What all campaigns together say of the constants at the time of one."""
        return self._rest(index) + self.members[index].own

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
    steps = [turned(rig, rig.drift.angle * float(np.sqrt(gap))) for gap in gaps]
    fits, rejected = _first_round(ordered)
    reference = _known_state(rig, ordered, fits)
    rounds, settled = 0, False
    while True:
        prior = stated(Priors(rig), reference)
        reduced = _reduced(ordered, fits, reference)
        own = [part.information for part in reduced]
        if settled or rounds == _ROUNDS:
            break
        posterior = others(own, prior, steps)[-1] + own[-1]
        move = posterior.mean
        fits = [
            _moved(item, f, part, reference, move)
            for item, f, part in zip(ordered, fits, reduced, strict=True)
        ]
        reference = _stepped(rig, reference, move)
        rounds += 1
        settled = bool(np.all(np.abs(move) < _SETTLED * np.sqrt(np.diag(posterior.covariance))))
    members = []
    for k, (item, known) in enumerate(zip(ordered, forward(own, prior, steps), strict=True)):
        # Constants of which nothing was stated are determined by the first campaign.
        dof = reduced[k].rows - (0 if k else unstated(Priors(rig)))
        state = _own_state(item, fits[k], reduced[k], reference)
        chi2 = _fresh(known, reduced[k])
        members.append(
            Member(item.name, item.month, reduced[k], fits[k], state, rejected[k], chi2, dof)
        )
    birge = birge_of([within(part, prior) for part in reduced])
    scaled = [item.scaled(birge) for item in own]
    names = [item.name for item in ordered]
    found = not_fitting(rig, names, scaled, prior.scaled(birge), steps)
    return Pool(reference, prior, steps, tuple(members), found)


def _fresh(known: Information, part: Eliminated) -> float:
    """χ² that a campaign adds to those before it."""
    both = known + part.information
    return max(0.0, float(known.mean @ known.score + part.chi2 - both.mean @ both.score))


def _first_round(
    ordered: Sequence[Recorded],
) -> tuple[list[Fit | None], list[dict[int, str]]]:
    """Fit each campaign with what those with more postures know; outliers are left out here."""
    fits: list[Fit | None] = [None] * len(ordered)
    rejected: list[dict[int, str]] = [{} for _ in ordered]
    sizes = [0 if item.postures is None else len(item.postures) for item in ordered]
    known: Information | None = None
    reference: State | None = None
    for item in ordered:
        if item.estimate is not None:
            reference = reference or item.estimate.state
            prior = stated(Priors(item.rig), reference)
            known = prior if known is None else known
            known = known + of_estimate(item.estimate, prior, reference).information
    for k in np.argsort(sizes)[::-1]:
        item = ordered[k]
        if item.postures is None:
            continue
        rig = item.rig
        if known is not None and reference is not None:
            rig = replace(rig, earlier=joint_prior(rig, reference, known))
        robust = fit_robust(loosened(rig), item.postures)
        result, rejected[k] = robust.fit, robust.rejected
        fits[k] = result
        if reference is None or known is None:
            reference = with_motions(result.state, 0)
            known = stated(Priors(item.rig), reference)
        known = known + eliminate(result, reference).information
    return fits, rejected


def _known_state(rig: Rig, ordered: Sequence[Recorded], fits: Sequence[Fit | None]) -> State:
    """Constants by the campaign with the most postures, or one in motion, as a first reference."""
    sizes = [0 if item.postures is None else len(item.postures) for item in ordered]
    largest = fits[int(np.argmax(sizes))]
    moving = [item.estimate.state for item in ordered if item.estimate is not None]
    state = largest.state if largest is not None else [*moving, nominal(rig)][0]
    return with_motions(state, 0)


def _reduced(
    ordered: Sequence[Recorded], fits: Sequence[Fit | None], reference: State
) -> list[Eliminated]:
    """What each campaign says of the constants, counted from the reference."""
    parts = []
    for item, at in zip(ordered, fits, strict=True):
        if at is not None:
            parts.append(eliminate(at, reference))
        elif item.estimate is not None:
            prior = stated(Priors(item.rig), reference)
            parts.append(of_estimate(item.estimate, prior, reference))
        else:
            assert item.survey is not None
            size = int(free_constants(item.rig).sum())
            parts.append(of_survey(item.survey, reference, size))
    return parts


def _own_state(item: Recorded, at: Fit | None, part: Eliminated, reference: State) -> State | None:
    """A campaign's own parameters at the reference, whose constants it has."""
    if at is not None:
        return at.state
    if item.estimate is None:
        return None
    step = np.zeros(len(part.places))
    step[part.places] = part.own
    return retract(_with_constants(item.estimate.state, reference), step)


def _moved(
    item: Recorded, at: Fit | None, part: Eliminated, reference: State, move: FloatArray
) -> Fit | None:
    """The campaign's fit at the constants reference + move, its own parameters at their best."""
    if at is None or item.postures is None:
        return None
    common = np.zeros_like(at.active)
    free = free_constants(item.rig)
    common[: len(free)] = free
    state = _with_constants(at.state, reference)
    step = np.zeros(len(common))
    step[common] = move
    step[at.active & ~common] = part.own + part.give @ move
    return at_state(item.rig, item.postures, retract(state, step), at.weight)


def _with_constants(state: State, reference: State) -> State:
    return replace(state, **{group: getattr(reference, group) for group in CONSTANTS})


def _stepped(rig: Rig, reference: State, move: FloatArray) -> State:
    free = free_constants(rig)
    step = np.zeros(len(free))
    step[free] = move
    return retract(reference, step)
