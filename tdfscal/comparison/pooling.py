"""Several campaigns of one rig as one estimate: common constants, zeros of each its own.

Each campaign is fitted with what the others know, so that one which determines nothing alone takes
part; then all are reduced to their information about one common reference, filtered in the order
of time. Whether they are of one state is the history's to say.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from tdfscal.comparison.common import (
    Common,
    Walk,
    common,
    others_move,
    sources_together,
)
from tdfscal.comparison.members import EarlierCalibration, Recorded
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import Observation, unstated
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import free_constants, joint_prior, loosened, turned
from tdfscal.model.parameters import State, nominal, placed, retract, with_motions
from tdfscal.numerics import so3
from tdfscal.numerics.information import Contrast, Information, contrast
from tdfscal.records import ExactMoves, FloatArray, JointPrior, Rig
from tdfscal.selfcal.estimator import Fit
from tdfscal.selfcal.outliers import fit_robust

#: Largest step of the common constants, in standard uncertainties, that needs no further round.
_SETTLED = 1e-6
_ROUNDS = 8


@record
class Member:
    """A campaign within the pool.

    reduced : what it says by itself. fit : at the common constants; None where it has no postures.
    state : its own parameters at the common constants.
    chi2, dof : of its residuals and of its departure from those before it. exact : scores (C,) of
    what it says, by errors of what it takes as exact.
    """

    recorded: Recorded
    reduced: Observation
    fit: Fit | None
    state: State
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

    def within(self, prior: Information) -> tuple[float, int]:
        """χ² and degrees of freedom with the constants at its own best.

        prior : what is stated of the constants, beside which it says something of them. None of a
        calibration that stands on another one, whose χ² is in its own.
        """
        if isinstance(earlier := self.recorded, EarlierCalibration):
            return (earlier.chi2, earlier.dof) if earlier.base is None else (0.0, 0)
        part = self.reduced
        told = part.information.beside(prior)
        explained, rank = Contrast(told.matrix, told.score).chi2()
        return max(0.0, part.chi2 - explained), max(0, part.rows - rank)


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
        sources = sources_together([m.recorded.contributions for m in chosen])
        return replace(prior, sources=self._with_walk(sources, index))

    def _with_walk(self, sources: dict[str, FloatArray], index: int) -> dict[str, FloatArray]:
        """Shares of the sources beside that of the walk until one campaign."""
        if not sources or not np.any(self.walk.steps):
            return sources
        R, still = self.reference.rotation, [np.zeros_like(step) for step in self.walk.steps]
        walks = (replace(self.walk, steps=still), self.walk)
        left, whole = (
            so3.rpy_variance(R, walk.others()[index].covariance[: 3 * len(R), : 3 * len(R)])
            for walk in walks
        )
        share = left / whole
        return {name: share * own for name, own in sources.items()} | {"walk": 1.0 - share}

    def index(self, recorded: Recorded) -> int:
        """Place of a campaign in the order of time."""
        return next(k for k, m in enumerate(self.members) if m.recorded is recorded)

    def posterior(self, index: int) -> Information:
        """What all campaigns together say of the constants at the time of one."""
        return self.walk.others()[index] + self.members[index].own

    def own_state(self, rig: Rig, index: int) -> tuple[State, State]:
        """What one campaign's own parameters are, and their standard uncertainties, ∞ unknown."""
        member, C = self.members[index], self.posterior(index).covariance
        part = member.reduced
        variance = np.diagonal(part.spread) + np.einsum("oc,cd,od->o", part.give, C, part.give)
        std = np.zeros(len(part.places))
        std[part.places] = np.where(part.open, np.inf, np.sqrt(variance))
        std[free_constants(rig)] = np.sqrt(np.diagonal(C)[self.common.places[index]])
        return member.state, placed(member.state, std)


def pool(campaigns: Sequence[Recorded]) -> Pool:
    """Pool campaigns whose rig files state the same constants, the latest rig's walk between them.

    Parameters
    ----------
    campaigns : one or more.

    Returns
    -------
    Pool : whether they are of one state is asked by `history.life_of`.

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
        steps_of = [shared.step(k, move) for k in range(len(ordered))]
        each = zip(ordered, fits, reduced, references, steps_of, strict=True)
        fits = [
            None if at is None else item.moved(at, part, reference, step, move)
            for item, at, part, reference, step in each
        ]
        references = [retract(*pair) for pair in zip(references, steps_of, strict=True)]
        settled = bool(np.all(np.abs(move) < _SETTLED * np.sqrt(np.diag(posterior.covariance))))
    members = [
        _member(shared, k, item, fits[k], reduced[k], references[k], rejected[k], known, walk.prior)
        for k, (item, known) in enumerate(zip(ordered, walk.before(), strict=True))
    ]
    return Pool(shared, references, walk, tuple(members))


def _member(
    shared: Common,
    index: int,
    item: Recorded,
    at: Fit | None,
    part: Observation,
    reference: State,
    rejected: dict[int, Finding],
    known: Information,
    prior: Information,
) -> Member:
    """A campaign within the pool; known : before it, from those before it and what is stated."""
    if isinstance(item, EarlierCalibration):
        chi2, dof = item.chi2, item.dof
    elif item.estimate is not None:  # without rows: how far it departs where it tells anything
        told = part.information.beside(prior)
        chi2, dof = contrast(known, told).chi2()
    else:
        both = known + part.information  # what it adds to χ² of those before it
        chi2 = max(0.0, float(known.mean @ known.score + part.chi2 - both.mean @ both.score))
        dof = part.rows
        # Constants of which nothing was stated are determined by the first that has them.
        if shared.terminal[index] == index:
            dof -= unstated(Priors(item.rig), load_alone=index > 0)
    state = item.own_state(at, part, reference)
    exact = item.scores(at, part, shared.places[index])
    return Member(item, part, at, state, rejected, chi2, dof, exact)


def _first_round(
    ordered: Sequence[Recorded], shared: Common
) -> tuple[list[Fit | None], list[dict[int, Finding]], list[State]]:
    """Fit each campaign with what those with more postures know; outliers are left out here.

    Returned with the references: constants of a motion or of the most postures, loads as stated.
    """
    fits: list[Fit | None] = [None] * len(ordered)
    rejected: list[dict[int, Finding]] = [{} for _ in ordered]
    sizes = {k: len(one.postures) for k, one in enumerate(ordered) if one.postures is not None}
    others = [k for k in range(len(ordered)) if k not in sizes]
    order = [*others, *sorted(sizes, key=lambda k: (-sizes[k], -k))]
    known: Information | None = None
    references: list[State] = []
    for k in order:
        item, state = ordered[k], ordered[k].start
        if item.postures is not None:
            rig = item.rig
            if known is not None:
                rig = replace(rig, earlier=joint_prior(rig, references[k], shared.of(k, known)))
            robust = fit_robust(loosened(rig), item.postures)
            fits[k], rejected[k] = robust.fit, robust.rejected
            state = with_motions(robust.fit.state, 0)
        if known is None:
            assert state is not None
            loads = (nominal(one.rig) for one in ordered)
            references = [replace(state, mass=x.mass, barycentre=x.barycentre) for x in loads]
            known = shared.stated(references)
        known = known + shared.embedded(k, item.observed(fits[k], references[k]).information)
    turns = _turns(ordered, [fits[k] for k in order], references[0].rotation)
    return fits, rejected, [replace(reference, rotation=turns) for reference in references]


def _turns(
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


def _reduced(
    ordered: Sequence[Recorded],
    fits: Sequence[Fit | None],
    references: Sequence[State],
    shared: Common,
) -> list[Observation]:
    """What each campaign says of the common parameters, counted from the references."""
    parts = []
    for k, (item, at, reference) in enumerate(zip(ordered, fits, references, strict=True)):
        part = item.observed(at, reference)
        give = np.zeros((len(part.own), shared.size))
        give[:, shared.places[k]] = part.give
        parts.append(replace(part, information=shared.embedded(k, part.information), give=give))
    return parts
