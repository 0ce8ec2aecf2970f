"""Months of one rig: zeros drawn anew each month, angles that walk or step."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdfscal.comparison.control_chart import Alarm
from tdfscal.comparison.history import life_of
from tdfscal.comparison.members import Recorded
from tdfscal.comparison.pooling import Pool
from tdfscal.model.statics import postures
from tdfscal.numerics import so3
from tdfscal.records import FloatArray, Rig
from tdfscal.simulation import Options
from tdfscal.simulation.campaign import record_means
from tdfscal.simulation.equilibrium import set_stage, settle, stand

Step = tuple[int, int, tuple[float, float, float]]
"""Month, sensor, turn in rad, BCS."""


def history(
    rig: Rig,
    rng: np.random.Generator,
    *,
    months: int,
    postures_each: int | Sequence[int] = 5,
    walk: float = 0.0,
    zero: float = 0.5,
    steps: Sequence[Step] = (),
    creep: Sequence[Step] = (),
    heavier: Sequence[float] | FloatArray = (),
    tilt: tuple[float, float] = (0.0, 0.0),
) -> tuple[list[Recorded], FloatArray]:
    """Campaigns one month apart, and the true rotations (months, n, 3, 3).

    walk : rad per axis and month. creep : from that month on, per month. heavier : per month, kg,
    than in the others. tilt : rad, of gravity about X and Y, in all months.
    """
    sizes = [postures_each] * months if isinstance(postures_each, int) else list(postures_each)
    campaigns: list[Recorded] = []
    truths: list[FloatArray] = []
    first = None
    for month in range(months):
        options = Options(postures=sizes[month], squeeze=200.0)
        stage = set_stage(rig, options, rng.spawn(1)[0], 1)
        if first is None:
            level = so3.exp(np.array([*tilt, 0.0]))
            first = replace(stage.truth, gravity=stage.truth.gravity @ level.T)
        turn = walk * rng.standard_normal((rig.n, 3)) * (month > 0)
        for when, sensor, step in steps:
            turn[sensor] += np.asarray(step) * (when == month)
        for when, sensor, step in creep:
            turn[sensor] += np.asarray(step) * (when <= month)
        R = so3.exp(turn) @ (truths[-1] if truths else first.rotation[0])
        truth = replace(
            first,
            rotation=R[None],
            rpy=so3.to_rpy(R)[None],
            zero=zero * rng.standard_normal(first.zero.shape),
            mass=first.mass + (heavier[month] if len(heavier) else 0.0),
        )
        servo, where = stand(truth, options, stage.postures.target(rig.hinge), stage.repeat)
        rest = settle(truth, where, stage.load, stage.postures.pose)
        stage = replace(stage, truth=truth, servo=servo, rest=rest)
        dwells = record_means(rig, options, stage, rng.spawn(1)[0]).dwells(0)
        campaigns.append(Recorded(f"{month:02d}", float(month), rig, postures(rig, dwells)))
        truths.append(R)
    return campaigns, np.array(truths)


def alarms(pooled: Pool) -> tuple[Alarm, ...]:
    """What has changed on the way."""
    return life_of(pooled.members[-1].recorded.rig, pooled)[0].alarms
