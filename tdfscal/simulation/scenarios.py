"""Campaigns by name: the plain ones, and one for each thing that may go wrong."""

from __future__ import annotations

import difflib
from collections.abc import Callable

import numpy as np

from tdfscal.errors import UsageError
from tdfscal.frozen import record, replace
from tdfscal.records import CampaignInfo, Rig
from tdfscal.simulation import rotations
from tdfscal.simulation.campaign import Campaign, simulate_campaign
from tdfscal.simulation.faults import (
    Contact,
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
from tdfscal.simulation.truth import (
    UNKNOWN_ZERO,
    Survey,
    Truth,
    draw_truths,
    simulate_survey,
    width,
)


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


#: Faults that the rig file does not declare, by the numbers of supports and postures.
_FAULTS: dict[str, Callable[[int, int], Faults]] = {
    "contact": lambda n, K: Faults(
        contacts=tuple(
            Contact(k, (15.0, -25.0, 40.0), (6.0, 4.0, -3.0)) for k in sorted({K // 3, 2 * K // 3})
        )
    ),
    "crosstalk": lambda n, K: Faults(gains=(Gain(0, crosstalk=(0.02, -0.02, 0.02)),)),
    "dead-axis": lambda n, K: Faults(dead_axes=(DeadAxis(n - 1, 0, K // 4),)),
    "dead-channel": lambda n, K: Faults(dead_axes=(DeadAxis(n - 1, 1),)),
    "drift": lambda n, K: Faults(
        drifts=(Drift(0, (10.0, -6.0, 15.0)), Drift(1, (-5.0, 8.0, 10.0)))
    ),
    "gain": lambda n, K: Faults(gains=(Gain(0, (0.02, -0.01, 0.02)),)),
    "jolt": lambda n, K: Faults(jolts=(Jolt(K // 2, (0.0, 0.0, -300.0)),)),
    "slip": lambda n, K: Faults(slips=(Slip(n - 1, K // 2, (2e-3, -1e-3, 3e-3)),)),
    "swapped": lambda n, K: Faults(swapped=((0, 1),)),
    "turned-frame": lambda n, K: Faults(frames=(Frame(1, (6e-4, -5e-4, 6e-4)),)),
    "walk": lambda n, K: Faults(walks=tuple(Walk(k, 1.0) for k in range(n))),
    # Zeros follow the hall by 0.1 to 0.3 N/K, 10 K: 3 N; the temperature is logged.
    "warming": lambda n, K: Faults(
        warming=Warming(10.0, np.resize([0.3, -0.2, 0.3, -0.3, 0.1, 0.2, 0.1, 0.3, -0.3], (n, 3)))
    ),
    "zero-shift": lambda n, K: Faults(zero_shifts=(ZeroShift(0, K // 2, (8.0, -5.0, 12.0)),)),
}


def _load_cells(rig: Rig, options: Options) -> tuple[Rig, Options]:
    # The rig file states them; two three-axis sensors at least remain.
    axes = rig.axes.copy()
    axes[max(2, rig.n - 2) :, :2] = False
    return replace(rig, axes=axes), options


def _no_squeeze(rig: Rig, options: Options) -> tuple[Rig, Options]:
    # Carriages that float sideways can only carry vertical loads: no yaw is to be seen.
    return rig, replace(options, squeeze=0.0, internal=None, stiffness=np.array([1e3, 1e3, 2e7]))


def _saturation(rig: Rig, options: Options) -> tuple[Rig, Options]:
    share = float(rig.mass.value) * rig.gravity / rig.n
    # Leaning shifts a few per cent of the load: some sensors pass 105 % of an even share.
    capacity = np.minimum(rig.capacity, [share, share, 1.05 * share])
    return replace(rig, capacity=capacity), replace(options, faults=Faults(saturated=True))


def _soft_supports(rig: Rig, options: Options) -> tuple[Rig, Options]:
    # Sideways 1 N/µm lies behind the encoders; vertically they are stiff.
    return rig, replace(options, internal=None, stiffness=np.array([1e6, 1e6, 2e7]))


#: Other machines: "no-squeeze", vertical loads only; "load-cells", of which the last, at most two,
#: measure z alone, and the rig file says so.
_MACHINES = {
    "load-cells": _load_cells,
    "no-squeeze": _no_squeeze,
    "saturation": _saturation,
    "soft-supports": _soft_supports,
}
SCENARIOS = ("self", "tracker", *sorted((*_FAULTS, *_MACHINES)))
"""Campaigns at rest. "self": log and tracker session; "tracker": the session only; the others: as
"self", with one fault or on another machine."""


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
    """Play a scenario on a rig, in motion with options of a motion. One seed draws one truth
    (mounting, zeros, gain, load), whatever the scenario; at rest its postures too.

    Raises UsageError for a scenario that is not in `SCENARIOS`; else as `simulate_campaign` and
    `simulate_moving`.
    """
    campaign_rng, survey_rng = rng.spawn(2)
    stated, campaign, moving = rig, None, None
    if isinstance(options, MovingOptions):
        truth = _truth(rig, options.machine, campaign_rng).trial(0)
        moving = simulate_moving(rig, options, campaign_rng, truth)
    elif scenario not in SCENARIOS:
        names = [*SCENARIOS, *MOVING, "months"]
        near = difflib.get_close_matches(scenario, names, n=1)
        meant = f"; the nearest one is {near[0]!r}" if near else ""
        raise UsageError(
            f"there is no scenario {scenario!r}{meant}", hint=f"choose from {', '.join(names)}"
        )
    elif scenario == "tracker":
        truth = _truth(rig, options, campaign_rng).trial(0)
    else:
        driven = options
        if scenario in _MACHINES:
            stated, driven = _MACHINES[scenario](rig, options)
        elif scenario in _FAULTS:
            driven = replace(options, faults=_FAULTS[scenario](rig.n, options.count))
        campaign = simulate_campaign(stated, driven, campaign_rng)
        truth = campaign.truth
    survey = survey or SurveyOptions()
    surveyed = simulate_survey(stated, truth, survey, survey_rng, home=options.home)
    return Run(scenario, stated, truth, campaign, surveyed, moving)


def _truth(rig: Rig, options: Options, campaign_rng: np.random.Generator) -> Truth:
    """The one trial that `simulate_campaign` would draw of this generator."""
    return draw_truths(rig, options, campaign_rng.spawn(1)[0].spawn(1)[0], 1)


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


def simulate_months(
    rig: Rig, options: Options, rng: np.random.Generator, months: int
) -> tuple[list[Run], tuple[Step, ...]]:
    """Simulate a campaign a month, and return what happened between them.

    The angles walk with the rig's `drift.angle`, and the second sensor turns once. The first
    month's truth is that of `run` by the same seed; each month's zeros are drawn anew with their
    stated standard deviation. Load and everything else of the rig stay.
    """
    steps = (Step(int(_WHEN * months), 1, STEP),) if months > 1 else ()
    truth_rng, zero_rng, walk_rng, *month_rngs = rng.spawn(3 + months)
    truth = _truth(rig, options, truth_rng)
    spread = width(rig.zero.std, UNKNOWN_ZERO)
    runs = []
    for month in range(months):
        if month:
            turn = rig.drift.angle * walk_rng.standard_normal((rig.n, 3))
            for step in steps:
                turn[step.sensor] += np.asarray(step.turn) * (step.month == month)
            rotation = rotations.exp(turn) @ truth.rotation
            zero = rig.zero.value + spread * zero_rng.standard_normal((1, rig.n, 3))
            truth = replace(truth, rotation=rotation, rpy=rotations.to_rpy(rotation), zero=zero)
        year, of_year = divmod(12 * _LAST[0] + _LAST[1] + month - months, 12)
        dated = replace(rig, campaign=CampaignInfo(date=f"{year}-{of_year + 1:02d}-15"))
        played = simulate_campaign(dated, options, month_rngs[month], truth)
        runs.append(Run("months", dated, played.truth, played, None))
    return runs, steps
