"""Does a campaign fit the others, or what was known before it; which one cause explains it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tdfscal.comparison.common import Common, Walk
from tdfscal.comparison.members import Recorded
from tdfscal.estimation.observation import Observation
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import free_constants, of_load
from tdfscal.model.parameters import CONSTANTS, LOAD, layout
from tdfscal.numerics.information import (
    Contrast,
    Information,
    contrast,
    nothing,
    p_value,
)
from tdfscal.records import FloatArray, IntArray, Rig
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
    chance alone departs as much, in any of the tests made.
    """

    campaign: str
    cause: str | None
    sensor: str | None
    turn: FloatArray
    p_value: float

    def against(self, earlier: str | None) -> Finding:
        """What is said of it; earlier : the calibration that it does not fit, else the others."""
        code, subject, size = f"misfit-{self.cause or 'unexplained'}", self.campaign, None
        if self.sensor is not None:
            code, subject = "misfit-turned", self.sensor
            size = float(np.linalg.norm(self.turn))
        values: dict[str, Value] = {
            "campaign": self.campaign,
            "than": earlier or "the other campaigns",
            "updating": earlier is not None,
        }
        unit = "" if size is None else "rad"
        return Finding(code, (subject,), size, unit, self.p_value, values=values, rejects=True)


def within(part: Observation, prior: Information) -> tuple[float, int]:
    """χ² and degrees of freedom of a campaign with the constants at its own best.

    prior : what is stated of the constants, beside which the campaign says something of them.
    """
    told = part.information.beside(prior)
    explained, rank = Contrast(told.matrix, told.score).chi2()
    return max(0.0, part.chi2 - explained), max(0, part.rows - rank)


def not_fitting(
    shared: Common, campaigns: Sequence[Recorded], walk: Walk, level: FloatArray
) -> tuple[Misfit, ...]:
    """Campaigns that do not fit the others: the worst first, then what is left without it.

    Calibrations are what the campaigns are held against.

    level : (K,), of each campaign, all its tests together.
    """
    own, prior, found = list(walk.own), walk.prior, list[Misfit]()
    for _ in range(len(own) - 1):
        ranked = []
        for k, rest in enumerate(replace(walk, own=own).others()):
            if own[k].matrix.any() and campaigns[k].earlier is None:
                departure = contrast(rest, own[k], prior)
                ranked.append((_probability(shared.rigs[k], departure), k, departure))
        if not ranked:
            break
        # Of heavy ones all probabilities are 0.
        p, k, departure = min(
            ranked, key=lambda each: (each[0] / level[each[1]], -each[2].chi2()[0])
        )
        if p > level[k]:
            break
        at = shared.places[k]
        misfit = _named(shared.rigs[k], campaigns[k].name, departure, prior, p, at)
        found.append(misfit)
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
