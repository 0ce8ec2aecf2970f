"""A calibration in use: by which rig, how old its zeros are, the wrenches as a log passes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from tdfscal.catalogue import rigs_apart
from tdfscal.checks.calibrated_rig import Inspection, contradictions, other_papers
from tdfscal.commands.campaign import PathLike, PathLikes, measured, no_log, resolve, stated_date
from tdfscal.commands.log_pass import LogPass, Settings, delay_of
from tdfscal.commands.result import Calibration, CalibrationSource, read_source
from tdfscal.dwells.dwell_means import Thermometer
from tdfscal.errors import DataError, RigError, TdfscalError, UsageError
from tdfscal.files.calibration.compared import defects
from tdfscal.files.calibration.document import Calibration as CalibrationFile
from tdfscal.files.calibration.parameters import calibrated
from tdfscal.files.calibration.parts import MeasuredResult, seconds
from tdfscal.findings import Finding, Value
from tdfscal.frozen import record, replace
from tdfscal.model.calibrated import Calibrated, about_point
from tdfscal.model.postures import ZeroAge
from tdfscal.model.samples_in_motion import Samples, Tally, aligned
from tdfscal.records import CampaignInfo, FloatArray, Rig, by_wall_clock
from tdfscal.wrench.contact_wrench import Wrenches, at_rest, in_motion, unknown_components
from tdfscal.wrench.wrench_noise import (
    LogHead,
    ZeroVariance,
    flicker,
    flicker_level,
    moved_zeros,
    take_head,
)


def require_agreement(calibrated: Rig, given: Rig, where: str) -> None:
    """Raise UsageError where a rig, of the file `where`, is not the one that was calibrated."""
    if found := contradictions(calibrated, given):
        raise UsageError(rigs_apart(found, "rig-uncalibrated"), where=where)


@record
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


def zero_epoch(c: CalibrationFile) -> ZeroEpoch:
    """Tell it from a calibration file."""
    told = max((m.record() for m in _recorded(c)), key=lambda when: when.begin)
    exact, begin = told.source == "log", None if told.source == "file" else told.begin
    span, dwell, temperature = 0.0, 0.0, None
    averaged = any(recorder.rows == "postures" for recorder in c.rig.log or ())
    if c.postures is not None and c.postures.start and not averaged:
        start, end = np.array(c.postures.start), np.array(c.postures.end)
        span, dwell = float(end.max() - start.min()), float(np.median(end - start))
        begin = float(start.min()) if exact else begin
        if c.dwells is not None and c.dwells.temperature is not None:
            temperature = c.dwells.temperature[min(c.postures.index)]
    elif c.motion is not None:
        span = c.motion.seconds
    elif exact:
        span = told.end - told.begin
    return ZeroEpoch(begin, exact, span, dwell, temperature)


@dataclass(slots=True, kw_only=True)
class LogInUse(LogPass):
    """A calibration with the logs that it is used on, and what one reading of them leaves behind.

    name : of its file, for messages. given : with the inertia and the declared uncertainties of
    the logs' rig, moments about a point (3,), m, LCS. known : what a user must know first.
    """

    name: str
    calibration: Calibration
    given: Calibrated
    point: FloatArray = field(default_factory=lambda: np.zeros(3))
    known: tuple[Finding, ...] = ()
    tally: Tally = field(default_factory=Tally)
    thermometer: Thermometer = field(default_factory=Thermometer)
    inspection: Inspection = field(init=False)

    def __post_init__(self) -> None:
        self.inspection = Inspection(self.given)
        self.given = about_point(self.given, self.point)

    @property
    def reading_noise(self) -> float:
        """Noise of a reading, N per axis, as the calibration's own residuals show it; 0 unknown."""
        fit = self.calibration.fit
        # The residual force of a posture is the sum of n readings, three axes each.
        return 0.0 if fit is None else float(fit.rms_force / np.sqrt(3 * self.given.rig.n))

    @property
    def posture_std(self) -> float:
        """Noise of a force at a posture, N per axis, as the calibration's own residuals show it."""
        fit = self.calibration.fit
        if fit is None or fit.dof <= 0:
            return 0.0
        return self.reading_noise * float(np.sqrt(max(6 * fit.postures / fit.dof, 1.0)))

    @property
    def excess_variance(self) -> float:
        """Of a force at a posture, N² per axis, beyond what the logs' rig file declares."""
        return self.posture_std**2 - self.rig.declared.force_noise**2

    def passing(self) -> tuple[LogHead, Iterator[Samples]]:
        """Begin to read: the beginning, and the samples from their first on. Raises DataError."""
        self.progress("reading the log and working out the contact wrench")
        pieces = aligned(self.thermometer.passing(self.pieces()), self.tally)
        watched, averaged = self.inspection.watch(pieces), self.campaign.rig.averaged
        head, samples = take_head(watched, self.rig.supports, averaged=averaged)
        if head is None:
            raise DataError(
                "there is no instant at which every NCP's position and force are known",
                where=", ".join(map(str, self.campaign.logs)),
                hint="check that all streams were recorded at the same time",
            )
        return head, samples

    def wrenches(self, samples: Iterable[Samples]) -> Iterator[Wrenches]:
        """Work out the contact wrenches."""
        return (at_rest if self.given.rig.inertia is None else in_motion)(self.given, samples)

    def zero_age(self, first: float, temperature: FloatArray | None) -> ZeroAge:
        """Age of the zeros at the log's first time, s of its clock; temperature (n,), °C, there.

        Where no clock or date tells, a log is taken for recorded just after the calibration's.
        """
        epoch, date, warming = zero_epoch(self.calibration), self.rig.campaign.date, 0.0
        if temperature is not None and epoch.temperature is not None:
            warming = float(temperature.mean()) - epoch.temperature
        if self.campaign.rig.averaged:
            return ZeroAge(0.0, warming, known=False)
        clock = by_wall_clock(first)
        now = first if clock else stated_date(date).begin if date is not None else None
        if epoch.begin is None or now is None:
            return ZeroAge(epoch.span, warming, known=False)
        if clock and epoch.exact:
            return ZeroAge(now - epoch.begin, warming)
        # Dates tell the day; the log is another one than the calibration's.
        return ZeroAge(max(abs(now - epoch.begin), epoch.span), warming)

    def zeros(self, head: LogHead) -> tuple[ZeroAge, ZeroVariance | None]:
        """Age of the zeros at a log's first sample, and the variance of 1/f noise since they held.

        With temperatures where zeros move with these.
        """
        start, epoch = float(head.samples.time[0]), zero_epoch(self.calibration)
        first = self.temperatures(np.array([start]))
        age = self.zero_age(start, None if first is None else first[0])
        level = flicker_level(head, self.rig.axes, self.excess_variance, epoch.span, epoch.dwell)
        return age, flicker(level, start, age, epoch.span)

    def moved_zeros(self, head: LogHead) -> tuple[ZeroAge, ZeroVariance | None]:
        """Age of the zeros, and the variance by which they may have moved since, drift included."""
        age, slow = self.zeros(head)
        declared = moved_zeros(self.rig.drift, float(head.samples.time[0]), age, self.temperatures)
        if declared is None or slow is None:
            return age, declared or slow
        return age, lambda time: np.asarray(declared(time) + slow(time))

    def temperatures(self, time: FloatArray) -> FloatArray | None:
        """Temperature (N, n), °C, at times (N,), s, where zeros move with it; else None."""
        n = self.rig.n
        return self.thermometer.at(time, time, n) if self.rig.drift.temperature > 0 else None

    def before_calibration(self) -> tuple[Finding, ...]:
        """Say so where the log was recorded before any of the calibration's data."""
        when = MeasuredResult.of(measured(self))
        dated = _recorded(self.calibration)
        begin = min((m.begin for m in dated), key=seconds)
        told = "file" not in (when.source, *(m.source for m in dated))
        if not told or seconds(when.end) >= seconds(begin):
            return ()
        digits = 10 if when.end[:10] < begin[:10] else 16
        log, calibration = (time[:digits].replace("T", " ") for time in (when.end, begin))
        values: dict[str, Value] = {"log": log, "calibration": calibration}
        return (Finding("log-before-calibration", values=values),)

    def touched(self) -> Iterator[Finding]:
        """Name the stretches of a motion with a wrench that the model does not know, s after begin.

        They are found as `validate` finds them, in a second reading of the log.
        """
        from tdfscal.validation.in_motion import validate_moving

        with suppress(TdfscalError):  # too short a motion, as a rule, to tell of it
            slow = LogPass(self.campaign, self.settings).moving()
            for found in validate_moving(self.given, slow, delay_of(self.campaign.rig)).findings:
                if found.code == "stretch-touched":
                    span = np.array([found.values["begin"], found.values["end"]], float)
                    begin, end = (span - slow.time[0]).tolist()
                    values = {**found.values, "begin": begin, "end": end}
                    yield replace(found, code="path-touched", values=values)

    def findings(self) -> list[Finding]:
        """What a log that has passed says of itself, what was left out, what stays unknown."""
        found = [*self.known, *self.messages, *self.inspection.finish()]
        with suppress(DataError, RigError):  # a clock that is set wrong dates nothing
            found += self.before_calibration()
        for code, left_out in (
            ("samples-uncovered", self.tally.uncovered),
            ("samples-unreadable", self.tally.unreadable),
        ):
            found += [Finding(code, size=left_out)] if left_out else []
        if not self.given.rig.axes.all():
            found.append(Finding("wrench-in-part", unknown_components(self.given)))
        if self.given.open.any():
            found.append(Finding("calibration-open"))
        return found


def take(
    calibration: CalibrationSource,
    paths: PathLikes,
    rig: PathLike | None,
    settings: Settings,
    point: Sequence[float] = (0.0, 0.0, 0.0),
) -> LogInUse:
    """Load a calibration and find the logs to use it on, with their rig.

    The rig is that of the campaign folder, or `rig`, else the one that the calibration embeds.
    point : of the LCS, m, that moments are about.

    Raises UsageError where that rig contradicts the calibrated one, or there is no log; else as
    `load_calibration` and `resolve`.
    """
    name, loaded = read_source(calibration)
    embedded = loaded.rig.loaded(name)  # not its campaign: the logs are of another
    document = {**embedded.document, "campaign": None}
    own = replace(embedded, rig=replace(embedded.rig, campaign=CampaignInfo()), document=document)
    campaign = resolve(paths, rig, fallback=own)
    if not campaign.logs:
        raise no_log(paths)
    given, other = calibrated(loaded), campaign.rig.rig
    require_agreement(given.rig, other, str(campaign.rig.path))
    papers = other_papers((name, given.rig), (str(campaign.rig.path), other))
    return LogInUse(
        campaign,
        settings,
        name=name,
        calibration=loaded,
        given=replace(
            given, rig=replace(given.rig, inertia=other.inertia, declared=other.declared)
        ),
        point=np.array(point),
        known=(*defects(name, loaded, other if other.sensors else None), *papers),
    )


def _recorded(c: CalibrationFile) -> tuple[MeasuredResult, ...]:
    """When its data, and those of its campaigns, were recorded."""
    return (c.measured, *(campaign.measured for campaign in c.campaigns))
