"""The path that a capability is asked of: a log without contact, or the postures of a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from tdfscal.commands.calibration_in_use import InUse, WrenchPass
from tdfscal.commands.campaign import Campaign
from tdfscal.commands.result import CalibrationSource, read_source
from tdfscal.detection.capability import UNTIMED
from tdfscal.detection.noise import LowPass, MeasuredNoise, measured_noise
from tdfscal.detection.path import Errors, PathPoints, ZeroChange, errors, unexplained
from tdfscal.detection.path import Path as Places
from tdfscal.errors import DataError, UsageError
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.writers.plan import Driven, read_plan
from tdfscal.findings import Finding
from tdfscal.frozen import record
from tdfscal.model.calibrated import Calibrated, about_point
from tdfscal.model.parameters import gravity, sensing
from tdfscal.model.postures import ZeroAge
from tdfscal.model.statics import carrying
from tdfscal.records import FloatArray
from tdfscal.wrench.samples_in_motion import rotations
from tdfscal.wrench.wrench_noise import LogHead, by_sensor

#: Where nothing rests: windows in which slow noise shows, s.
_WINDOW = 60.0


@dataclass(slots=True)
class Largest:
    """Largest components of a wrench (6,), N and N·m, and when, s."""

    size: FloatArray = field(default_factory=lambda: np.zeros(6))
    when: FloatArray = field(default_factory=lambda: np.full(6, np.nan))

    def add(self, time: FloatArray, size: FloatArray) -> None:
        """Take in sizes (N, 6) at times (N,)."""
        if len(time):
            place = np.argmax(size, axis=0)
            new = size[place, np.arange(6)]
            self.when = np.where(new > self.size, time[place], self.when)
            self.size = np.maximum(self.size, new)


@record
class FreePath:
    """A path without contact, with all that stands on the wrench along it.

    given : about the point that moments are about. noise : of the wrench behind a filter of a
    cut-off, Hz. interval : s, between samples; None where no time is known. duration : s.
    age : of the zeros. largest : of the filtered wrench; of a log of stops, at rest, and moved :
    between them. in_motion : the log has no stops.
    """

    use: InUse
    given: Calibrated
    places: Places
    errors: Errors
    noise: Callable[[float | None], MeasuredNoise]
    interval: float | None
    duration: float
    age: ZeroAge
    largest: Largest
    moved: Largest
    in_motion: bool
    findings: tuple[Finding, ...]


def read_path(log: WrenchPass, cutoff: float | None) -> FreePath:
    """Read a log under a calibration, once, in bounded memory.

    Raises DataError where it holds no instant, UsageError for a filter beyond its sampling rate.
    """
    use, averaged = log.use, log.use.campaign.averaged
    points = PathPoints(averaged)
    head, samples = log.read()
    interval = None
    if not averaged and len(head.samples.time) > 1:
        interval = float(np.median(np.diff(head.samples.time)))
    if cutoff is not None and (interval is None or cutoff * interval >= 0.5):
        rate = "its rows are averaged postures" if interval is None else f"{1 / interval:.6g} Hz"
        raise UsageError(
            f"a filter of {cutoff:g} Hz does not suit this log ({rate})",
            where="--filter",
            hint="give a cut-off below half the sampling rate",
        )
    low = LowPass(cutoff, interval or 1.0)
    begun, free, moved = list[tuple[FloatArray, FloatArray]](), Largest(), Largest()
    with np.errstate(all="ignore"):
        for piece in log.wrenches(points.passing(samples)):
            if piece.time[0] <= head.samples.time[-1]:
                begun.append((piece.time, piece.value))
            size = np.abs(low(piece.time, piece.value))
            if len(head.start):  # a log of stops: between them it is driven, not watched
                rests = points.resting(piece.time)
                moved.add(piece.time[~rests], size[~rests])
                free.add(piece.time[rests], size[rests])
            else:
                free.add(piece.time, size)
    places = points.path()
    age, flicker = log.zeros(head)
    zeros = ZeroChange(log.rig.drift, age, log.temperatures(places.time), flicker)
    stand = errors(log.given, places, zeros, _scatter(use, log.given))
    time, value = (np.concatenate(parts) for parts in zip(*begun, strict=True))
    noise = _noise(head, places, stand, time, value)
    duration = UNTIMED if interval is None else points.used * interval
    return FreePath(
        use, log.given, places, stand, noise, interval, duration, age, free, moved,
        not averaged and not len(head.start), tuple(log.findings()),
    )  # fmt: skip


def _noise(
    head: LogHead, places: Places, stand: Errors, time: FloatArray, value: FloatArray
) -> Callable[[float | None], MeasuredNoise]:
    """How the noise behind a filter is measured at the beginning of a log."""
    rest = [] if head.averaged else list(head.dwells(time))
    if not rest and not head.averaged and len(time) > 1:
        value = unexplained(stand, places, time, value)

    @cache
    def measured(cutoff: float | None) -> MeasuredNoise:
        if head.averaged:
            return measured_noise(time[:0], value[:0], [], None)
        return measured_noise(time, value, rest, cutoff, window=_WINDOW, degree=0)

    return measured


def planned_path(
    calibration: CalibrationSource, paths: list[Path], point: FloatArray
) -> FreePath | None:
    """Take the postures or the motion of a plan for the path; None where no plan is named.

    Raises UsageError, DataError.
    """
    if len(paths) != 1 or (driven := read_plan(paths[0])) is None:
        return None
    name, loaded = read_source(calibration)
    rig = loaded.loaded_rig(name)
    given = about_point(calibrated(loaded), point)
    if driven.position.shape[1] != given.rig.n or driven.supports != given.rig.supports:
        raise DataError(
            "the plan is of another rig", where=str(paths[0]),
            hint=f"plan with the rig of {name}",
        )  # fmt: skip
    use = InUse(name, loaded, given, Campaign(rig, (), surveyed=False), ())
    places = Places(driven.time, driven.position, _readings(given, driven), driven.averaged)
    # Nothing was recorded: its zeros hold, and its samples have no noise.
    stand = errors(given, places, None, _scatter(use, given))

    def none(cutoff: float | None) -> MeasuredNoise:
        return measured_noise(np.zeros(0), np.zeros((0, 6)), [], None)

    duration = UNTIMED if places.averaged else float(np.ptp(places.time))
    return FreePath(
        use, given, places, stand, none, None, duration, ZeroAge(known=False),
        Largest(), Largest(), False, (),
    )  # fmt: skip


def _scatter(use: InUse, given: Calibrated) -> FloatArray:
    """Variance (6,) of the wrench at a posture beyond what the rig file declares."""
    each = by_sensor(given)
    excess = max(use.posture_std**2 - given.rig.declared.force_noise**2, 0.0)
    return np.asarray(excess * each.sum(axis=0))


def _readings(given: Calibrated, driven: Driven) -> FloatArray:
    """Readings (K, n, 3), N, of the sensors at the postures of a plan."""
    state = given.state
    R = rotations(state.hinge, driven.position - state.datum)
    weight = state.mass * gravity(state, given.rig.gravity)
    middle = state.hinge.mean(axis=0)
    arm, arm_m = (
        (place - middle) @ np.swapaxes(R, 1, 2) for place in (state.hinge, state.barycentre[None])
    )
    force = carrying(arm, arm_m[:, 0], weight) + driven.squeeze
    return np.asarray(np.linalg.solve(sensing(state), force[..., None])[..., 0] + state.zero)
