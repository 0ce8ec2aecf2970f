"""`update`: the last calibration, its walk since, and a new campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from tdfscal.comparison.eliminated import eliminate, of_estimate
from tdfscal.comparison.misfit import Misfit, misfit_of
from tdfscal.errors import UsageError
from tdfscal.files.calibration.assembled import Provenance
from tdfscal.files.calibration.document import CALIBRATION_SUFFIXES, save_calibration
from tdfscal.files.calibration.from_results import published_std
from tdfscal.files.calibration.statistics import campaign_document
from tdfscal.files.outputs import PAGE_SUFFIXES, check_outputs
from tdfscal.findings import Finding, Value
from tdfscal.model.earlier import information_of
from tdfscal.model.parameters import placed, starting_state
from tdfscal.motioncal.pipeline import MotionCalibration
from tdfscal.numerics.information import contrast
from tdfscal.records import Rig
from tdfscal.selfcal.covariance import joint_posterior
from tdfscal.significance import DETECTION_POWER, alarm_level
from tdfscal.workflows.arguments import (
    PathLike,
    check_trials,
    listed,
    one,
    window,
)
from tdfscal.workflows.calibration import Calibration, as_calibration, paths_of
from tdfscal.workflows.campaign import campaign_folders, inputs_read, resolve
from tdfscal.workflows.earlier import Earlier, read_earlier
from tdfscal.workflows.log_pass import Settings
from tdfscal.workflows.options import (
    AllowRejected,
    Begin,
    CommandLine,
    End,
    OneCalibration,
    Option,
    Page,
    Paths,
    RigFile,
    Telling,
    Trials,
    command,
)
from tdfscal.workflows.progress import SILENT
from tdfscal.workflows.recordings import day, refuse_repeated
from tdfscal.workflows.samples import Own
from tdfscal.workflows.several_campaigns import (
    Read,
    calibrate_informed,
    left_out,
    misfit_finding,
    read_campaign,
    rejected_alone,
    require_one_rig,
)


@command("update calibration.yaml this-month -o updated.yaml", output="content")
def update(
    calibration: OneCalibration,
    paths: Paths,
    *,
    rig: RigFile = None,
    from_: Begin = None,
    to: End = None,
    trials: Trials = None,
    output: Annotated[
        PathLike | None,
        Option(
            "file to write, .yaml or .json; - for stdout",
            Path,
            "FILE",
            ("--output", "-o"),
            default=...,
        ),
    ] = None,
    html: Page = None,
    allow_rejected: AllowRejected = False,
    command: CommandLine = "tdfscal.update",
    progress: Telling = SILENT,
) -> Calibration:
    """Bring a calibration up to date with a new campaign: zeros, load, angles.

    The last calibration with its full covariance, widened by the random walk `drift.angle` since,
    is what is known before; one posture is enough to find new zeros.

    Raises
    ------
    TdfscalError
        By cause: UsageError (another rig, a campaign older than the calibration), RigError,
        DataError, NotIdentifiableError, NotConvergedError.
    """
    target, page, rig_file, files = one(output), one(html), one(rig), listed(paths)
    check_trials(trials)
    check_outputs(
        {"--output": (target, CALIBRATION_SUFFIXES), "--html": (page, PAGE_SUFFIXES)},
        inputs_read(files, rig_file, files=paths_of([calibration])),
    )
    settings = Settings(progress, window(from_, to), trials=trials, command=command)
    earlier = read_earlier(calibration)
    groups = campaign_folders(files, rig_file)
    for group in groups:
        new = resolve(group, rig_file).rig.rig
        require_one_rig(earlier.rig, new, str(group[0]), earlier.name)
    campaigns = [read_campaign(group, settings, rig_file) for group in groups]
    campaigns.sort(key=lambda read: read.measured.month)
    _check(earlier, campaigns)
    for read in campaigns[:-1]:
        earlier = read_earlier(_updated(earlier, read, 0))
    result = _updated(earlier, campaigns[-1], trials)
    if target is not None and (result.accepted or allow_rejected):
        save_calibration(result, target)
    result.save_page(page, progress)  # whatever the verdict
    return result


def _check(earlier: Earlier, campaigns: Sequence[Read]) -> None:
    """Refuse what cannot follow the calibration."""
    refuse_repeated([*earlier.recordings(), *campaigns])
    for read in campaigns:
        if read.dwells is None:
            raise UsageError(
                "there is no log to update from",
                where=read.name,
                hint="calibrate the survey on its own, and compare",
            )
        told = "file" not in (read.measured.source, earlier.measured.source)
        if told and read.measured.end < earlier.measured.begin:
            raise UsageError(
                f"was recorded on {day(read.measured.end)}, before the calibration "
                f"({day(earlier.measured.end)})",
                where=read.name,
                hint="update in the order of time, or give all campaigns to calibrate",
            )


def _updated(earlier: Earlier, read: Read, trials: int | None) -> Calibration:
    settings, rig = read.log.settings, read.rig
    informed = replace(rig, earlier=earlier.prior(rig, read.measured.month))
    with read.log.explaining():
        own = calibrate_informed(read, informed, trials, tuple(read.inputs))
    level = float(alarm_level(read.measured.month - earlier.measured.month))
    found, this = _contribution(informed, own, read, level)
    if found.p_value <= level:
        if (unsound := rejected_alone(read)) is not None:
            said = left_out({read.name: unsound}, rejects=True)
        else:
            said = (misfit_finding(found, since=earlier.name),)
        own = replace(own, findings=(*own.findings, *said))
    origin = Provenance(
        read.log.campaign.rig,
        tuple(read.inputs),
        settings.command,
        settings.seed,
        measured=read.measured,
        campaigns=(*earlier.campaigns(), this),
        history=earlier.history(),
    )
    notes = [_could_have_missed(found, rig, earlier)]
    if not earlier.file.accepted:
        notes.append(Finding("calibration-rejected", (earlier.name,)))
    return as_calibration(own, origin, tuple(notes))


def _could_have_missed(found: Misfit, rig: Rig, earlier: Earlier) -> Finding:
    """Smallest turns that would have been seen, per sensor by its least visible angle."""
    assert found.detectable is not None
    seen = [
        f"{name} {1e3 * least:.2g} mrad" if np.isfinite(least) else f"{name} none"
        for name, least in zip(rig.supports, found.detectable.max(axis=1), strict=True)
    ]
    values: dict[str, Value] = {"power": DETECTION_POWER, "turns": seen}
    return Finding("turns-visible", (earlier.name,), values=values)


def _contribution(rig: Rig, own: Own, read: Read, level: float) -> tuple[Misfit, dict[str, Any]]:
    """The new campaign against all that was known before it; and its place in the file's list."""
    assert rig.earlier is not None
    reference = starting_state(rig)
    if isinstance(own, MotionCalibration):
        known = information_of(rig, rig.earlier)
        part = of_estimate(own.calibrated, known, reference)
        chi2, dof = contrast(known, part.information).chi2()
        given, std = own.calibrated, own.uncertainty.turns.parameter_std
        postures = own.dwells
    else:
        part = eliminate(own.fit, reference)
        chi2, dof = own.quality.chi2, max(own.quality.dof, 0)
        given, std = (
            joint_posterior(own.fit, own.uncertainty.covariance),
            own.uncertainty.parameter_std,
        )
        postures = int(sum(own.fit.weight > 0))
    published = placed(given.state, published_std(given, std))
    this = campaign_document(
        read.name,
        read.measured,
        read.inputs,
        given.state,
        published,
        rig.axes,
        postures=postures,
        chi2=chi2,
        dof=dof,
    )
    return misfit_of(rig, read.name, part, level), this
