"""The life of a rig: a campaign a month, zeros anew, angles that walk, one sensor turned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdfscal.records import CampaignInfo, FloatArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.campaign import Campaign, simulate_campaign
from tdfscal.simulation.options import Options
from tdfscal.simulation.truth import UNKNOWN_ZERO, Truth, draw_truths, width

#: Month of the last campaign; it lies in the past wherever this is run.
_LAST = (2024, 12)
#: The turn of the one sensor, rad about the BCS axes, and its share of the months before it.
STEP = (0.0, 1.2e-3, 1.6e-3)
_WHEN = 0.7


@dataclass(frozen=True, slots=True)
class Step:
    """A sensor turned before a month's campaign: index of both, turn in rad, BCS."""

    month: int
    sensor: int
    turn: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Months:
    """Campaigns of one rig, a month apart. dates : their days. steps : what happened between."""

    campaigns: tuple[Campaign, ...]
    dates: tuple[str, ...]
    steps: tuple[Step, ...]


def simulate_months(
    rig: Rig,
    options: Options,
    rng: np.random.Generator,
    months: int,
    *,
    unchanged: bool = False,
) -> Months:
    """Simulate a campaign a month; the angles walk with the rig's `drift.angle`.

    Zeros are drawn anew each month with their stated standard deviation; load and everything else
    of the rig stay; the second sensor turns once, if not all is unchanged.
    """
    steps = (Step(int(_WHEN * months), 1, STEP),) if months > 1 and not unchanged else ()
    truth_rng, zero_rng, walk_rng, *month_rngs = rng.spawn(3 + months)
    truth = draw_truths(rig, options, truth_rng, 1)
    spread = width(rig.zero.std, UNKNOWN_ZERO)
    campaigns, dates = [], []
    for month in range(months):
        turn = rig.drift.angle * walk_rng.standard_normal((rig.n, 3)) * (month > 0)
        for step in steps:
            turn[step.sensor] += np.asarray(step.turn) * (step.month == month)
        zero = rig.zero.value + spread * zero_rng.standard_normal((1, rig.n, 3))
        truth = _turned(truth, turn, zero)
        date = _date(month - months + 1)
        dated = replace(rig, campaign=CampaignInfo(date=date))
        campaigns.append(simulate_campaign(dated, options, month_rngs[month], truth))
        dates.append(date)
    return Months(tuple(campaigns), tuple(dates), steps)


def _turned(truth: Truth, turn: FloatArray, zero: FloatArray) -> Truth:
    rotation = rotations.exp(turn) @ truth.rotation
    return replace(truth, rotation=rotation, rpy=rotations.to_rpy(rotation), zero=zero)


def _date(back: int) -> str:
    """The fifteenth of a month, counted from the last."""
    year, month = divmod(12 * _LAST[0] + _LAST[1] - 1 + back, 12)
    return f"{year}-{month + 1:02d}-15"
