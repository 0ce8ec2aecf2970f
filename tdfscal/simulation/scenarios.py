"""Campaigns by name: the plain ones, and one for each thing that may go wrong."""

from __future__ import annotations

import difflib
from collections.abc import Callable

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.frozen import record, replace
from tdfscal.records import CampaignInfo, FloatArray, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.campaign import Campaign, simulate_campaign
from tdfscal.simulation.faults import (
    Contact,
    Crosstalk,
    DeadAxis,
    Drift,
    Faults,
    Frame,
    Gain,
    Jolt,
    Slip,
    Walk,
    Warming,
    ZeroShift,
)
from tdfscal.simulation.moving_campaign import MovingCampaign, simulate_moving
from tdfscal.simulation.options import MovingOptions, Options, SurveyOptions
from tdfscal.simulation.survey import Survey, simulate_survey
from tdfscal.simulation.truth import UNKNOWN_ZERO, Truth, draw_truths, width

Setup = tuple[Rig, Options]


@record
class Run:
    """A scenario played: the rig as stated, the truth, and what was recorded.

    campaign : None with scenario "tracker" and in motion. survey : None with scenario "months",
    whose run is that of the last month. moving : what never stops, in motion.
    """

    scenario: str
    rig: Rig
    truth: Truth
    campaign: Campaign | None
    survey: Survey | None
    moving: MovingCampaign | None = None


def _with(faults: Callable[[Rig, int], Faults]) -> Callable[[Rig, Options], Setup]:
    """A campaign with faults that the rig file does not declare, by the rig and its postures."""
    return lambda rig, options: (rig, replace(options, faults=faults(rig, options.count)))


def _plain(rig: Rig, options: Options) -> Setup:
    return rig, options


def _contact(rig: Rig, postures: int) -> Faults:
    touched = sorted({postures // 3, (2 * postures) // 3})
    return Faults(
        contacts=tuple(Contact(k, (15.0, -25.0, 40.0), (6.0, 4.0, -3.0)) for k in touched)
    )


def _saturation(rig: Rig, options: Options) -> Setup:
    share = float(rig.mass.value) * rig.gravity / rig.n
    # Leaning shifts a few per cent of the load: some sensors pass 105 % of an even share.
    capacity = np.minimum(rig.capacity, [share, share, 1.05 * share])
    return replace(rig, capacity=capacity), replace(options, faults=Faults(saturated=True))


def _load_cells(rig: Rig, options: Options) -> Setup:
    # The rig file states them; two three-axis sensors at least remain.
    axes = rig.axes.copy()
    axes[max(2, rig.n - 2) :, :2] = False
    return replace(rig, axes=axes), options


def _warming(rig: Rig, postures: int) -> Faults:
    """Zeros that follow the hall by 0.1 to 0.3 N/K, 10 K: 3 N; the temperature is logged."""
    slopes = np.resize([0.3, -0.2, 0.3, -0.3, 0.1, 0.2, 0.1, 0.3, -0.3], (rig.n, 3))
    slope = tuple((float(x), float(y), float(z)) for x, y, z in slopes)
    return Faults(warming=Warming(10.0, slope))


def _soft_supports(rig: Rig, options: Options) -> Setup:
    # Sideways 1 N/µm lies behind the encoders; vertically they are stiff.
    return rig, replace(options, internal=None, stiffness=np.array([1e6, 1e6, 2e7]))


def _no_squeeze(rig: Rig, options: Options) -> Setup:
    # Carriages that float sideways can only carry vertical loads: no yaw is to be seen.
    return rig, replace(options, squeeze=0.0, internal=None, stiffness=np.array([1e3, 1e3, 2e7]))


SCENARIOS: dict[str, Callable[[Rig, Options], Setup]] = {
    "self": _plain,
    "tracker": _plain,
    "contact": _with(_contact),
    "crosstalk": _with(
        lambda rig, postures: Faults(crosstalk=(Crosstalk(0, (0.02, -0.02, 0.02)),))
    ),
    "dead-axis": _with(
        lambda rig, postures: Faults(dead_axes=(DeadAxis(rig.n - 1, 0, postures // 4),))
    ),
    "dead-channel": _with(lambda rig, postures: Faults(dead_axes=(DeadAxis(rig.n - 1, 1),))),
    "drift": _with(
        lambda rig, postures: Faults(
            drifts=(Drift(0, (10.0, -6.0, 15.0)), Drift(1, (-5.0, 8.0, 10.0)))
        )
    ),
    "gain": _with(lambda rig, postures: Faults(gains=(Gain(0, (0.02, -0.01, 0.02)),))),
    "jolt": _with(lambda rig, postures: Faults(jolts=(Jolt(postures // 2, (0.0, 0.0, -300.0)),))),
    "load-cells": _load_cells,
    "no-squeeze": _no_squeeze,
    "saturation": _saturation,
    "slip": _with(
        lambda rig, postures: Faults(slips=(Slip(rig.n - 1, postures // 2, (2e-3, -1e-3, 3e-3)),))
    ),
    "soft-supports": _soft_supports,
    "swapped": _with(lambda rig, postures: Faults(swapped=((0, 1),))),
    "turned-frame": _with(lambda rig, postures: Faults(frames=(Frame(1, (6e-4, -5e-4, 6e-4)),))),
    "walk": _with(lambda rig, postures: Faults(walks=tuple(Walk(k, 1.0) for k in range(rig.n)))),
    "warming": _with(_warming),
    "zero-shift": _with(
        lambda rig, postures: Faults(zero_shifts=(ZeroShift(0, postures // 2, (8.0, -5.0, 12.0)),))
    ),
}
"""What each scenario changes. "self": log and tracker session; "tracker": the session only;
"no-squeeze": vertical loads only; "load-cells": the last sensors, at most two, measure z alone, and
the rig file says so; the others: as "self", with one fault that the rig file does not declare."""


MOVING: dict[str, MovingOptions] = {
    "motion": MovingOptions(),
    "approach": MovingOptions.approach(),
    "stops": MovingOptions.stops(),
}
"""Campaigns of a moving body: "motion", a minute of slow multisine; "approach", 50 mm in 33 s;
"stops", rests and moves by turns."""


def run(
    rig: Rig,
    scenario: str,
    options: Options | MovingOptions,
    rng: np.random.Generator,
    survey: SurveyOptions | None = None,
) -> Run:
    """Play a scenario on a rig, in motion with options of a motion. One seed draws one rig and its
    postures, whatever the scenario.

    Raises UsageError for a scenario that is not in `SCENARIOS`; else as `simulate_campaign` and
    `simulate_moving`.
    """
    campaign_rng, survey_rng = rng.spawn(2)
    stated, home = rig, options.home
    campaign = moving = None
    if isinstance(options, MovingOptions):
        moving = simulate_moving(rig, options, campaign_rng)
        truth = moving.truth
    elif scenario not in SCENARIOS:
        names = [*SCENARIOS, *MOVING, "months"]
        near = difflib.get_close_matches(scenario, names, n=1)
        meant = f"; the nearest one is {near[0]!r}" if near else ""
        raise UsageError(
            f"there is no scenario {scenario!r}{meant}", hint=f"choose from {', '.join(names)}"
        )
    else:
        stated, driven = SCENARIOS[scenario](rig, options)
        if scenario == "tracker":
            truth_rng = campaign_rng.spawn(1)[0].spawn(1)[0]  # the one that a campaign would use
            truth = draw_truths(stated, driven, truth_rng, 1).trial(0)
        else:
            campaign = simulate_campaign(stated, driven, campaign_rng)
            truth = campaign.truth
    surveyed = simulate_survey(stated, truth, survey or SurveyOptions(), survey_rng, home=home)
    return Run(scenario, stated, truth, campaign, surveyed, moving)


#: Month of the last campaign; it lies in the past wherever this is run.
_LAST = (2024, 12)
#: The turn of the one sensor, rad about the BCS axes, and its share of the months before it.
STEP = (0.0, 1.2e-3, 1.6e-3)
_WHEN = 0.7


@record
class Step:
    """A sensor turned before a month's campaign: index of both, turn in rad, BCS."""

    month: int
    sensor: int
    turn: tuple[float, float, float]


@record
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
