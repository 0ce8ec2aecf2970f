"""What was known before a campaign; does it fit that, or the others; which sensor explains it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tdfscal.comparison.common import Common, Walk
from tdfscal.estimation.exact_quantities import OF_THE_TERMINAL
from tdfscal.estimation.fit import Priors
from tdfscal.estimation.observation import Observation, stated
from tdfscal.frozen import field, record, replace
from tdfscal.model.calibrated import (
    free_constants,
    information_of,
    joint_prior,
    of_load,
    same_load,
    turned,
)
from tdfscal.model.parameters import CONSTANTS, LOAD, State, deviation, layout, starting_state
from tdfscal.numerics import so3
from tdfscal.numerics.information import (
    Contrast,
    Information,
    contrast,
    nothing,
    p_value,
)
from tdfscal.records import BoolArray, ExactMoves, FloatArray, IntArray, JointPrior, Measured, Rig
from tdfscal.significance import CAUSE_EXPLAINS, MISFIT

#: Stated standard uncertainties by which hinges, datums, gains or the base may have changed: by
#: more, positions or weight would tell it without any force (theory, section 14).
_ALLOWED = 10.0


@record
class Misfit:
    """A campaign that does not fit the others, and the one cause that explains it, if one does.

    cause : group of `model.parameters.CONSTANTS` whose change takes the misfit away, "load" for
    both of the terminal's; None where no single one does. sensor : name of the one that turned,
    where the cause is a rotation; turn : (3,), rad, BCS, its most likely turn. p_value : that
    chance alone departs as much, in any of the tests made; above `level` it is no misfit.
    """

    campaign: str
    cause: str | None
    sensor: str | None
    turn: FloatArray
    p_value: float
    level: float = 0.0


def within(part: Observation, prior: Information) -> tuple[float, int]:
    """χ² and degrees of freedom of a campaign with the constants at its own best.

    prior : what is stated of the constants, beside which the campaign says something of them.
    """
    told = part.information.beside(prior)
    explained, rank = Contrast(told.matrix, told.score).chi2()
    return max(0.0, part.chi2 - explained), max(0, part.rows - rank)


def not_fitting(
    shared: Common, names: Sequence[str], walk: Walk, level: FloatArray
) -> tuple[Misfit, ...]:
    """Campaigns that do not fit the others: the worst first, then what is left without it.

    level : (K,), of each campaign, all its tests together.
    """
    own, prior, found = list(walk.own), walk.prior, list[Misfit]()
    for _ in range(len(own) - 1):
        ranked = []
        for k, rest in enumerate(replace(walk, own=own).others()):
            if own[k].matrix.any():
                departure = contrast(rest, own[k], prior)
                ranked.append((_probability(shared.rigs[k], departure), k, departure))
        # Of heavy ones all probabilities are 0.
        p, k, departure = min(
            ranked, key=lambda each: (each[0] / level[each[1]], -each[2].chi2()[0])
        )
        if p > level[k]:
            break
        at = shared.places[k]
        misfit = _named(shared.rigs[k], names[k], departure, prior, p, at)
        found.append(replace(misfit, level=float(level[k])))
        own[k] = nothing(len(prior.score))
    return tuple(found)


def birge_of(fits: Sequence[tuple[float, int]]) -> float:
    """Birge ratio of fits together, never below 1: understated noise is no turned sensor."""
    dof = sum(count for _, count in fits)
    return max(1.0, float(np.sqrt(sum(chi2 for chi2, _ in fits) / dof))) if dof else 1.0


def scatter_of(fits: Sequence[tuple[float, int]]) -> FloatArray:
    """Birge ratio (K,) by which each campaign counts: the common one, but a noisy one's its own.

    A noisy month neither passes for a turned sensor nor widens the others.
    """
    noisy = np.array([p_value(fit) < MISFIT / len(fits) for fit in fits])
    common = birge_of([fit for fit, own in zip(fits, noisy, strict=True) if not own])
    return np.array([birge_of([f]) if own else common for f, own in zip(fits, noisy, strict=True)])


def misfit_of(rig: Rig, name: str, part: Observation, level: float) -> Misfit:
    """Hold a campaign against what is known before it (`rig.earlier`), about the latter's estimate.

    level : of all tests together.
    """
    assert rig.earlier is not None
    whole = replace(rig, earlier=None)
    prior = stated(Priors(whole), starting_state(rig))
    spoken = rig.earlier.places[free_constants(whole)]  # the load is none where it is stated anew
    prior = Information(prior.matrix[np.ix_(spoken, spoken)], prior.score[spoken])
    birge, own = scatter_of([(rig.earlier.chi2, rig.earlier.dof), within(part, prior)])
    known = information_of(rig.earlier).scaled(birge)
    departure = contrast(known, part.information.scaled(own), prior.scaled(birge))
    at = np.arange(len(known.score))
    found = _named(rig, name, departure, prior, _probability(rig, departure), at)
    return replace(found, level=level)


def _probability(rig: Rig, departure: Contrast) -> float:
    """Of as large a departure by chance: any single sensor's turn, or all together (Bonferroni)."""
    rarest = min(p_value(departure.chi2()), departure.turn_p(rig.n).min())
    return float(min(1.0, (1 + rig.n) * rarest))


def _named(
    rig: Rig, name: str, departure: Contrast, prior: Information, p: float, at: IntArray
) -> Misfit:
    """Name the likeliest change that leaves no misfit; of a sensor, its own turn alone.

    at : places of the rig's own free constants among all.
    """
    free, place = free_constants(rig), layout(rig.n)
    allowed = _ALLOWED / np.sqrt(np.diagonal(prior.matrix))
    allowed[at[of_load(rig)]] = np.inf
    explain: list[tuple[float, str, int | None]] = [
        (p_value(departure.chi2(turn_of(i))), "rotation", i)
        for i in range(rig.n)
        if _taken_away(departure, turn_of(i))
    ]
    for group in ("load", *(group for group in CONSTANTS[1:] if group not in LOAD)):
        inside = np.zeros(len(free), dtype=np.bool_)
        for part in LOAD if group == "load" else (group,):
            inside[place[part]] = True
        where = at[inside[free]]
        if p_value(departure.left(where, allowed[where])) >= CAUSE_EXPLAINS:
            explain.append((p_value(departure.chi2(where)), group, None))
    _, cause, sensor = min(explain, default=(p, None, None), key=lambda each: each[0])
    if sensor is None:
        return Misfit(name, cause, None, np.zeros(3), p)
    turn, _ = departure.change(turn_of(sensor))
    return Misfit(name, cause, rig.supports[sensor], turn, p)


def _taken_away(departure: Contrast, where: slice) -> bool:
    """Whether a turn leaves no misfit; a large one leaves what is of the second order in it."""
    left, dof = departure.left(where)
    turn, _ = departure.change(where)
    second = float(turn @ turn) * departure.chi2(where)[0]
    return p_value((max(0.0, left - second), dof)) >= CAUSE_EXPLAINS


def turn_of(sensor: int) -> slice:
    """Place of a sensor's rotation among the constants."""
    return slice(3 * sensor, 3 * sensor + 3)


@record(kw_only=True)
class EarlierCalibration:
    """A calibration with its full covariance, before any scaling by a Birge ratio.

    information : on the free constants (C,) of its rig, counted from `state`. determined : (n,),
    sensors whose turns it gives. chi2, dof : of all the fits behind it. sha256 : of its file.
    base : digest and date of the calibration that it stands on. pooled : of several campaigns.
    exact : how its constants (C,) move with errors of what it took as exact. sources : (n, 3),
    share of each source in the variance of its roll, pitch, yaw; none where that is not told.
    """

    name: str
    rig: Rig
    state: State
    information: Information
    determined: BoolArray
    measured: Measured
    sha256: str
    chi2: float
    dof: int
    base: tuple[str, str] | None = None
    pooled: bool = False
    exact: tuple[ExactMoves, ...] = ()
    sources: Mapping[str, FloatArray] = field(default_factory=dict)

    def prior(self, rig: Rig, month: float) -> JointPrior:
        """What it says of a rig's constants at a time in months, its walk since included.

        Of the terminal only where the rig file states it alike.
        """
        known = self.information.walked(self.walk(rig, month))
        alike = same_load(self.rig, rig)
        other, free = of_load(self.rig) & (not alike), free_constants(self.rig)
        exact = [
            one if alike or one.name not in OF_THE_TERMINAL else one.all_apart()
            for one in self.exact
        ]
        prior = joint_prior(
            rig, self.state, known, self.chi2, self.dof, free=free, but=other, exact=exact
        )
        return replace(prior, sources=self._with_walk(self.walk(rig, month)))

    def _with_walk(self, walk: FloatArray) -> dict[str, FloatArray]:
        """Shares of the sources after the angles walked with variance (C,)."""
        if not self.sources:
            return {}
        size = 3 * self.rig.n
        R, own = self.state.rotation, self.information.covariance[:size, :size]
        before, walked = so3.rpy_variance(R, own), so3.rpy_variance(R, np.diag(walk[:size]))
        left = before / (before + walked)
        return {name: left * share for name, share in self.sources.items()} | {"walk": 1.0 - left}

    def walk(self, rig: Rig, month: float) -> FloatArray:
        """Variance by which a rig's angles may have walked since, at a time in months."""
        gap = max(month - self.measured.month, 0.0)
        return turned(rig, rig.drift.angle * float(np.sqrt(gap)), len(self.information.score))

    def about(self, reference: State) -> Information:
        """Information (c,) on its own constants, counted from a reference."""
        free = free_constants(self.rig)
        away = deviation(self.state, reference)[: len(free)][free]
        return Information(self.information.matrix, self.information.matrix @ away)
