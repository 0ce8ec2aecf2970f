"""How old the zeros of a calibration are when a log begins, and how far they may have moved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdfscal.dwells.temperature import Thermometer
from tdfscal.files.calibration.document import Calibration
from tdfscal.model.zero_motion import ZeroAge
from tdfscal.records import FloatArray
from tdfscal.workflows.calibration_in_use import InUse
from tdfscal.workflows.recordings import by_wall_clock, stated
from tdfscal.wrench.log_head import LogHead
from tdfscal.wrench.zero_wander import ZeroVariance, flicker, flicker_level, moved_zeros


@dataclass(frozen=True, slots=True)
class ZeroEpoch:
    """When the zeros of a calibration held: at the first posture of its (last) campaign.

    begin : s since 1970; None where neither log nor rig file tells. exact : the log's clock tells,
    not a date. span, dwell : s, of its postures, and of each of them, typically; 0 unknown.
    temperature : °C, mean over the sensors; None unknown.
    """

    begin: float | None
    exact: bool
    span: float
    dwell: float
    temperature: float | None


def zero_epoch(c: Calibration) -> ZeroEpoch:
    """Tell it from a calibration file."""
    latest = max((m for m in (c.measured, *(k.measured for k in c.campaigns)) if m),
                 key=lambda m: m.record().begin, default=None)  # fmt: skip
    told = latest.record() if latest is not None and latest.source != "file" else None
    exact, begin = told is not None and told.source == "log", told.begin if told else None
    span, dwell, temperature = 0.0, 0.0, None
    averaged = c.rig.log is not None and c.rig.log.rows == "postures"
    if c.postures is not None and c.postures.start and not averaged:
        start, end = np.array(c.postures.start), np.array(c.postures.end)
        span, dwell = float(end.max() - start.min()), float(np.median(end - start))
        begin = float(start.min()) if exact else begin
        if c.dwells is not None and c.dwells.temperature is not None:
            temperature = c.dwells.temperature[min(c.postures.index)]
    elif c.motion is not None:
        span = c.motion.seconds
    elif told is not None and exact:
        span = told.end - told.begin
    return ZeroEpoch(begin, exact, span, dwell, temperature)


def zero_age(use: InUse, first: float, temperature: FloatArray | None) -> ZeroAge:
    """Age of the zeros at a log's first time, s of its clock; temperature (n,), °C, there.

    Where no clock or date tells, a log is taken for recorded just after the calibration's.
    """
    epoch, rig = zero_epoch(use.calibration), use.campaign.rig
    warming = 0.0
    if temperature is not None and epoch.temperature is not None:
        warming = float(temperature.mean()) - epoch.temperature
    if use.campaign.averaged:
        return ZeroAge(0.0, warming, known=False)
    own = rig.path != Path(use.name)  # not the one that the calibration embeds
    date = rig.rig.campaign.date if own else None
    clock = by_wall_clock(first)
    now = first if clock else stated(date).begin if date is not None else None
    if epoch.begin is None or now is None:
        return ZeroAge(epoch.span, warming, known=False)
    if clock and epoch.exact:
        return ZeroAge(now - epoch.begin, warming)
    # Dates tell the day; the log is another one than the calibration's.
    return ZeroAge(max(abs(now - epoch.begin), epoch.span), warming)


def zeros_since(
    use: InUse, head: LogHead, thermometer: Thermometer, posture_std: float
) -> tuple[ZeroAge, ZeroVariance | None]:
    """Age of the zeros at a log's first sample, and the variance by which they may have moved.

    posture_std : N per axis, by which the calibration's postures scatter.
    """
    rig, start = use.campaign.rig.rig, float(head.samples.time[0])
    warm = rig.drift.temperature > 0

    def temperature(time: FloatArray) -> FloatArray | None:
        return thermometer.at(time, time, rig.n) if warm else None

    first = temperature(np.array([start]))
    age = zero_age(use, start, None if first is None else first[0])
    epoch = zero_epoch(use.calibration)
    scatter = posture_std**2 - rig.declared.force_noise**2
    level = flicker_level(head, rig.axes, scatter, epoch.span, epoch.dwell)
    declared = moved_zeros(rig.drift, start, age, temperature)
    slow = flicker(level, start, age, epoch.span)
    if declared is None or slow is None:
        return age, declared or slow
    return age, lambda time: np.asarray(declared(time) + slow(time))
