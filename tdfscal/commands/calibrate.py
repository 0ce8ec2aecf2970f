"""`calibrate`: from a campaign's files to a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np

from tdfscal.acceptance import assess_stated, judge
from tdfscal.catalogue import sentence
from tdfscal.commands import options
from tdfscal.commands.campaign import (
    PathLike,
    campaign_folders,
    listed,
    measured,
    misdated,
    resolve,
)
from tdfscal.commands.log_pass import (
    LogPass,
    Settings,
    delay_of,
    drafted,
    where_few,
    with_delay,
)
from tdfscal.commands.options import Option, silent, window
from tdfscal.commands.result import Calibration
from tdfscal.dwells.find import no_dwell
from tdfscal.errors import NotConvergedError, NotIdentifiableError, TdfscalError, UsageError
from tdfscal.estimation.observability import ENOUGH
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES
from tdfscal.files.calibration.from_results import Provenance, from_self
from tdfscal.files.calibration.parts import MeasuredResult, Method
from tdfscal.findings import Finding
from tdfscal.motioncal.preparation import with_moves
from tdfscal.motioncal.streams import Slow
from tdfscal.records import Dwells, Rig
from tdfscal.selfcal.pipeline import Estimator, SelfCalibration, self_calibrate

if TYPE_CHECKING:
    from tdfscal.motioncal.pipeline import MotionCalibration
    from tdfscal.trackercal.pipeline import TrackerCalibration


Samples = Literal["static", "moving", "all"]
Own: TypeAlias = "SelfCalibration | MotionCalibration"


@options.command("calibrate campaign -o calibration.yaml --html report.html")
def calibrate(
    paths: options.Paths,
    *,
    rig: options.RigFile = None,
    method: Annotated[
        Method | None, Option("default: self where there is a log, else tracker")
    ] = None,
    samples: Annotated[
        Samples | None,
        Option("static dwells, or moving samples; default: static where there are dwells enough"),
    ] = None,
    estimator: Annotated[
        Estimator, Option("maximum likelihood, or the paper's linear method")
    ] = "ml",
    from_: options.Begin = None,
    to: options.End = None,
    trials: options.Trials = None,
    output: Annotated[
        PathLike | None,
        options.written(
            "file to write",
            *CALIBRATION_SUFFIXES,
            default=Path("calibration.yaml"),
            shell="default calibration.yaml here; - for stdout",
        ),
    ] = None,
    html: options.Page = None,
    allow_rejected: options.AllowRejected = False,
    progress: options.Telling = silent,
    command: str = "",
) -> Calibration:
    """Calibrate the sensors of a rig from a recorded campaign.

    The result may be rejected: look at `.status` and `.findings`.
    """
    groups = campaign_folders(paths, rig)
    _check(method, samples, estimator, several=len(groups) > 1)
    settings = Settings(progress, window(from_, to), trials=trials, command=command)
    log = None
    try:
        if len(groups) > 1:
            from tdfscal.commands.several_campaigns import calibrate_several

            return calibrate_several(groups, settings)
        # A joint result has intervals of its own; trials of its parts would be thrown away.
        own = replace(settings, trials=0) if method == "joint" else settings
        log = LogPass(resolve(groups[0], rig), own)
        if method is None and not log.campaign.logs:
            method, log.messages = "tracker", [*log.campaign.lost_log]
        return _calibrated(log, method or "self", samples, estimator)
    except (NotIdentifiableError, NotConvergedError) as error:
        if html is None:
            raise
        log = log or LogPass(resolve(groups[-1], rig), settings)
        raise _with_page(error, log, listed(paths), Path(html)) from error


def _check(
    method: Method | None, samples: Samples | None, estimator: Estimator, *, several: bool
) -> None:
    """Raise UsageError for what cannot be asked for together."""
    if samples in ("moving", "all") and (method in ("tracker", "joint") or estimator == "linear"):
        raise UsageError(
            f"--samples {samples} goes with neither --method tracker or joint, nor --estimator "
            "linear: these need static dwells alone",
            hint="leave one of the two out",
        )
    if several and (samples or estimator != "ml" or method == "tracker"):
        raise UsageError(
            "--samples, --estimator linear and --method tracker take one campaign",
            hint="leave them out, or calibrate the campaigns one by one and compare them",
        )


def _calibrated(
    log: LogPass, method: Method, samples: Samples | None, estimator: Estimator
) -> Calibration:
    """Calibrate from one campaign: its log, its survey, or both."""
    campaign, settings = log.campaign, log.settings
    own_rng, tracker_rng = np.random.default_rng(0).spawn(2)
    notes = drafted([campaign.rig])
    own = None
    if method != "tracker":
        if not campaign.logs:
            raise UsageError(
                "there is no log for a self-calibration",
                where=str(campaign.rig.path.parent),
                hint="name a log, or use --method tracker",
            )
        if method == "joint" or estimator == "linear":
            samples = "static"
        with log.explaining():
            own = calibrate_samples(log, samples, estimator, own_rng)
        notes += misdated(log)
        if method == "self":
            if log.stops and own.reasons and not isinstance(own, SelfCalibration):
                notes.append(log.stops)  # it may have been meant to rest
            return Calibration.of(from_self(own, origin_of(log), notes))
    from tdfscal.commands.recordings import surveyed

    log.progress("calibrating from the tracker's survey")
    tracker, remarks = surveyed(log, settings.trials, tracker_rng)
    assert own is None or isinstance(own, SelfCalibration)
    if own is None:
        notes += log.messages
    return _with_survey(log.rig, own, tracker, origin_of(log), [*notes, *remarks])


_AT_REST = (
    "--method joint, --estimator linear and --samples static take dwells alone: leave the option "
    "out to calibrate from the motion, and compare that with --method tracker"
)


def calibrate_samples(
    log: LogPass, samples: Samples | None, estimator: Estimator, rng: np.random.Generator
) -> Own:
    """Calibrate from the samples that are asked for, or from those that serve.

    samples : None takes the dwells where there are enough, else the motion.
    rng : of the Monte Carlo.

    Raises DataError, NotIdentifiableError, NotConvergedError, UsageError.
    """
    if samples == "all":
        return _all(log, estimator, rng)
    if samples == "moving":
        return _moving(log, log.moving(), rng=rng)
    dwells, slow = log.samples(samples)
    if samples == "static" and not len(dwells):
        error = no_dwell(dwells)
        raise error.restated(hint=f"{error.hint}; {_AT_REST}")
    found = calibrate_few(log, dwells, slow, log.rig, rng, NotIdentifiableError)
    if found is not None:
        return found
    own = _static(log, dwells, estimator, rng)
    if slow is None or len(dwells) < ENOUGH or own.reasons or estimator == "linear":
        return own
    expected = with_moves(log.rig, slow, delay_of(log.campaign.rig), own.fit.state)
    return replace(own, with_moves=expected)


def calibrate_few(
    log: LogPass,
    dwells: Dwells,
    slow: Slow | None,
    rig: Rig,
    rng: np.random.Generator | None = None,
    final: type[TdfscalError] | tuple[()] = (),
) -> MotionCalibration | None:
    """Calibrate from a log's motion, by what a rig states; None where its dwells are to be taken.

    final : faults of a motion that few dwells cannot mend.
    Raises DataError, NotIdentifiableError, NotConvergedError where it has no dwell either.
    """
    if slow is None:
        return None
    moving = partial(_moving, log, slow, rig=rig, rng=rng, instead_of=len(dwells))
    return where_few(dwells, ENOUGH, moving, final)


def _static(
    log: LogPass, dwells: Dwells, estimator: Estimator, rng: np.random.Generator
) -> SelfCalibration:
    """Calibrate from dwells."""
    stage, trials = log.progress, log.settings.trials
    stage(f"calibrating from {len(dwells)} dwells")
    return self_calibrate(
        log.rig, dwells, rng=rng, estimator=estimator, max_trials=trials, progress=stage
    )


def _moving(
    log: LogPass,
    slow: Slow,
    dwells: int = 0,
    *,
    rig: Rig | None = None,
    rng: np.random.Generator | None = None,
    instead_of: int = 0,
) -> MotionCalibration:
    """Calibrate from the motion; rng : of the Monte Carlo, None for none.

    dwells : that it takes in. instead_of : those that are too few; one dwell begins any motion.
    """
    from tdfscal.motioncal.pipeline import calibrate_moving

    log.progress("calibrating from the motion")
    found = calibrate_moving(
        rig or log.rig,
        slow,
        delay_of(log.campaign.rig),
        dwells=dwells,
        rng=rng,
        max_trials=log.settings.trials,
        progress=log.progress,
    )
    middle = 0.5 * float(slow.time[0] + slow.time[-1])
    log.clocks = with_delay(log, found.fit.state.moving, found.moving_std, middle)
    # At rest the dwells bring along what the log says of itself.
    told = [finding for finding in log.messages if finding not in found.findings]
    if instead_of > 1:
        told.append(Finding("dwells-few", size=instead_of, values={"enough": ENOUGH}))
    return replace(found, findings=(*found.findings, *told))


def _all(log: LogPass, estimator: Estimator, rng: np.random.Generator) -> Own:
    """The whole log, its rests and its moves, in one estimate with one spectrum of the noise.

    A dwell is a motion at rest (theory, section 8). Where the moves hold what the model does not
    know, or make an angle less certain, the dwells' own result stands, with a word about it.
    """
    dwells, slow = log.samples()
    if slow is None:
        return _static(log, dwells, estimator, rng)
    own = None
    with suppress(NotIdentifiableError):
        if len(dwells):
            own = _static(log, dwells, estimator, rng)
    if own is None:
        return _moving(log, slow, len(dwells), rng=rng)
    try:
        both = _moving(log, slow, len(dwells), rng=rng)
    except TdfscalError as error:
        why = error.what
    else:
        if both.reasons and not own.reasons:
            why = sentence(both.reasons[0])
        elif np.any(both.uncertainty.rpy_std > own.uncertainty.rpy_std):
            why = "they are no more certain"
        else:
            return both
    nothing = Finding("moves-add-nothing", values={"why": why})
    return replace(own, findings=(*own.findings, nothing))


def origin_of(log: LogPass, **more: Any) -> Provenance:
    """Where a calibration comes from, by its campaign; more : what else stands behind it."""
    if "measured" not in more:
        more["measured"] = measured(log)
    given = {"inputs": tuple(log.inputs), "clocks": log.clocks, **more}
    return Provenance(log.campaign.rig, command=log.settings.command, seed=0, **given)


def _with_survey(
    rig: Rig,
    own: SelfCalibration | None,
    tracker: TrackerCalibration,
    origin: Provenance,
    notes: Sequence[Finding],
) -> Calibration:
    """The survey's calibration, or both together, by which the contact wrench is judged."""
    from tdfscal.comparison.compatibility import combine
    from tdfscal.files.calibration.from_results import from_joint, from_tracker
    from tdfscal.model.calibrated import independent

    if own is None:
        given = independent(rig, tracker.rotations.rotation, tracker.rotations.covariance)
        reasons = judge(rig, tracker.rotations, tracker.birge, conformity=assess_stated(given))
        return Calibration.of(from_tracker(tracker, origin, (*reasons, *notes)))
    both = combine(own.rotations, tracker.rotations)
    given = own.estimate.calibrated_at(both.rotations.covariance, both.rotations.rotation)
    # Of the contact wrench both methods together judge anew.
    mine_alone = [f for f in own.findings if f.code != "contact-uncertain"]
    found = [f for f in mine_alone if f.rejects]
    found += judge(rig, tracker.rotations, tracker.birge, conformity=assess_stated(given))
    if not both.test.verified:
        found.append(replace(both.test.finding, code="methods-disagree", subject=(), rejects=True))
    found += [*notes, *(f for f in mine_alone if not f.rejects), *tracker.findings]
    return Calibration.of(from_joint(both, own, tracker, origin, found))


def _with_page(
    error: NotIdentifiableError | NotConvergedError, log: LogPass, paths: Sequence[Path], page: Path
) -> TdfscalError:
    """Write the page of an error that says the data do not give the angles; let it name the page.

    log : as far as it was read; not at all where there are several campaigns.
    """
    from tdfscal.catalogue import told
    from tdfscal.files.outputs import appear_now
    from tdfscal.files.saving import write_text
    from tdfscal.reporting.html import render
    from tdfscal.reporting.undetermined import Attempt, undetermined_report

    log.progress("drawing the report")
    said, where = tuple(map(told, log.messages)), tuple(map(str, paths))
    rig, command = log.campaign.rig, log.settings.command
    when = MeasuredResult.of(measured(log)) if log.inputs else None
    attempt = Attempt(error, rig, tuple(log.inputs), said, where, command, when)
    write_text(page, render(undetermined_report(attempt)))
    appear_now()
    look = f"{page} shows what is weak and what the log holds"
    return error.restated(hint=". ".join(filter(None, (error.hint, look))))
