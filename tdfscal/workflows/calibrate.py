"""`calibrate`: from a campaign's files to a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from tdfscal.acceptance.conformity import assess_stated
from tdfscal.acceptance.gate import judge
from tdfscal.catalogue import told
from tdfscal.catalogue.survey import point_remark
from tdfscal.comparison.joint import combine
from tdfscal.errors import NotConvergedError, NotIdentifiableError, UsageError
from tdfscal.files.calibration.assembled import Provenance
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES, save_calibration
from tdfscal.files.calibration.from_results import from_joint, from_tracker
from tdfscal.files.outputs import PAGE_SUFFIXES, appear_now, check_outputs
from tdfscal.files.rig.draft import unconfirmed_in
from tdfscal.files.saving import write_text
from tdfscal.findings import Finding, Value
from tdfscal.model.calibrated import independent
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.records import InputFile, Rig, Rotations
from tdfscal.selfcal.covariance import joint_posterior
from tdfscal.selfcal.result import Estimator, SelfCalibration
from tdfscal.trackercal import TrackerCalibration
from tdfscal.workflows.arguments import (
    PathLike,
    check_trials,
    listed,
    one,
    window,
)
from tdfscal.workflows.calibration import Calibration, Records, as_calibration
from tdfscal.workflows.campaign import Campaign, campaign_folders, inputs_read, resolve
from tdfscal.workflows.log_pass import LogPass, Settings
from tdfscal.workflows.options import (
    AllowRejected,
    Begin,
    CommandLine,
    End,
    Option,
    Page,
    Paths,
    RigFile,
    Telling,
    Trials,
    command,
)
from tdfscal.workflows.progress import SILENT
from tdfscal.workflows.recordings import measured
from tdfscal.workflows.samples import Own, Samples, calibrate_samples

Method = Literal["self", "tracker", "joint"]


@command("calibrate campaign -o calibration.yaml --html report.html", output="content")
def calibrate(
    paths: Paths,
    *,
    rig: RigFile = None,
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
    from_: Begin = None,
    to: End = None,
    trials: Trials = None,
    output: Annotated[
        PathLike | None,
        Option(
            "file to write; default calibration.yaml here; - for stdout",
            Path,
            "FILE",
            ("--output", "-o"),
            default=Path("calibration.yaml"),
            python="by default none",
        ),
    ] = None,
    html: Page = None,
    allow_rejected: AllowRejected = False,
    command: CommandLine = "tdfscal.calibrate",
    progress: Telling = SILENT,
) -> Calibration:
    """Calibrate the sensors of a rig from a recorded campaign.

    The result may be rejected: look at `.status` and `.findings`.

    Raises
    ------
    UsageError, RigError, DataError, NotIdentifiableError, NotConvergedError
    """
    target, files = one(output), listed(paths)
    page, rig_file = one(html), one(rig)
    _check_samples(samples, method, estimator)
    check_trials(trials)
    check_outputs(
        {"--output": (target, CALIBRATION_SUFFIXES), "--html": (page, PAGE_SUFFIXES)},
        inputs_read(files, rig_file),
    )
    settings = Settings(progress, window(from_, to), trials=trials, command=command)
    groups = campaign_folders(files, rig_file)
    if len(groups) > 1:
        _check_several(method, samples, estimator)
    campaign = resolve(groups[-1], rig_file)
    # A joint result has intervals of its own; trials of its parts would be thrown away.
    log = LogPass(campaign, replace(settings, trials=0) if method == "joint" else settings)
    try:
        if len(groups) > 1:
            from tdfscal.workflows.several_campaigns import calibrate_several  # seldom needed

            result = calibrate_several(groups, settings)
        else:
            result = _calibrated(
                log, method or ("self" if campaign.logs else "tracker"), samples, estimator
            )
    except (NotIdentifiableError, NotConvergedError) as error:
        if page is None or error.exit_status != 4:
            raise
        _write_attempt(error, log, files, page)
        look = f"{page} shows what is weak and what the log holds"
        raise error.restated(hint=f"{error.hint}. {look}" if error.hint else look) from error
    if target is not None and (result.accepted or allow_rejected):
        save_calibration(result, target)
    # Whatever the verdict: its advice is to look at the postures.
    result.save_page(page, progress)
    return result


def _check_samples(samples: Samples | None, method: Method | None, estimator: Estimator) -> None:
    """Raise UsageError where other options need dwells."""
    if samples not in ("moving", "all"):
        return
    if method in ("tracker", "joint") or estimator == "linear":
        other = f"--method {method}" if method in ("tracker", "joint") else "--estimator linear"
        raise UsageError(
            f"{other} does not go with --samples {samples}: it needs static dwells alone",
            hint="leave one of the two out",
        )


def _check_several(method: Method | None, samples: Samples | None, estimator: Estimator) -> None:
    """Raise UsageError for what several campaigns together cannot be asked for."""
    if samples is not None:
        raise UsageError(
            "of several campaigns each gives its dwells, or its motion where these are few",
            where="--samples",
            hint="leave it out, or calibrate the campaigns one by one",
        )
    if estimator != "ml":
        raise UsageError(
            "the paper's linear method takes one campaign",
            where="--estimator",
            hint="calibrate the campaigns one by one, or use ml",
        )
    if method == "tracker":
        raise UsageError(
            "several surveys are not pooled without a log",
            where="--method",
            hint="calibrate the surveys one by one, and compare them",
        )


def _calibrated(
    log: LogPass, method: Method, samples: Samples | None, estimator: Estimator
) -> Calibration:
    campaign, settings = log.campaign, log.settings
    own_rng, tracker_rng = np.random.default_rng(settings.seed).spawn(2)
    inputs: list[InputFile] = []
    notes = _confirmations(campaign)
    own: Own | None = None
    tracker = None
    if method in ("self", "joint"):
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
        inputs += log.inputs
    if method in ("tracker", "joint"):
        from tdfscal.workflows.survey import surveyed  # seldom needed

        log.progress.stage("calibrating from the tracker's survey")
        tracker, files, doubts = surveyed(campaign, settings.trials, tracker_rng)
        notes += map(point_remark, doubts)
        inputs += files

    origin = Provenance(campaign.rig, tuple(inputs), settings.command, settings.seed, measured(log))
    if tracker is None:
        assert own is not None
        if isinstance(own, MotionCalibration) and own.reasons and log.stops:
            notes.append(log.stops)  # it may have been meant to rest
        return as_calibration(own, origin, notes)
    if own is not None:
        assert isinstance(own, SelfCalibration)
        return _both(log.rig, own, tracker, origin, notes)
    given = independent(log.rig, tracker.rotations.rotation, tracker.rotations.covariance)
    reasons = judge(log.rig, tracker.rotations, tracker.birge, conformity=assess_stated(given))
    file = from_tracker(tracker, origin, (*reasons, *notes))
    return Calibration.of(file, Records(tracker=tracker))


def _confirmations(campaign: Campaign) -> list[Finding]:
    """Which lines of a drafted rig file are still to be confirmed."""
    keys = tuple(unconfirmed_in(campaign.rig.path))
    return [Finding("draft-unconfirmed", keys, len(keys))] if keys else []


def _both(
    rig: Rig,
    own: SelfCalibration,
    tracker: TrackerCalibration,
    origin: Provenance,
    notes: Sequence[Finding],
) -> Calibration:
    """Combine two calibrations; the contact wrench is judged with both, not with either."""
    mine = Rotations(rig.supports, own.fit.state.rotation, own.uncertainty.covariance)
    both = combine(mine, tracker.rotations)
    given = joint_posterior(own.fit, both.rotations.covariance, both.rotations.rotation)
    mine_alone = [f for f in own.findings if f.code != "contact-uncertain"]
    reasons = [f for f in mine_alone if f.rejects]
    reasons += judge(rig, tracker.rotations, tracker.birge, conformity=assess_stated(given))
    if not both.test.verified:
        verdict: dict[str, Value] = {"verdict": both.test.verdict}
        p_value = both.test.p_value
        reasons.append(Finding("methods-disagree", p_value=p_value, values=verdict, rejects=True))
    others = [f for f in mine_alone if not f.rejects]
    found = (*reasons, *notes, *others, *tracker.findings)
    file = from_joint(both, own, tracker, origin, found)
    return Calibration.of(file, Records(own, tracker, both))


def _write_attempt(
    error: NotIdentifiableError | NotConvergedError,
    log: LogPass,
    paths: Sequence[Path],
    page: Path,
) -> None:
    """Write the page of an error that says the data do not give the angles.

    log : as far as it was read; not at all where there are several campaigns.
    """
    from tdfscal.reporting.html import render
    from tdfscal.reporting.undetermined import Attempt, undetermined_drawings, undetermined_report

    log.progress.stage("drawing the report")
    attempt = Attempt(
        error,
        log.campaign.rig,
        tuple(log.inputs),
        tuple(map(told, log.messages)),
        tuple(map(str, paths)),
        log.settings.command,
    )
    write_text(page, render(undetermined_report(attempt, undetermined_drawings(attempt))))
    appear_now()
