"""What campaigns take as exact, and how an error of it moves what they say together.

An error of the level, of a datum or of a gain is the rig's: each campaign has it, and the pool
moves by all of their moves, each with the weight of its information, Σᵢ Wᵢ mᵢ with Wᵢ = Λ⁻¹ Λᵢ.
The mean of the pool is linear in the campaigns' scores Λᵢ mᵢ, a walk between them included, so
that these go the same way. A load's error is common to the campaigns under that load, a tare's is
each campaign's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdfscal.comparison.common import Common
from tdfscal.comparison.walk import others
from tdfscal.estimation.exact_quantities import OF_THE_TERMINAL, exact_rows
from tdfscal.estimation.observation import Observation
from tdfscal.model.calibrated import Calibrated, free_constants
from tdfscal.numerics.information import Information, inverse
from tdfscal.records import ExactMoves, FloatArray, IntArray, Rotations
from tdfscal.selfcal.estimator import Fit


def scores_of_fit(fit: Fit, part: Observation, places: IntArray) -> tuple[ExactMoves, ...]:
    """Scores of the common parameters (C,) by errors of what a campaign at rest takes as exact.

    part : what it says, its own parameters eliminated. places : of its constants among the common.
    """
    J = fit.whitened()[1]
    own = part.places[fit.active]
    reduced = part.give.T @ J[:, own].T
    reduced[places] += J[:, ~own].T
    return tuple(one.by(reduced) for one in exact_rows(fit))


def scores_of_estimate(
    known: Calibrated, exact: Sequence[ExactMoves], size: int, places: IntArray
) -> tuple[ExactMoves, ...]:
    """Scores (C,) of a campaign calibrated by itself; exact : moves (P,) of its parameters."""
    free = free_constants(known.rig)
    posterior = np.zeros((size, len(free)))
    posterior[np.ix_(places, free)] = inverse(known.covariance[np.ix_(free, free)])
    return tuple(one.by(posterior) for one in exact)


def scores_of_survey(
    survey: Rotations, exact: Sequence[ExactMoves], size: int
) -> tuple[ExactMoves, ...]:
    """Scores (C,) of a survey; exact : moves (3n,) of its turns."""
    posterior = np.zeros((size, len(survey.covariance)))
    posterior[: len(survey.covariance)] = inverse(survey.covariance)
    return tuple(one.by(posterior) for one in exact)


@dataclass(frozen=True, slots=True)
class _Error:
    """One realisation of an error: scores (C, c) by campaign that has it; and whose it is."""

    of: ExactMoves
    shared: bool
    scores: dict[int, FloatArray]

    def of_campaign(self, index: int) -> FloatArray:
        """Scores (C, c) of one campaign, 0 where it has not this error."""
        some = next(iter(self.scores.values()))
        return self.scores.get(index, np.zeros_like(some))


def others_move(
    shared: Common,
    index: int,
    exact: Sequence[Sequence[ExactMoves]],
    own: Sequence[Information],
    prior: Information,
    steps: Sequence[FloatArray],
) -> tuple[ExactMoves, ...]:
    """How the mean of all campaigns but one moves, at its time: moves of (C,) common parameters.

    exact : per campaign, scores (C,). own, prior, steps : as in `walk.others`.
    """
    errors = list(_errors(shared, index, exact))
    if not errors:
        return ()
    scores = [np.hstack([error.of_campaign(k) for error in errors]) for k in range(len(own))]
    moved = [replace(item, score=score) for item, score in zip(own, scores, strict=True)]
    still = replace(prior, score=np.zeros_like(scores[0]))
    mean = others(moved, still, steps)[index].mean
    widths = [error.of_campaign(index).shape[1] for error in errors]
    found: dict[str, ExactMoves] = {}
    for error, moves in zip(errors, np.split(mean, np.cumsum(widths)[:-1], axis=1), strict=True):
        one = replace(error.of, common=moves, apart=moves[:, :0])
        one = one if error.shared else one.all_apart()
        if (other := found.get(one.name)) is not None:
            common, apart = (
                np.hstack(sides) for sides in ((other.common, one.common), (other.apart, one.apart))
            )
            one = replace(one, common=common, apart=apart)
        found[one.name] = one
    return tuple(found.values())


def _errors(shared: Common, index: int, exact: Sequence[Sequence[ExactMoves]]) -> Iterator[_Error]:
    """Errors that campaigns but one have: the rig's, a terminal's, and each campaign's own."""
    found: dict[tuple[str, int], _Error] = {}
    for k, quantities in enumerate(exact):
        if k == index:
            continue
        for one in quantities:
            terminal = shared.terminal[k] if one.name in OF_THE_TERMINAL else -1
            here = terminal in (-1, shared.terminal[index])
            if one.common.shape[1]:
                error = found.setdefault((one.name, terminal), _Error(one, here, {}))
                error.scores[k] = one.common
            if one.apart.shape[1]:
                yield _Error(one, False, {k: one.apart})
    yield from found.values()
