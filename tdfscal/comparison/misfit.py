"""Does a campaign fit the others, or what was known before it; and which sensor explains it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tdfscal.comparison.eliminated import Eliminated
from tdfscal.comparison.walk import others
from tdfscal.model.earlier import information_of
from tdfscal.numerics.information import Contrast, Information, contrast, nothing, p_value
from tdfscal.records import FloatArray, Rig
from tdfscal.significance import CAMPAIGN_MISFIT


@dataclass(frozen=True, slots=True)
class Misfit:
    """A campaign that does not fit the others, and the sensor that explains it best, if one does.

    turn : (3,), rad, BCS, of that sensor; p_value : that chance alone departs as much.
    """

    campaign: str
    sensor: str | None
    turn: FloatArray
    p_value: float


def within(part: Eliminated) -> tuple[float, int]:
    """χ² and degrees of freedom of a campaign with the constants at its own best."""
    explained, rank = Contrast(part.information.matrix, part.information.score).chi2()
    return max(0.0, part.chi2 - explained), max(0, part.rows - rank)


def not_fitting(
    rig: Rig,
    names: Sequence[str],
    own: Sequence[Information],
    prior: Information,
    steps: Sequence[FloatArray],
) -> tuple[Misfit, ...]:
    """Campaigns that do not fit the others: the worst first, then what is left without it."""
    level, own, found = CAMPAIGN_MISFIT / len(own), list(own), []
    silent = nothing(len(prior.score))
    for _ in range(len(own) - 1):
        ranked = []
        for k, rest in enumerate(others(own, prior, steps)):
            if own[k].matrix.any():
                departure = contrast(rest, own[k])
                ranked.append((_probability(rig, departure), k, departure))
        worst = min(ranked, key=lambda entry: entry[0])
        if worst[0] > level:
            break
        found.append(_named(rig, names[worst[1]], worst[2], worst[0]))
        own[worst[1]] = silent
    return tuple(found)


def birge_of(fits: Sequence[tuple[float, int]]) -> float:
    """Birge ratio of fits together, never below 1: understated noise is no turned sensor."""
    dof = sum(count for _, count in fits)
    return max(1.0, float(np.sqrt(sum(chi2 for chi2, _ in fits) / dof))) if dof else 1.0


def misfit_of(rig: Rig, name: str, part: Eliminated) -> Misfit:
    """Hold a campaign against what is known before it (`rig.earlier`), about the latter's estimate.

    p_value : that chance alone departs as much, in any of the tests made.
    """
    assert rig.earlier is not None
    birge = birge_of([(rig.earlier.chi2, rig.earlier.dof), within(part)])
    known = information_of(rig, rig.earlier).scaled(birge)
    departure = contrast(known, part.information.scaled(birge))
    return _named(rig, name, departure, _probability(rig, departure))


def _probability(rig: Rig, departure: Contrast) -> float:
    """Of as large a departure by chance: any single sensor's turn, or all together (Bonferroni)."""
    tested = [departure.chi2(), *(departure.chi2(_turn_of(i)) for i in range(rig.n))]
    return min(1.0, len(tested) * min(map(p_value, tested)))


def _named(rig: Rig, name: str, departure: Contrast, p: float) -> Misfit:
    best = max(range(rig.n), key=lambda i: departure.chi2(_turn_of(i))[0])
    turn, _ = departure.change(_turn_of(best))
    return Misfit(name, rig.supports[best], turn, p)


def _turn_of(sensor: int) -> slice:
    """Place of a sensor's rotation among the constants."""
    return slice(3 * sensor, 3 * sensor + 3)
