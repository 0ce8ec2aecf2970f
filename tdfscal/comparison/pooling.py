"""Several campaigns of one rig as one estimate: common constants, zeros of each its own.

Each campaign is fitted with what the others know, so that one which determines nothing alone takes
part; then all are reduced to their information about one common reference, filtered in the order
of time. Whether they are of one state is the history's to say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from tdfscal.comparison.common import (
    Common,
    Walk,
    common,
    kept,
    others_move,
    sources_together,
    under_one_tare,
)
from tdfscal.comparison.members import EarlierCalibration, Recorded, first_turns
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import Observation, unstated
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import joint_prior, loosened, same_tare, tare_std, turned
from tdfscal.model.parameters import (
    State,
    layout,
    nominal,
    parameter_count,
    placed,
    retract,
    with_motions,
)
from tdfscal.numerics import so3
from tdfscal.numerics.information import Contrast, Information, contrast
from tdfscal.records import ExactMoves, FloatArray, JointPrior
from tdfscal.selfcal.estimator import Fit, at_state
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
    moved : per campaign, variance (C,) by which zeros moved before it without a tare; in the walk.
    """

    common: Common
    references: list[State]
    walk: Walk
    members: tuple[Member, ...]
    moved: list[FloatArray]

    @property
    def reference(self) -> State:
        """The last campaign's."""
        return self.references[-1]

    def others(self, index: int) -> JointPrior:
        """What all other campaigns know of the constants at the time of one."""
        chosen, rig = [m for k, m in enumerate(self.members) if k != index], self.common.rigs[index]
        chi2, dof = sum(m.chi2 for m in chosen), sum(m.dof for m in chosen)
        known = self.common.of(index, self.walk.others()[index])
        at = self.common.places[index]
        moved = others_move(self.common, index, [m.exact for m in self.members], self.walk)
        here = [one.by(np.eye(self.common.size)[at]) for one in moved]
        prior = joint_prior(rig, self.references[index], known, chi2, dof, exact=here)
        tares = {first for k, first in enumerate(self.common.tare) if k != index}
        sources = sources_together([m.recorded.contributions for m in chosen], len(tares) == 1)
        return replace(prior, sources=self._with_walk(sources, index))

    def _with_walk(self, sources: dict[str, FloatArray], index: int) -> dict[str, FloatArray]:
        """Shares of the sources beside that of the walk until one campaign."""
        R = self.reference.rotation
        if not sources or not np.any(np.array(self.walk.steps)[:, : 3 * len(R)]):
            return sources
        walks = (replace(self.walk, steps=self.moved), self.walk)
        left, whole = (
            so3.rpy_variance(R, walk.others()[index].covariance[: 3 * len(R), : 3 * len(R)])
            for walk in walks
        )
        share = left / whole
        return {name: share * own for name, own in sources.items()} | {"walk": 1.0 - share}

    def one_tare(self) -> Iterator[Finding]:
        """Campaigns whose zeros are those of one tare, as far as they tell."""
        for first in sorted(set(self.common.tare)):
            names = [
                m.name for m, at in zip(self.members, self.common.tare, strict=True) if at == first
            ]
            if len(names) > 1:
                yield Finding("tare-common", tuple(names))

    def index(self, recorded: Recorded) -> int:
        """Place of a campaign in the order of time."""
        return next(k for k, m in enumerate(self.members) if m.recorded is recorded)

    def posterior(self, index: int) -> Information:
        """What all campaigns together say of the constants at the time of one."""
        return self.walk.others()[index] + self.members[index].own

    def own_state(self, index: int) -> tuple[State, State]:
        """What one campaign's own parameters are, and their standard uncertainties, ∞ unknown."""
        member, C = self.members[index], self.posterior(index).covariance
        part = member.reduced
        variance = np.diagonal(part.spread) + np.einsum("oc,cd,od->o", part.give, C, part.give)
        std = np.zeros(len(part.places))
        std[part.places] = np.where(part.open, np.inf, np.sqrt(variance))
        std[: parameter_count(member.state.n)] += self.common.step(index, np.sqrt(np.diagonal(C)))
        walked = self.common.step(index, self.posterior(index).mean)
        walked = np.pad(walked, (0, len(std) - len(walked)))
        return retract(member.state, walked), placed(member.state, std)


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
    turns = rig.drift.angle * np.sqrt(gaps)
    shared = common([item.rig for item in ordered], range(len(ordered)))
    fits, rejected, references = _first_round(ordered, shared)
    tares = _tares(ordered, fits, references, shared, [turned(rig, q, shared.size) for q in turns])
    shared, moved = under_one_tare(shared.rigs, *tares)
    steps = [turned(rig, q, shared.size) + by for q, by in zip(turns, moved, strict=True)]
    told = [item.of_rig(own) for item, own in zip(ordered, shared.rigs, strict=True)]
    fits = [
        at and at_state(item.rig, at.postures, at.state, at.weight)
        for item, at in zip(told, fits, strict=True)
    ]
    settled = False
    for rounds in range(_ROUNDS + 1):
        reduced = _reduced(told, fits, references, shared)
        walk = Walk([part.information for part in reduced], shared.stated(references), steps)
        if settled or rounds == _ROUNDS:
            break
        posterior = walk.others()[-1] + walk.own[-1]
        move = posterior.mean
        steps_of = [shared.step(k, move) for k in range(len(ordered))]
        each = zip(told, fits, reduced, references, steps_of, strict=True)
        fits = [
            None if at is None else item.moved(at, part, reference, step, move)
            for item, at, part, reference, step in each
        ]
        references = [retract(*pair) for pair in zip(references, steps_of, strict=True)]
        settled = bool(np.all(np.abs(move) < _SETTLED * np.sqrt(np.diag(posterior.covariance))))
    members = [
        _member(shared, k, item, fits[k], reduced[k], references[k], rejected[k], known, walk.prior)
        for k, (item, known) in enumerate(zip(told, walk.before(), strict=True))
    ]
    members = [replace(one, recorded=item) for one, item in zip(members, ordered, strict=True)]
    return Pool(shared, references, walk, tuple(members), moved)


def _tares(
    ordered: Sequence[Recorded],
    fits: Sequence[Fit | None],
    references: Sequence[State],
    shared: Common,
    steps: Sequence[FloatArray],
) -> tuple[list[int], FloatArray]:
    """Per campaign, the first one whose tare it has, and by how much zeros moved before it.

    shared, steps : of campaigns with zeros of their own, as have those of which no tare is stated
    alike, surveys, and a calibration that stands on another one in the pool.
    """
    reduced = _reduced(ordered, fits, references, shared)
    walk = Walk([part.information for part in reduced], shared.stated(references), steps)
    everything, tare, shares = walk.others(), list(range(len(ordered))), np.ones(len(ordered))
    zeros, heard = [], list[int]()
    for k, (item, at, part) in enumerate(zip(ordered, fits, reduced, strict=True)):
        based = isinstance(item, EarlierCalibration) and item.base
        if not based and (item.estimate is None or item.estimate.joint):
            heard.append(k)
        state, place = item.start if at is None else at.state, layout(item.rig.n)["zero"]
        assert state is not None
        own = np.flatnonzero(part.places) - place.start
        own = np.flatnonzero((own >= 0) & (own < 3 * item.rig.n))
        value = state.zero.ravel()[part.places[place]] + part.own[own]
        zeros.append((value, part.give[own], part.spread[np.ix_(own, own)]))
    for j, k in pairwise(heard):
        if same_tare(ordered[j].rig, ordered[k].rig):
            known, ((z, G, S), (z_j, G_j, S_j)) = everything[k] + walk.own[k], (zeros[k], zeros[j])
            covariance = S + S_j + (G - G_j) @ known.covariance @ (G - G_j).T
            difference = z - z_j + (G - G_j) @ known.mean
            shares[k] = kept(difference, covariance, tare_std(ordered[k].rig))
            tare[k] = tare[j] if shares[k] < 1 else k
    return tare, shares


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
            references = [
                replace(state, zero=x.zero, mass=x.mass, barycentre=x.barycentre) for x in loads
            ]
            known = shared.stated(references)
        known = known + shared.embedded(k, item.observed(fits[k], references[k]).information)
    turns = first_turns(ordered, [fits[k] for k in order], references[0].rotation)
    return fits, rejected, [replace(reference, rotation=turns) for reference in references]


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
