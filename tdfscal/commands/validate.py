"""`validate`: does a calibration still hold on a log recorded without contact?"""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

from tdfscal.checks.shared_data import Recorded, readings, repeated_in
from tdfscal.commands import options
from tdfscal.commands.calibration_in_use import LogInUse, take
from tdfscal.commands.campaign import measured, misdated
from tdfscal.commands.log_pass import Settings, delay_of, where_few
from tdfscal.commands.options import Option, silent, window
from tdfscal.commands.recordings import left_out
from tdfscal.commands.result import Calibration, CommandResult, by_column
from tdfscal.files.calibration.compared import files_of, readings_of
from tdfscal.files.calibration.parts import MeasuredResult
from tdfscal.findings import Finding
from tdfscal.frozen import record, replace
from tdfscal.motioncal.streams import Slow
from tdfscal.records import Dwells
from tdfscal.reporting.changes import changes
from tdfscal.reporting.layout import Drawing, Report
from tdfscal.reporting.traceability import Making
from tdfscal.reporting.validation import Origin, validation_document, validation_report
from tdfscal.validation import residual_wrench
from tdfscal.validation.in_motion import MovingValidation, validate_moving
from tdfscal.validation.residual_wrench import AS_STATED, ENOUGH, KnownNoise, Validation
from tdfscal.wrench.contact_wrench import COMPONENTS

Samples = Literal["static", "moving"]


@record(eq=False)
class ValidateResult(CommandResult):
    """Verdict of `validate`.

    validation : the test, with the residual contact wrench of every posture, or over the motion.
    remarks : of the calibration, the log and the test. origin : of what it was made.
    """

    validation: Validation | MovingValidation
    calibration: Calibration
    remarks: tuple[Finding, ...]
    origin: Origin

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has changed, the likeliest first, and what must be known beside it."""
        return (*changes(self.validation), *self.remarks)

    @property
    def holds(self) -> bool:
        """The residual wrenches are what the stated uncertainties explain."""
        return self.validation.holds

    @property
    def exit_status(self) -> int:
        """1 where the calibration does not hold, or never was fit for use."""
        return 0 if self.holds and self.calibration.accepted else 1

    def to_report(self, drawings: tuple[Drawing, ...] = ()) -> Report:
        """Lay out verdict, causes, residual wrenches, what they come from."""
        return validation_report(self.validation, self.remarks, self.origin, drawings)

    def document(self) -> dict[str, Any]:
        """Return the verdict and all residual wrenches as plain JSON values."""
        return validation_document(self.validation, self.remarks, self.origin)

    def table(self) -> dict[str, list[Any]]:
        """One row per posture and component: residual before and after, its std; N, N·m, LCS.

        In motion one row per second: lengths of the residual force and moment, before and after.
        """
        v = self.validation
        if isinstance(v, MovingValidation):
            r = v.residual
            names = "time force_uncalibrated moment_uncalibrated force_calibrated moment_calibrated"
            return by_column(names, zip(r.time, *r.before.T, *r.after.T, strict=True))
        each = zip(v.used, v.nominal, v.calibrated, v.std, strict=True)
        rows = (
            (k, v.dwells.start[k], v.dwells.end[k], *one)
            for k, *parts in each
            for one in zip(COMPONENTS, *parts, strict=True)
        )
        return by_column("dwell start end component uncalibrated calibrated std", rows)

    def drawings(self) -> tuple[Drawing, ...]:
        """Return the figure of the residual wrench, before and after."""
        from tdfscal.reporting.figures.residuals import validated

        return (validated(self.validation),)


@options.command("validate calibration.yaml check --html check.html")
def validate(
    calibration: options.OneCalibration,
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    samples: Annotated[
        Samples | None, Option("default: static where there are three dwells, else moving")
    ] = None,
    from_: options.Begin = None,
    to: options.End = None,
    html: options.Page = None,
    progress: options.Telling = silent,
    command: str = "",
) -> ValidateResult:
    """Check a calibration on postures or on a motion without contact: valid, or what changed."""
    log = take(calibration, paths, rig, Settings(progress, window(from_, to)))
    c = log.calibration
    result: Validation | MovingValidation | None = None
    with log.explaining():
        if samples == "moving":
            result = _by_motion(log, log.moving())
        else:
            dwells, slow = log.samples(samples)
            if slow is not None:
                result = where_few(dwells, ENOUGH, partial(_by_motion, log, slow))
            result = result or _by_postures(log, dwells)
    # What the log says of itself comes with its dwells.
    own = (Finding("log-used-before", (path,)) for path in result.own)
    when, past = MeasuredResult.of(measured(log)), log.before_calibration()
    result = replace(result, earlier=bool(past), gate_rejected=not c.accepted)
    # A motion says its own.
    lost = list[Finding]()
    if isinstance(result, Validation):
        lost = left_out(result.left_out.values(), len(result.dwells))
    found = (*log.known, *misdated(log), *own, *past, *lost, *result.findings)
    origin = Origin(c, log.name, log.campaign.rig, when, Making(command, tuple(log.inputs)))
    return ValidateResult(result, c, found, origin)


def _by_motion(log: LogInUse, slow: Slow) -> MovingValidation:
    log.progress("testing the calibration on the motion")
    found = validate_moving(log.given, slow, delay_of(log.campaign.rig), rig=log.rig)
    span = found.begin, found.begin + found.seconds
    used = [file for one in files_of(log.calibration) for file in one]
    own = (f.path for f in log.inputs if Recorded(f.path, f.sha256, span).meets_any(used))
    return replace(found, own=tuple(own))


def _by_postures(log: LogInUse, dwells: Dwells) -> Validation:
    log.progress(f"testing the calibration on {len(dwells)} dwells")
    age = None
    if len(dwells):
        warm = None if dwells.temperature is None else dwells.temperature[0]
        age = log.zero_age(float(dwells.start[0]), warm)
    fit = None if log.calibration.motion else log.calibration.fit  # that is of samples in motion
    own = _used_before(log, dwells)
    alone = len(dwells) - len(own) < ENOUGH  # too few others to judge by
    found = residual_wrench.validate(
        log.given,
        dwells,
        rig=log.rig,
        noise=log.reading_noise,
        known=AS_STATED if fit is None else KnownNoise(max(1.0, fit.birge), fit.dof),
        age=age,
        aside={} if alone else {k: Finding("posture-used-before", (own[k],)) for k in own},
    )
    return replace(found, own=tuple(dict.fromkeys(own.values())) if alone else ())


def _used_before(log: LogInUse, dwells: Dwells) -> dict[int, str]:
    """Dwells that went into the calibration itself, each with its log.

    By the log's digest and the hours that were used, or by the readings.
    """
    c, rig = log.calibration, log.rig
    used = [file for one in files_of(c) for file in one]
    again = repeated_in(readings_of(c, rig.supports), readings(rig, dwells))
    spans = zip(dwells.start.tolist(), dwells.end.tolist(), strict=True)
    return {
        k: file.path
        for k, (file, span) in enumerate(zip(log.files_at(dwells.end), spans, strict=True))
        if again[k] or Recorded(file.path, file.sha256, span).meets_any(used)
    }
