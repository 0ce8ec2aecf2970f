"""`calibrate`: from a campaign's files to a calibration."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from tdfscal.acceptance import assess_stated, judge
from tdfscal.commands import options
from tdfscal.commands.campaign import Campaign, PathLike, campaign_folders, listed, resolve
from tdfscal.commands.log_pass import LogPass, Settings, measured, misdated
from tdfscal.commands.options import Option, silent, window
from tdfscal.commands.result import Calibration
from tdfscal.commands.samples import Samples, calibrate_samples
from tdfscal.errors import DataError, NotConvergedError, NotIdentifiableError, UsageError
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES
from tdfscal.files.calibration.from_results import Provenance, from_self
from tdfscal.files.calibration.parts import Method
from tdfscal.files.rig.reading import unconfirmed_in
from tdfscal.findings import Finding
from tdfscal.records import InputFile, Measured, Rig
from tdfscal.selfcal.result import Estimator, SelfCalibration

if TYPE_CHECKING:
    from tdfscal.trackercal import TrackerCalibration


@options.command("calibrate campaign -o calibration.yaml --html report.html", output="content")
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

    Raises
    ------
    UsageError, RigError, DataError, NotIdentifiableError, NotConvergedError
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
        _write_attempt(error, log, listed(paths), Path(html))
        look = f"{html} shows what is weak and what the log holds"
        raise error.restated(hint=". ".join(filter(None, (error.hint, look)))) from error


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
    lines = tuple(unconfirmed_in(campaign.rig.path))
    notes = [Finding("draft-unconfirmed", lines, len(lines))] if lines else []
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
            return Calibration.of(from_self(own, origin_of(log, log.inputs), notes))
    log.progress("calibrating from the tracker's survey")
    tracker, files, remarks = surveyed(campaign, settings.trials, tracker_rng)
    assert own is None or isinstance(own, SelfCalibration)
    inputs = [*log.inputs, *files]
    if own is None:
        notes += log.messages
    return _with_survey(log.rig, own, tracker, origin_of(log, inputs), [*notes, *remarks])


def origin_of(
    log: LogPass, inputs: Iterable[InputFile], when: Measured | None = None, **more: Any
) -> Provenance:
    """Where a calibration comes from, by its campaign; when it was measured, if that is not it."""
    rig, line, when = log.campaign.rig, log.settings.command, when or measured(log)
    return Provenance(rig, tuple(inputs), line, 0, when, clocks=log.clocks, **more)


def surveyed(
    campaign: Campaign, trials: int | None, rng: np.random.Generator
) -> tuple[TrackerCalibration, list[InputFile], tuple[Finding, ...]]:
    """Calibrate from a survey; also return its files, and what is found of them.

    Raises UsageError where the rig file declares none, DataError where its files are unusable.
    """
    from tdfscal.files.points.reading import read_tracker_session
    from tdfscal.files.saving import input_file
    from tdfscal.trackercal import calibrate_tracker

    files, rig = campaign.rig.tracker, campaign.rig.path
    if files is None:
        raise UsageError(
            "the rig file declares no tracker survey",
            where=str(rig),
            hint="add its tracker block, or use --method self",
        )
    missing = next((path for path in files.paths if not path.is_file()), None)
    if missing is not None:
        raise DataError(
            "the point file is not there",
            where=str(missing),
            hint="correct the paths of the tracker block in rig.yaml",
        )
    session, found = read_tracker_session(files)
    options = {} if trials is None else {"trials": trials}
    result = calibrate_tracker(
        campaign.rig.rig, session, misalignment=files.stated.misalignment, rng=rng, **options
    )
    inputs = [input_file(path, "unverified") for path in files.paths]
    return result, inputs, found


#: What is said of the contact wrench, which both methods together judge anew.
_OF_CONTACT = ("contact-uncertain",)


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
    from tdfscal.records import Rotations
    from tdfscal.selfcal.estimator import joint_posterior

    if own is None:
        given = independent(rig, tracker.rotations.rotation, tracker.rotations.covariance)
        reasons = judge(rig, tracker.rotations, tracker.birge, conformity=assess_stated(given))
        return Calibration.of(from_tracker(tracker, origin, (*reasons, *notes)))
    mine = Rotations(rig.supports, own.fit.state.rotation, own.uncertainty.covariance)
    both = combine(mine, tracker.rotations)
    given = joint_posterior(own.fit, both.rotations.covariance, both.rotations.rotation)
    mine_alone = [f for f in own.findings if f.code not in _OF_CONTACT]
    found = [f for f in mine_alone if f.rejects]
    found += judge(rig, tracker.rotations, tracker.birge, conformity=assess_stated(given))
    if not both.test.verified:
        found.append(replace(both.test.finding, code="methods-disagree", subject=(), rejects=True))
    found += [*notes, *(f for f in mine_alone if not f.rejects), *tracker.findings]
    return Calibration.of(from_joint(both, own, tracker, origin, found))


def _write_attempt(
    error: NotIdentifiableError | NotConvergedError,
    log: LogPass,
    paths: Sequence[Path],
    page: Path,
) -> None:
    """Write the page of an error that says the data do not give the angles.

    log : as far as it was read; not at all where there are several campaigns.
    """
    from tdfscal.catalogue import told
    from tdfscal.files.outputs import appear_now
    from tdfscal.files.saving import write_text
    from tdfscal.reporting.html import render
    from tdfscal.reporting.undetermined import Attempt, undetermined_drawings, undetermined_report

    log.progress("drawing the report")
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
