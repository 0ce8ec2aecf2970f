"""What several campaigns have in common: constants, terminals as stated, a tare that nobody
renewed, what is taken as exact, and a walk of the angles between them.

A weighing that M rig files state alike is one realisation; taken as each campaign's own its error
would be averaged M times away (theory, section 13). Each campaign has the constants of the rig, and
of the terminals its own. So it is with zeros where nobody tared between two campaigns: the tare's
error is one, and since then they moved by little. Nobody states it; the readings tell (`kept`).

An error of the level, of a datum or of a gain is the rig's too: each campaign has it, and the pool
moves by all of their moves, each with the weight of its information, Σᵢ Wᵢ mᵢ with Wᵢ = Λ⁻¹ Λᵢ.
The mean of the pool is linear in the campaigns' scores Λᵢ mᵢ, a walk between them included, so
that these go the same way. A load's error is common to the campaigns under that load, a tare's is
each campaign's own.

Angles creep: of the free constants of the rig (C,), the state, the 3n rotations walk with intensity
q per axis (rad/√month) and the others stay. In information form a campaign that determines only a
part of them needs no special case. Filtered forwards and backwards, the smoothed state is the sum
of both and of the campaign's own (two-filter form of Rauch, Tung and Striebel's smoother; Fraser
and Potter, IEEE Trans. Autom. Control 14, 1969).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from tdfscal.estimation.exact_quantities import OF_THE_TERMINAL
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import stated
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import among_constants, free_constants, of_load, same_load, tare_std
from tdfscal.model.parameters import State
from tdfscal.numerics.distributions import chi2_quantile
from tdfscal.numerics.information import Information, contrast, nothing
from tdfscal.records import ExactMoves, FloatArray, IntArray, Rig
from tdfscal.significance import INTERVAL_COVERAGE


@record
class Common:
    """Common parameters (C,) of campaigns with these rig files; rotations first.

    places : per campaign (c,), which of them its own free constants are.
    terminal : per campaign, the first one whose rig file states the same load. tare : the first one
    whose tare it has.
    """

    rigs: tuple[Rig, ...]
    size: int
    places: tuple[IntArray, ...]
    terminal: tuple[int, ...]
    tare: tuple[int, ...]

    def embedded(self, index: int, own: Information) -> Information:
        """What one campaign says of its own constants (c,), as of all common ones."""
        out, at = nothing(self.size), self.places[index]
        out.matrix[np.ix_(at, at)], out.score[at] = own.matrix, own.score
        return out

    def of(self, index: int, known: Information) -> Information:
        """What is known of one campaign's own constants (c,), whatever the others are."""
        at = self.places[index]
        other = np.ones(self.size, dtype=np.bool_)
        other[at] = False
        rest = known.without(other)
        return Information(rest.matrix[np.ix_(at, at)], rest.score[at])

    def stated(self, references: Sequence[State]) -> Information:
        """What the rig files state of them, counted once, about each campaign's reference."""
        out = nothing(self.size)
        for k in sorted({*self.terminal, *self.tare}):
            own = self.embedded(k, stated(Priors(self.rigs[k]), references[k]))
            at = self.places[k]
            out.matrix[at], out.score[at] = own.matrix[at], own.score[at]
        return out

    def step(self, index: int, move: FloatArray) -> FloatArray:
        """Step (P,) of one campaign's parameters by one of the common ones."""
        free = free_constants(self.rigs[index])
        step = np.zeros(len(free))
        step[free] = move[self.places[index]]
        return step


def common(rigs: Sequence[Rig], tare: Sequence[int]) -> Common:
    """Find what campaigns of one rig have in common, by what their rig files state.

    tare : per campaign, the first one whose tare it has; where there are others under it, its zeros
    are among the constants.
    """
    terminal = [next(j for j, a in enumerate(rigs) if same_load(a, rig)) for rig in rigs]
    alone = [tare.count(first) == 1 for first in tare]
    rigs = [replace(rig, zeros_common=not own) for rig, own in zip(rigs, alone, strict=True)]
    size, places = int(free_constants(rigs[0]).sum()), [np.arange(free_constants(rigs[0]).sum())]
    groups = [(of_load(rig), among_constants(rig, "zero")) for rig in rigs]
    for k, (load, zero) in enumerate(groups[1:], 1):
        at = np.empty(len(load), dtype=np.int_)
        for number, (own, first) in enumerate(((load, terminal[k]), (zero, tare[k]))):
            if first < k:
                at[own] = places[first][groups[first][number]]
            else:
                at[own] = size + np.arange(own.sum())
                size += int(own.sum())
        at[~load & ~zero] = places[0][~groups[0][0] & ~groups[0][1]]
        places.append(at)
    return Common(tuple(rigs), size, tuple(places), tuple(terminal), tuple(tare))


#: Shares of what a new tare changes the zeros by, in variance, that are tried, and the largest by
#: which they move without one.
_MOVED, _KEPT = np.array([0.0, *np.geomspace(1e-4, 1.0, 25)]), 0.1


def kept(difference: FloatArray, covariance: FloatArray, std: FloatArray) -> float:
    """By how much zeros moved without a tare, as a share of what a new one changes; 1 of a new one.

    difference : (z,), N, of the zeros of two campaigns, with its covariance (z, z), as estimated
    with tares of their own. std : (z,), N, of a tare.

    Under two tares the difference has the variance 2 σ² beforehand, under one tare a share t of it
    by which zeros moved since; the most likely t is taken (empirical Bayes). A tare that is taken
    for none, where hardly anything is told of the zeros, makes intervals wider, not too narrow.
    """
    unit = np.sqrt(2) * std
    part, basis = np.linalg.eigh(covariance / unit[:, None] / unit)
    part, along = np.clip(part, np.finfo(float).eps, 1.0), basis.T @ (difference / unit)
    told = 1 / part - 1  # by the readings alone, where a new tare's is 1
    wide = 1 + _MOVED[:, None] * told
    likelihood = np.sum(_MOVED[:, None] * (along / part) ** 2 / wide - np.log(wide), axis=1)
    moved = float(_MOVED[np.argmax(likelihood)])
    return moved if moved < _KEPT else 1.0


def under_one_tare(
    rigs: Sequence[Rig], tare: Sequence[int], shares: FloatArray
) -> tuple[Common, list[FloatArray]]:
    """What campaigns have in common, and the variances (C,) by which zeros moved before each.

    tare : per campaign, the first one whose tare it has. shares : (K,), as `kept` says.
    """
    shared = common(rigs, tare)
    moved = [np.zeros(shared.size) for _ in rigs]
    for k in np.flatnonzero(np.arange(len(tare)) - tare):
        at = shared.places[k][among_constants(shared.rigs[k], "zero")]
        moved[k][at] = 2 * shares[k] * tare_std(shared.rigs[k]) ** 2
    return shared, moved


#: Sources of the budget that are of the rig, or of a terminal: one error in all campaigns.
_OF_ALL = ("sensitivity", "mass", "barycentre", "hinge", "datum", "gravity", "compliance")


def sources_together(
    each: Sequence[Mapping[str, FloatArray]], one_tare: bool
) -> dict[str, FloatArray]:
    """Shares (n, 3) of the sources in the variance of campaigns together, by those of each alone.

    each : of a campaign, variances (n, 3) of roll, pitch, yaw by source. As of means weighted by
    these variances: what is the rig's adds up, as does a tare of all; the others average out.
    """
    of_all = (*_OF_ALL, "zero") if one_tare else _OF_ALL
    told = [one for one in each if one]
    weights = [1.0 / np.maximum(sum(one.values()), np.finfo(float).tiny) for one in told]
    found: dict[str, FloatArray] = {}
    for name in dict.fromkeys(name for one in told for name in one):
        std = [w * np.sqrt(one.get(name, 0.0)) for w, one in zip(weights, told, strict=True)]
        together = np.square(np.sum(std, axis=0)) if name in of_all else np.sum(np.square(std), 0)
        found[name] = np.asarray(together)
    total = np.sum(list(found.values()), axis=0)
    total = np.where(total > 0, total, 1.0)  # of a sensor that has no angles
    return {name: variance / total for name, variance in found.items()}


def others_move(
    shared: Common, index: int, exact: Sequence[Sequence[ExactMoves]], walk: Walk
) -> tuple[ExactMoves, ...]:
    """How the mean of all campaigns but one moves, at its time: moves of (C,) common parameters.

    exact : per campaign, scores (C,). An error of the rig is one for all campaigns, one of a
    terminal for those under it, the others are each campaign's own.
    """
    errors, kinds = dict[tuple[str, int, int], FloatArray](), dict[str, ExactMoves]()
    for k, one in ((k, one) for k, each in enumerate(exact) if k != index for one in each):
        kinds.setdefault(one.name, one)
        terminal = shared.terminal[k] if one.name in OF_THE_TERMINAL else -1
        for whose, scores in ((-1, one.common), (k, one.apart)):
            if scores.shape[1]:
                of_all = np.zeros((len(exact), *scores.shape))
                errors.setdefault((one.name, terminal, whose), of_all)[k] = scores
    if not errors:
        return ()
    together = np.concatenate([*errors.values()], axis=2)
    moved = [replace(item, score=own) for item, own in zip(walk.own, together, strict=True)]
    still = replace(walk.prior, score=np.zeros_like(together[0]))
    mean = Walk(moved, still, walk.steps).others()[index].mean
    ends = np.cumsum([each.shape[2] for each in errors.values()])
    parts = zip(errors, np.split(mean, ends[:-1], axis=1), strict=True)
    sides = {name: ([mean[:, :0]], [mean[:, :0]]) for name in kinds}
    for (name, terminal, whose), part in parts:
        here = whose == -1 and terminal in (-1, shared.terminal[index])
        sides[name][0 if here else 1].append(part)
    return tuple(
        replace(kinds[name], common=np.hstack(common), apart=np.hstack(apart))
        for name, (common, apart) in sides.items()
    )


#: Random-walk intensities that are tried, rad/√month, beside none at all.
_TRIED = np.geomspace(1e-6, 2e-2, 60)


@record
class Walk:
    """Checks in the order of time: what each says by itself, and the walk between them.

    own : per check. prior : before the first. steps : variance (C,) of the walk before each check;
    the first is not used.
    """

    own: Sequence[Information]
    prior: Information
    steps: Sequence[FloatArray]

    def before(self) -> list[Information]:
        """What is known before each check speaks, from those before it."""
        found, now = [], self.prior
        for k, item in enumerate(self.own):
            now = now.walked(self.steps[k]) if k else now
            found.append(now)
            now = now + item
        return found

    def others(self) -> list[Information]:
        """What all other checks say of the constants at the time of each."""
        found, later = self.before(), self.prior - self.prior
        for k in range(len(self.own) - 1, -1, -1):
            found[k] = found[k] + later
            later = (later + self.own[k]).walked(self.steps[k])
        return found

    def log_likelihood(self) -> float:
        """Logarithm of the likelihood of all checks but the first, up to a constant."""
        total = 0.0
        for known, item in zip(self.before()[1:], self.own[1:], strict=True):
            gain = _log_det(known.matrix + item.matrix) - _log_det(known.matrix)
            total -= 0.5 * (gain + contrast(known, item).chi2()[0])
        return total


def _log_det(matrix: FloatArray) -> float:
    scale = np.sqrt(np.diagonal(matrix))
    return float(np.linalg.slogdet(matrix / scale[:, None] / scale)[1] + 2 * np.log(scale).sum())


@record
class Intensity:
    """Random-walk intensity by the history, rad/√month: most likely value, 95 % interval."""

    value: float
    low: float
    high: float


def intensity(likelihood: Callable[[float], float]) -> Intensity:
    """Estimate q from its log-likelihood; the interval by the likelihood ratio (χ² of one).

    Its ends lie outwards, at the first values tried that are not within it: with many checks it is
    narrower than the steps between them. low is 0 where no walk at all is within it.
    """
    tried = np.concatenate([[0.0], _TRIED])
    level = np.array([likelihood(float(q)) for q in tried])
    best = int(np.argmax(level))
    inside = np.flatnonzero(level >= level[best] - chi2_quantile(INTERVAL_COVERAGE, 1) / 2)
    low, high = max(inside[0] - 1, 0), min(inside[-1] + 1, len(tried) - 1)
    return Intensity(float(tried[best]), float(tried[low]), float(tried[high]))
